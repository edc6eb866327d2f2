// Ask the path planning agent for a path, from C++ with omniORB:
//
//   get_path corbaname::127.0.0.1:2809#RoboCorba/PathPlanner  L1 3 4  L3 10 2

#include <cstdlib>
#include <iostream>

#include "robocorba.hh"

static void setPoint(RoboCorba::Point& point, char** word) {
  point.floor = CORBA::string_dup(word[0]);
  point.x = std::atof(word[1]);
  point.y = std::atof(word[2]);
}

int main(int argc, char** argv) {
  CORBA::ORB_var orb = CORBA::ORB_init(argc, argv);
  if (argc != 8) {
    std::cerr << "get_path URI FLOOR X Y FLOOR X Y" << std::endl;
    return 2;
  }
  int code = 0;
  try {
    CORBA::Object_var object = orb->string_to_object(argv[1]);
    RoboCorba::PathPlanner_var planner = RoboCorba::PathPlanner::_narrow(object);
    RoboCorba::Point start, goal;
    setPoint(start, argv + 2);
    setPoint(goal, argv + 5);
    RoboCorba::PathPointSeq_var path = planner->getPath(start, goal);
    for (CORBA::ULong i = 0; i < path->length(); ++i) {
      const RoboCorba::PathPoint& point = path[i];
      std::cout << point.time << " s  " << point.position.floor << ":" << point.position.x << ","
                << point.position.y << "  " << point.node << std::endl;
    }
  } catch (const RoboCorba::NoPath& refusal) {
    std::cerr << "no path: " << refusal.reason << std::endl;
    code = 1;
  } catch (const RoboCorba::NotFree& refusal) {
    std::cerr << refusal.which << " is too near to " << refusal.obstacle << std::endl;
    code = 1;
  } catch (const CORBA::Exception& failure) {
    std::cerr << "the call failed: " << failure._name() << std::endl;
    code = 1;
  }
  orb->destroy();
  return code;
}
