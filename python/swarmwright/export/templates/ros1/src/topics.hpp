// @mark@; changes here are lost.
// Sensors from topics, actuators to topics.
#pragma once

#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "mapping.hpp"
#include "ros/ros.h"

// Makes a topic's name that of the whole graph: /robot_1/scan. Throws MappingError for what is no name.
void resolve(Place& place);

// The latest value of every sensor, and when it came.
class Inputs {
 public:
  // Subscribes to resolved topics. Throws MappingError for a type or a field that is not known, or that the topic does
  // not have.
  Inputs(ros::NodeHandle& node, const std::vector<SensorMapping>& sensors);

  // Topics of sensors from which nothing has come for longer than their time-out: each once.
  std::vector<std::string> silent() const;

  const std::vector<float>& values() const { return values_; }

 private:
  template <typename Message>
  bool subscribe(ros::NodeHandle& node, const std::string& topic, const std::string& type);

  const std::vector<SensorMapping>& sensors_;
  std::vector<float> values_;
  std::vector<std::optional<double>> times_;
  std::vector<ros::Subscriber> subscribers_;
};

// The topics that actuators are published on.
class Outputs {
 public:
  // Advertises resolved topics. Throws MappingError as Inputs does.
  Outputs(ros::NodeHandle& node, const std::vector<ActuatorMapping>& actuators);

  // Publishes one command on each topic.
  void publish(const std::vector<float>& actuators);

  // Publishes zeros.
  void stop();

 private:
  template <typename Message>
  bool advertise(ros::NodeHandle& node, const std::string& topic, const std::string& type);

  const std::vector<ActuatorMapping>& actuators_;
  // By topic: publishes a command; without actuators, zeros.
  std::vector<std::function<void(const std::vector<float>*)>> topics_;
};

// Seconds, of simulated time where there is such a thing, else of a clock that never jumps.
double seconds();
