// @mark@; changes here are lost.
// Runs the exported controller: sensors from topics, commands to topics, at a rate, as mapping.yaml says.
#include <csignal>
#include <cstdlib>

#include "exported.h"
#include "mapping.hpp"
#include "ros/callback_queue.h"
#include "ros/ros.h"
#include "std_msgs/Float32MultiArray.h"
#include "std_srvs/Empty.h"
#include "topics.hpp"

namespace {

volatile std::sig_atomic_t ended = 0;

void end(int) { ended = 1; }

std::string joined(const std::vector<std::string>& words) {
  std::string text;
  for (const std::string& word : words) text += (text.empty() ? "" : ", ") + word;
  return text;
}

Mapping mapping() {
  XmlRpc::XmlRpcValue value;
  if (!ros::param::get("~mapping", value)) {
    throw MappingError("the parameter ~mapping is missing; controller.launch loads it from a file, mapping:=FILE");
  }
  Mapping mapping = read_mapping(value, {exported_sensor_names, exported_sensor_names + exported_sensors},
                                 {exported_actuator_names, exported_actuator_names + exported_actuators});
  for (SensorMapping& sensor : mapping.sensors) resolve(sensor.place);
  for (ActuatorMapping& actuator : mapping.actuators) resolve(actuator.place);
  return mapping;
}

class Node {
 public:
  Node()
      : mapping_(mapping()),
        inputs_(node_, mapping_.sensors),
        outputs_(node_, mapping_.actuators),
        actuators_(mapping_.actuators.size()),
        steps_(private_.advertise<std_msgs::Float32MultiArray>("steps", 1000)),
        reset_(private_.advertiseService("reset", &Node::reset, this)) {
    exported_reset();
    const double period = 1 / mapping_.rate;
    if (ros::Time::isSimTime()) {
      timer_ = node_.createTimer(ros::Duration(period), [this](const ros::TimerEvent&) { cycle(); });
    } else {
      steady_ = node_.createSteadyTimer(ros::WallDuration(period), [this](const ros::SteadyTimerEvent&) { cycle(); });
    }
  }

  void run() {
    while (ros::ok() && ended == 0) ros::getGlobalCallbackQueue()->callAvailable(ros::WallDuration(0.05));
    if (!ros::ok()) return;
    outputs_.stop();
    ros::WallDuration(0.1).sleep();  // until it is sent
  }

 private:
  void cycle() {
    const std::vector<std::string> silent = inputs_.silent();
    if (!silent.empty()) {
      stop(silent);
      return;
    }
    if (stopped_) {
      ROS_INFO("all sensors are there: the controller runs at %g Hz", mapping_.rate);
      if (mapping_.reset_after_silence) exported_reset();
      stopped_ = false;
      begun_ = true;
    }
    exported_step(inputs_.values().data(), actuators_.data());  // refuses only what Inputs has refused before
    outputs_.publish(actuators_);
    show();
  }

  // Says so once; the robot is told in every cycle, for it may listen later.
  void stop(const std::vector<std::string>& silent) {
    if (!begun_) ROS_INFO_THROTTLE(10, "waiting for %s", joined(silent).c_str());
    if (!stopped_) ROS_WARN("stopped: nothing comes from %s", joined(silent).c_str());
    stopped_ = true;
    outputs_.stop();
  }

  // What the controller has sensed and done, for those who listen.
  void show() {
    if (steps_.getNumSubscribers() == 0) return;
    std_msgs::Float32MultiArray step;
    step.layout.dim.resize(2);
    step.layout.dim[0].label = "sensors";
    step.layout.dim[0].size = exported_sensors;
    step.layout.dim[0].stride = exported_sensors + exported_actuators;
    step.layout.dim[1].label = "actuators";
    step.layout.dim[1].size = exported_actuators;
    step.layout.dim[1].stride = exported_actuators;
    step.data = inputs_.values();
    step.data.insert(step.data.end(), actuators_.begin(), actuators_.end());
    steps_.publish(step);
  }

  bool reset(std_srvs::Empty::Request&, std_srvs::Empty::Response&) {
    exported_reset();
    ROS_INFO("the controller was reset");
    return true;
  }

  ros::NodeHandle node_;
  ros::NodeHandle private_{"~"};
  Mapping mapping_;
  Inputs inputs_;
  Outputs outputs_;
  std::vector<float> actuators_;
  bool stopped_ = true;
  bool begun_ = false;
  ros::Publisher steps_;
  ros::ServiceServer reset_;
  ros::Timer timer_;
  ros::SteadyTimer steady_;
};

}  // namespace

int main(int argc, char** argv) {
  ros::init(argc, argv, "swarmwright_controller", ros::init_options::NoSigintHandler);
  std::signal(SIGINT, end);
  std::signal(SIGTERM, end);
  const ros::NodeHandle node;  // without one nothing can be said any more
  try {
    Node().run();
    return EXIT_SUCCESS;
  } catch (const MappingError& error) {
    ROS_FATAL("%s", error.what());
    return 2;
  }
}
