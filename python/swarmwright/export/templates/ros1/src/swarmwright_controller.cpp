// @mark@; changes here are lost.
// Runs the exported controller: sensors from topics, commands to topics, at a rate, see mapping.yaml.
#include <atomic>
#include <csignal>
#include <cstdlib>
#include <string>
#include <thread>

#include "control.hpp"
#include "graph.hpp"
#include "mapping.hpp"
#include "ros/callback_queue.h"
#include "ros/ros.h"
#include "ros/xmlrpc_manager.h"
#include "std_srvs/Empty.h"
#include "xmlrpcpp/XmlRpcValue.h"

namespace {

std::atomic<bool> ended{false};

void end(int) { ended = true; }

// By default, roscpp exits at once on `rosnode kill` or for a second node of the same name: the last command would
// remain in force.
void end_as_told(XmlRpc::XmlRpcValue& parameters, XmlRpc::XmlRpcValue& result) {
  std::string reason = "no reason given";
  if (parameters.getType() == XmlRpc::XmlRpcValue::TypeArray && parameters.size() > 1 &&
      parameters[1].getType() == XmlRpc::XmlRpcValue::TypeString) {
    reason = static_cast<std::string>(parameters[1]);
  }
  ROS_WARN("told to end: %s", reason.c_str());
  ended = true;
  result = ros::xmlrpc::responseInt(1, "", 0);
}

void end_on_signals() {
  for (const int number : {SIGINT, SIGTERM}) std::signal(number, end);
  // A closed terminal; nohup ignores it.
  if (std::signal(SIGHUP, end) == SIG_IGN) std::signal(SIGHUP, SIG_IGN);
}

// Waits for a master and for signals, which roscpp ignores. Returns whether a master answers before a signal.
bool await_master() {
  if (ros::master::check()) return true;
  ROS_WARN("no master answers at %s (ROS_MASTER_URI); waiting for it", ros::master::getURI().c_str());
  while (!ended) {
    ros::WallDuration(0.2).sleep();
    if (ros::master::check()) return true;
  }
  return false;
}

// Ends the node 2 s after a signal even if the master was lost, while roscpp keeps registering topics. A moving robot
// has its last command by then.
void end_without_master() {
  std::thread([] {
    while (!ended) ros::WallDuration(0.1).sleep();
    ros::WallDuration(2).sleep();
    ros::requestShutdown();
  }).detach();
}

Value value_of(XmlRpc::XmlRpcValue& source) {
  using XmlRpc::XmlRpcValue;
  Value result;
  switch (source.getType()) {
    case XmlRpcValue::TypeBoolean:
      return Value::of(static_cast<bool>(source));
    case XmlRpcValue::TypeInt:
      return Value::of(static_cast<double>(static_cast<int>(source)));
    case XmlRpcValue::TypeDouble:
      return Value::of(static_cast<double>(source));
    case XmlRpcValue::TypeString:
      return Value::of(static_cast<std::string>(source));
    case XmlRpcValue::TypeArray:
      result.kind = Value::Kind::list;
      for (int i = 0; i < source.size(); ++i) result.list.push_back(value_of(source[i]));
      return result;
    case XmlRpcValue::TypeStruct:
      result.kind = Value::Kind::map;
      for (auto& [key, value] : source) result.map.emplace_back(key, value_of(value));
      return result;
    default:
      return result;
  }
}

Value mapping() {
  XmlRpc::XmlRpcValue value;
  if (!ros::param::get("~mapping", value)) {
    throw MappingError("the parameter ~mapping is missing; controller.launch loads it from a file, mapping:=FILE");
  }
  return value_of(value);
}

class Node {
 public:
  Node()
      : control_(graph_, resolved(graph_, mapping())), reset_(private_.advertiseService("reset", &Node::reset, this)) {
    const double period = 1 / control_.rate();
    if (ros::Time::isSimTime()) {
      timer_ = node_.createTimer(ros::Duration(period), [this](const ros::TimerEvent&) { control_.cycle(); });
    } else {
      steady_ = node_.createSteadyTimer(ros::WallDuration(period),
                                        [this](const ros::SteadyTimerEvent&) { control_.cycle(); });
    }
  }

  void run() {
    while (ros::ok() && !ended) {
      ros::getGlobalCallbackQueue()->callAvailable(ros::WallDuration(0.05));
      control_.look();
    }
    if (!ros::ok()) return;
    control_.stop();
    ros::WallDuration(0.1).sleep();  // until the message is sent
  }

 private:
  bool reset(std_srvs::Empty::Request&, std_srvs::Empty::Response&) {
    control_.reset();
    return true;
  }

  ros::NodeHandle node_;
  ros::NodeHandle private_{"~"};
  Graph graph_;
  Control control_;
  ros::ServiceServer reset_;
  ros::Timer timer_;
  ros::SteadyTimer steady_;
};

}  // namespace

int main(int argc, char** argv) {
  ros::init(argc, argv, "swarmwright_controller", ros::init_options::NoSigintHandler);
  end_on_signals();
  if (!await_master()) return EXIT_SUCCESS;
  end_without_master();
  ros::XMLRPCManager::instance()->unbind("shutdown");
  ros::XMLRPCManager::instance()->bind("shutdown", end_as_told);
  const ros::NodeHandle node;  // required for logging
  try {
    Node().run();
    return EXIT_SUCCESS;
  } catch (const MappingError& error) {
    ROS_FATAL("%s", error.what());
    return 2;
  }
}
