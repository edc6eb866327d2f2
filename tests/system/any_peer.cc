// A plain client in C++ of two event channels, which may be one:
//
//   any_peer SUPPLIED_CHANNEL_URI CONSUMED_CHANNEL_URI
//
// Prints `ready`, then for each line of its input, an encapsulated `any` as hexadecimal digits, one line: it pushes the
// event to the one channel, and prints the event as it encodes it, and what comes from the other one, in the same way; or
// what went wrong, `impossible` where its own ORB is to blame.

#include <chrono>
#include <condition_variable>
#include <deque>
#include <iostream>
#include <mutex>
#include <string>

#include "CosEventChannelAdmin.hh"

namespace {

std::string encoded(const CORBA::Any& value) {
  cdrEncapsulationStream stream;
  value >>= stream;
  const CORBA::Octet* octets = static_cast<const CORBA::Octet*>(stream.bufPtr());
  std::string hexadecimal;
  for (CORBA::ULong at = 0; at < stream.bufSize(); ++at) {
    hexadecimal += "0123456789abcdef"[octets[at] >> 4];
    hexadecimal += "0123456789abcdef"[octets[at] & 15];
  }
  return hexadecimal;
}

// Encodes events as they come: omniORB 4.2 destroys some types within themselves with the first of several copies.
class Consumer : public POA_CosEventComm::PushConsumer {
 public:
  void push(const CORBA::Any& value) override {
    std::lock_guard<std::mutex> guard(mutex_);
    try {
      events_.push_back(encoded(value));
    } catch (const omniORB::fatalException&) {
      events_.push_back("");
    }
    changed_.notify_all();
  }

  void disconnect_push_consumer() override {}

  bool next(std::string& value) {
    std::unique_lock<std::mutex> guard(mutex_);
    if (!changed_.wait_for(guard, std::chrono::seconds(10), [this] { return !events_.empty(); })) return false;
    value = events_.front();
    events_.pop_front();
    return true;
  }

 private:
  std::mutex mutex_;
  std::condition_variable changed_;
  std::deque<std::string> events_;
};

std::string outcome(CosEventChannelAdmin::ProxyPushConsumer_ptr proxy, Consumer& consumer, const std::string& line) {
  std::string octets;
  for (std::size_t at = 0; at + 1 < line.size(); at += 2)
    octets += static_cast<char>(std::stoi(line.substr(at, 2), nullptr, 16));
  cdrEncapsulationStream stream(reinterpret_cast<const CORBA::Octet*>(octets.data()), octets.size());
  CORBA::Any sent;
  std::string got;
  sent <<= stream;
  const std::string before = encoded(sent);
  proxy->push(sent);
  if (!consumer.next(got)) return "nothing came";
  return got.empty() ? "impossible" : before + " " + got;
}

CosEventChannelAdmin::EventChannel_ptr channel(CORBA::ORB_ptr orb, const char* uri) {
  CORBA::Object_var object = orb->string_to_object(uri);
  return CosEventChannelAdmin::EventChannel::_narrow(object);
}

}  // namespace

int main(int argc, char** argv) {
  const char* options[][2] = {{"nativeCharCodeSet", "UTF-8"}, {"clientCallTimeOutPeriod", "20000"}, {nullptr, nullptr}};
  CORBA::ORB_var orb = CORBA::ORB_init(argc, argv, "omniORB4", options);
  CORBA::Object_var object = orb->resolve_initial_references("RootPOA");
  PortableServer::POA_var poa = PortableServer::POA::_narrow(object);
  PortableServer::POAManager_var manager = poa->the_POAManager();
  manager->activate();

  CosEventChannelAdmin::EventChannel_var supplied = channel(orb, argv[1]), consumed = channel(orb, argv[2]);
  Consumer consumer;
  CosEventComm::PushConsumer_var reference = consumer._this();
  CosEventChannelAdmin::ConsumerAdmin_var consumers = consumed->for_consumers();
  CosEventChannelAdmin::ProxyPushSupplier_var source = consumers->obtain_push_supplier();
  source->connect_push_consumer(reference);
  CosEventChannelAdmin::SupplierAdmin_var suppliers = supplied->for_suppliers();
  CosEventChannelAdmin::ProxyPushConsumer_var proxy = suppliers->obtain_push_consumer();
  proxy->connect_push_supplier(CosEventComm::PushSupplier::_nil());

  std::cout << "ready" << std::endl;
  for (std::string line; std::getline(std::cin, line);) {
    try {
      std::cout << outcome(proxy, consumer, line) << std::endl;
    } catch (const CORBA::Exception& error) {
      std::cout << error._name() << std::endl;
    } catch (const omniORB::fatalException&) {  // omniORB 4.2 fails at some types within themselves
      std::cout << "impossible" << std::endl;
    }
  }
  source->disconnect_push_supplier();
  proxy->disconnect_push_consumer();
  orb->destroy();
  return 0;
}
