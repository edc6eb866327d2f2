// A robot that drives until its virtual laser measures something near, from C++ with omniORB:
//
//   new_robot corbaname::127.0.0.1:2809#RoboCorba/SimulationServer  L1 3 4
//
// Give it a time limit for calls: -ORBclientCallTimeOutPeriod 10000

#include <algorithm>
#include <chrono>
#include <cmath>
#include <cstdlib>
#include <iostream>
#include <thread>

#include "robocorba.hh"

namespace {

// Distance to the nearest obstacle within 30 degrees ahead [m].
double nearestAhead(RoboCorba::RobotSession_ptr robot, const RoboCorba::ScanSpec& laser) {
  RoboCorba::RobotState_var state = robot->state();
  RoboCorba::VirtualSensor_var sensor = robot->sensor();
  RoboCorba::ScanData_var scan = sensor->scan(state->at, RoboCorba::Mount(), laser);
  double nearest = laser.range;
  for (CORBA::ULong ray = 0; ray < scan->distances.length(); ++ray) {
    const double angle = scan->firstAngle + ray * scan->step;
    if (std::abs(angle) < 0.52) nearest = std::min(nearest, scan->distances[ray]);
  }
  return nearest;
}

}  // namespace

int main(int argc, char** argv) {
  CORBA::ORB_var orb = CORBA::ORB_init(argc, argv);
  if (argc != 5) {
    std::cerr << "new_robot URI FLOOR X Y" << std::endl;
    return 2;
  }
  int code = 0;
  RoboCorba::RobotSession_var robot;
  try {
    CORBA::Object_var object = orb->string_to_object(argv[1]);
    RoboCorba::SimulationServer_var server = RoboCorba::SimulationServer::_narrow(object);
    RoboCorba::RobotDescription about;
    about.name = CORBA::string_dup("new-cpp");
    about.start.floor = CORBA::string_dup(argv[2]);
    about.start.x = std::atof(argv[3]);
    about.start.y = std::atof(argv[4]);
    about.start.heading = 0.0;
    about.radius = 0.4;
    about.mass = 127.0;
    about.limits = {1.0, 1.75, 1.0, 1.75};
    robot = server->registerRobot(about);
    RoboCorba::VirtualSensor_var sensor = robot->sensor();
    const RoboCorba::ScanSpec laser = sensor->laser();
    const RoboCorba::Velocity ahead = {0.5, 0.0, 0.0};
    while (nearestAhead(robot, laser) > 1.0) {
      robot->command(ahead, 0.5);  // valid for half a second unless repeated
      std::this_thread::sleep_for(std::chrono::milliseconds(100));
    }
    RoboCorba::RobotState_var state = robot->state();
    std::cout << "something is near " << state->at.floor << ":" << state->at.x << "," << state->at.y << std::endl;
  } catch (const RoboCorba::PlaceTaken& refusal) {
    std::cerr << "the place is taken by " << refusal.by << std::endl;
    code = 1;
  } catch (const RoboCorba::UnknownFloor& refusal) {
    std::cerr << "there is no floor " << refusal.floorName << std::endl;
    code = 1;
  } catch (const CORBA::Exception& failure) {
    std::cerr << "the call failed: " << failure._name() << std::endl;
    code = 1;
  }
  try {
    if (!CORBA::is_nil(robot)) robot->deregister();
  } catch (const CORBA::SystemException&) {
    // the server logs the robot off when its lease expires
  }
  orb->destroy();
  return code;
}
