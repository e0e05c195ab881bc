// @mark@; changes here are lost.
// Sensors from topics, actuators to topics.
#pragma once

#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "graph.hpp"
#include "mapping.hpp"

// The latest value of every sensor, and when it came.
class Inputs {
 public:
  // Subscribes to resolved topics. Throws MappingError for a type or a field that is not known, or that the topic does
  // not have.
  Inputs(Graph& graph, const std::vector<SensorMapping>& sensors);

  // Topics of sensors from which nothing has come for longer than their time-out: each once.
  std::vector<std::string> silent() const;

  const std::vector<float>& values() const { return values_; }

  // Throws MappingError for a topic that others use with another type, now that they may be known.
  void check_types() const;

 private:
  template <typename Message>
  bool subscribe(const std::string& topic, const std::string& type);

  Graph& graph_;
  const std::vector<SensorMapping>& sensors_;
  std::vector<float> values_;
  std::vector<std::optional<double>> times_;
};

// The topics that actuators are published on.
class Outputs {
 public:
  // Advertises resolved topics. Throws MappingError as Inputs does.
  Outputs(Graph& graph, const std::vector<ActuatorMapping>& actuators);

  // Publishes one command on each topic.
  void publish(const std::vector<float>& actuators);

  // Publishes zeros.
  void stop();

  // As that of Inputs.
  void check_types() const;

 private:
  template <typename Message>
  bool advertise(const std::string& topic, const std::string& type);

  Graph& graph_;
  const std::vector<ActuatorMapping>& actuators_;
  // By topic: publishes a command; without actuators, zeros.
  std::vector<std::function<void(const std::vector<float>*)>> topics_;
};
