// A robot adaptor in C++ with omniORB: a disc without arms that follows each command exactly, and its laser.
//
//   disc_adaptor corbaloc::127.0.0.1:2809/NameService  A      binds it as RoboCorba/Adaptors/A
//   robocorba robot A --floor L1 --at 3,4,0 --adaptor corba -- 3 4 0 [6.5]
//
// What follows -- in the second line are the arguments of `start`: where the robot is, in metres and radians of the
// building's map. A robot that knows its place by itself reads it from its localisation instead. With the fourth one it
// has a laser, which sees a wall that no map needs to have: the line x = 6.5. Yours asks its driver.

#include <algorithm>
#include <chrono>
#include <cmath>
#include <cstdlib>
#include <iostream>
#include <mutex>
#include <string>

#include <omniORB4/Naming.hh>

#include "robocorba.hh"

namespace {

double now() {
  return std::chrono::duration<double>(std::chrono::steady_clock::now().time_since_epoch()).count();
}

// Ahead, half a turn, a ray for each degree.
const CORBA::ULong kRays = 181;
const double kStep = M_PI / 180.0, kRange = 8.0;

class Disc : public POA_RoboCorba::SensingAdaptor {
 public:
  CORBA::Boolean start(const RoboCorba::StringSeq& arguments) override {
    std::lock_guard<std::mutex> guard(mutex_);
    if (isStarted_) return false;
    const auto given = arguments.length();
    if (given != 3 && given != 4) throw RoboCorba::AdaptorFailed("the arguments must be X Y HEADING [WALL_X]");
    hasLaser_ = given == 4;
    wallX_ = hasLaser_ ? std::atof(arguments[3]) : 0.0;
    if (!isPlaced_) {  // at the first start; later, such as after a stop, it knows where it is
      x_ = std::atof(arguments[0]);
      y_ = std::atof(arguments[1]);
      heading_ = std::atof(arguments[2]);
      isPlaced_ = true;
    }
    velocity_ = RoboCorba::Velocity();
    movedAt_ = until_ = now();
    return isStarted_ = true;
  }

  CORBA::Boolean stop() override {
    std::lock_guard<std::mutex> guard(mutex_);
    const bool was = isStarted_;
    isStarted_ = false;
    return was;
  }

  CORBA::Boolean read(RoboCorba::ActorState_out state) override {
    std::lock_guard<std::mutex> guard(mutex_);
    state = new RoboCorba::ActorState();  // also if there is none: the caller owns it
    if (!isStarted_) return false;
    move();
    state->time = movedAt_;
    state->x = x_;
    state->y = y_;
    state->heading = heading_;
    state->moving = velocity_;
    return true;  // joints stay empty: it has no arms
  }

  CORBA::Boolean write(const RoboCorba::ActorCommand& wanted) override {
    std::lock_guard<std::mutex> guard(mutex_);
    if (!isStarted_) return false;
    move();
    velocity_ = wanted.wanted;
    until_ = movedAt_ + wanted.validFor;
    return true;
  }

  // Called once after each start.
  RoboCorba::RangeSensorSeq* rangeSensors() override {
    std::lock_guard<std::mutex> guard(mutex_);
    RoboCorba::RangeSensorSeq_var found = new RoboCorba::RangeSensorSeq();
    if (hasLaser_) {
      found->length(1);
      found[0].name = CORBA::string_dup("laser");
      found[0].where = RoboCorba::Mount();  // at the centre, ahead
      found[0].spec.firstAngle = -M_PI / 2.0;
      found[0].spec.step = kStep;
      found[0].spec.rays = kRays;
      found[0].spec.range = kRange;
      found[0].spec.rim = 0.0;
      found[0].spec.noise = RoboCorba::ScanNoise();
    }
    return found._retn();
  }

  RoboCorba::ScanData* ranges(const char* sensor) override {
    std::lock_guard<std::mutex> guard(mutex_);
    if (!hasLaser_ || std::string(sensor) != "laser") {
      RoboCorba::StringSeq known;
      if (hasLaser_) {
        known.length(1);
        known[0] = CORBA::string_dup("laser");
      }
      throw RoboCorba::UnknownSensor(sensor, known);
    }
    move();
    RoboCorba::ScanData_var seen = new RoboCorba::ScanData();
    seen->time = movedAt_;
    seen->firstAngle = -M_PI / 2.0;
    seen->step = kStep;
    seen->distances.length(kRays);
    for (CORBA::ULong ray = 0; ray < kRays; ++ray) {
      const double distance = (wallX_ - x_) / std::cos(heading_ + seen->firstAngle + ray * kStep);
      seen->distances[ray] = distance >= 0.0 ? std::min(distance, kRange) : kRange;
    }
    return seen._retn();
  }

  // It has no bumper.
  RoboCorba::SensorReadingSeq* readings() override { return new RoboCorba::SensorReadingSeq(); }

 private:
  // Up to the present, or to the end of the last command.
  void move() {
    const double at = now();
    const double seconds = std::max(0.0, std::min(at, until_) - movedAt_);
    const double c = std::cos(heading_), s = std::sin(heading_);
    x_ += (c * velocity_.ahead - s * velocity_.left) * seconds;
    y_ += (s * velocity_.ahead + c * velocity_.left) * seconds;
    heading_ += velocity_.turn * seconds;
    if (at >= until_) velocity_ = RoboCorba::Velocity();
    movedAt_ = at;
  }

  std::mutex mutex_;
  bool isStarted_ = false, isPlaced_ = false, hasLaser_ = false;
  double wallX_ = 0.0, x_ = 0.0, y_ = 0.0, heading_ = 0.0, movedAt_ = 0.0, until_ = 0.0;
  RoboCorba::Velocity velocity_ = RoboCorba::Velocity();
};

void bind(CosNaming::NamingContext_ptr root, const char* robot, CORBA::Object_ptr adaptor) {
  CosNaming::Name name;
  for (const char* part : {"RoboCorba", "Adaptors"}) {
    name.length(name.length() + 1);
    name[name.length() - 1].id = CORBA::string_dup(part);
    try {
      CosNaming::NamingContext_var made = root->bind_new_context(name);
    } catch (const CosNaming::NamingContext::AlreadyBound&) {
      // it is there
    }
  }
  name.length(3);
  name[2].id = CORBA::string_dup(robot);
  root->rebind(name, adaptor);
}

}  // namespace

int main(int argc, char** argv) {
  CORBA::ORB_var orb = CORBA::ORB_init(argc, argv);
  if (argc != 3) {
    std::cerr << "disc_adaptor URI_OF_THE_NAMING_SERVICE ROBOT" << std::endl;
    return 2;
  }
  try {
    CORBA::Object_var object = orb->resolve_initial_references("RootPOA");
    PortableServer::POA_var poa = PortableServer::POA::_narrow(object);
    PortableServer::POAManager_var manager = poa->the_POAManager();
    manager->activate();
    PortableServer::Servant_var<Disc> disc(new Disc());
    PortableServer::ObjectId_var id = poa->activate_object(disc.in());
    RoboCorba::SensingAdaptor_var reference = disc->_this();
    object = orb->string_to_object(argv[1]);
    CosNaming::NamingContext_var root = CosNaming::NamingContext::_narrow(object);
    bind(root, argv[2], reference);
    std::cout << "ready" << std::endl;
    orb->run();
  } catch (const CORBA::Exception& failure) {
    std::cerr << "the call failed: " << failure._name() << std::endl;
    return 1;
  }
  return 0;
}
