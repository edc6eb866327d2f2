// Print the robots of a floor as they move, by events of its channel, from C++ with omniORB:
//
//   floor_events corbaname::127.0.0.1:2809#RoboCorba/EventChannels/main  L1 [COUNT]
//
// Ends after COUNT lines, with 0 lines never. The channel calls this program: behind a firewall see docs/operations.md.

#include <condition_variable>
#include <cstdlib>
#include <iostream>
#include <map>
#include <mutex>
#include <string>

#include "event_channel.hh"
#include "omni_database.hh"

namespace {

class FloorConsumer : public POA_RoboCorba::EventConsumer {
 public:
  explicit FloorConsumer(long lines) : left_(lines) {}

  // Events come one after the other. Names of bodies are known once an event is the whole floor, as one is every 5 s.
  void pushRuns(const RoboCorba::EventRunSeq& runs) override {
    std::lock_guard<std::mutex> guard(mutex_);
    for (CORBA::ULong run = 0; run < runs.length(); ++run)
      for (CORBA::ULong i = 0; i < runs[run].payloads.length(); ++i) take(runs[run].payloads[i]);
    changed_.notify_all();
  }

  void pushTogether(CORBA::ULong, const RoboCorba::EventSeq&) override {}
  void push(const CORBA::Any&) override {}
  void disconnect_push_consumer() override {}

  void waitForEnd() {
    std::unique_lock<std::mutex> guard(mutex_);
    changed_.wait(guard, [this] { return left_ == 0; });
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
  if (argc != 3 && argc != 4) {
    std::cerr << "floor_events URI FLOOR [COUNT]" << std::endl;
    return 2;
  }
  int code = 0;
  try {
    CORBA::Object_var object = orb->resolve_initial_references("RootPOA");
    PortableServer::POA_var poa = PortableServer::POA::_narrow(object);
    PortableServer::POAManager_var manager = poa->the_POAManager();
    manager->activate();

    object = orb->string_to_object(argv[1]);
    RoboCorba::EventChannel_var channel = RoboCorba::EventChannel::_narrow(object);
    FloorConsumer consumer(argc == 4 ? std::atol(argv[3]) : -1);
    PortableServer::ObjectId_var id = poa->activate_object(&consumer);
    RoboCorba::EventConsumer_var reference = consumer._this();

    RoboCorba::Subscription wanted;
    wanted.length(1);
    wanted[0].window = 0.0;
    wanted[0].patterns.length(1);
    wanted[0].patterns[0].type = CORBA::string_dup("typed.floor_changed");
    wanted[0].patterns[0].source = CORBA::string_dup(argv[2]);
    const RoboCorba::QueuePolicy queue = {1000, RoboCorba::DISCARD_OLDEST, 0.0};
    RoboCorba::EventProxyPushSupplier_var proxy = channel->subscribe("", reference, wanted, queue);
    consumer.waitForEnd();
    proxy->disconnect_push_supplier();
    poa->deactivate_object(id);
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
