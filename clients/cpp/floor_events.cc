// Print the robots of a floor as they move, by events of its channel, from C++ with omniORB:
//
//   floor_events corbaname::127.0.0.1:2809#RoboCorba/OmniDatabase
//                corbaname::127.0.0.1:2809#RoboCorba/EventChannels/main  L1 [COUNT]
//
// Ends after COUNT lines, with 0 lines never. The channel calls this program: behind a firewall see docs/operations.md.

#include <chrono>
#include <condition_variable>
#include <cstdlib>
#include <iostream>
#include <map>
#include <mutex>
#include <string>

#include "robocorba.hh"

namespace {

class FloorConsumer : public POA_RoboCorba::EventConsumer {
 public:
  explicit FloorConsumer(long lines) : left_(lines) {}

  // Events come one after the other. The first one after each publishTypedChanges is the whole floor, with all names.
  void pushRuns(const RoboCorba::EventRunSeq& runs) override {
    std::lock_guard<std::mutex> guard(mutex_);
    for (CORBA::ULong run = 0; run < runs.length(); ++run)
      for (CORBA::ULong i = 0; i < runs[run].payloads.length(); ++i) take(runs[run].payloads[i]);
    changed_.notify_all();
  }

  void pushTogether(CORBA::ULong, const RoboCorba::EventSeq&) override {}
  void push(const CORBA::Any&) override {}
  void disconnect_push_consumer() override {}

  // Whether all lines are printed. Waits for it.
  bool hasEnded(double seconds) {
    std::unique_lock<std::mutex> guard(mutex_);
    return changed_.wait_for(guard, std::chrono::duration<double>(seconds), [this] { return left_ == 0; });
  }

 private:
  void take(const RoboCorba::Octets& payload) {
    // An `any` in an encapsulation. Other ORBs have an IOP::Codec for this, omniORB a stream.
    cdrEncapsulationStream stream(payload.get_buffer(), payload.length());
    CORBA::Any value;
    value <<= stream;
    const RoboCorba::TypedFloorUpdate* update;
    if (!(value >>= update)) return;
    if (update->since == 0) names_.clear();
    for (CORBA::ULong i = 0; i < update->came.length(); ++i)
      if (update->came[i].kind == RoboCorba::ROBOT_BODY) names_[update->came[i].number] = update->came[i].name.in();
    for (CORBA::ULong i = 0; i < update->went.length(); ++i) names_.erase(update->went[i]);
    for (CORBA::ULong i = 0; i < update->motions.length() && left_ != 0; ++i) {
      const RoboCorba::Motion& motion = update->motions[i];
      const auto found = names_.find(motion.number);
      if (found == names_.end()) continue;
      std::cout << update->time << " s  " << found->second << "  " << motion.x << "," << motion.y << std::endl;
      if (left_ > 0) --left_;
    }
  }

  std::map<CORBA::ULong, std::string> names_;
  long left_;
  std::mutex mutex_;
  std::condition_variable changed_;
};

}  // namespace

int main(int argc, char** argv) {
  CORBA::ORB_var orb = CORBA::ORB_init(argc, argv);
  if (argc != 4 && argc != 5) {
    std::cerr << "floor_events DATABASE CHANNEL FLOOR [COUNT]" << std::endl;
    return 2;
  }
  int code = 0;
  try {
    CORBA::Object_var object = orb->resolve_initial_references("RootPOA");
    PortableServer::POA_var poa = PortableServer::POA::_narrow(object);
    PortableServer::POAManager_var manager = poa->the_POAManager();
    manager->activate();

    object = orb->string_to_object(argv[1]);
    RoboCorba::OmniDatabase_var database = RoboCorba::OmniDatabase::_narrow(object);
    object = orb->string_to_object(argv[2]);
    RoboCorba::EventChannel_var channel = RoboCorba::EventChannel::_narrow(object);
    PortableServer::Servant_var<FloorConsumer> consumer(new FloorConsumer(argc == 5 ? std::atol(argv[4]) : -1));
    PortableServer::ObjectId_var id = poa->activate_object(consumer.in());
    RoboCorba::EventConsumer_var reference = consumer->_this();

    RoboCorba::Subscription wanted;
    wanted.length(1);
    wanted[0].window = 0.0;
    wanted[0].patterns.length(1);
    wanted[0].patterns[0].type = CORBA::string_dup("typed.floor_changed");
    wanted[0].patterns[0].source = CORBA::string_dup(argv[3]);
    const RoboCorba::QueuePolicy queue = {1000, RoboCorba::DISCARD_OLDEST, 0.0};
    RoboCorba::EventProxyPushSupplier_var proxy = channel->subscribe("", reference, wanted, queue);
    double seconds;
    do {
      seconds = database->publishTypedChanges(argv[3]);
    } while (seconds > 0 && !consumer->hasEnded(seconds / 2));
    proxy->disconnect_push_supplier();
    poa->deactivate_object(id);
    if (seconds == 0) {
      std::cerr << "the simulation server publishes no events" << std::endl;
      code = 1;
    }
  } catch (const RoboCorba::UnknownFloor& unknown) {
    std::cerr << "there is no floor " << unknown.floorName << std::endl;
    code = 1;
  } catch (const RoboCorba::InvalidSubscription& refusal) {
    std::cerr << refusal.where << ": " << refusal.reason << std::endl;
    code = 1;
  } catch (const CORBA::Exception& failure) {
    std::cerr << "the call failed: " << failure._name() << std::endl;
    code = 1;
  }
  orb->destroy();
  return code;
}
