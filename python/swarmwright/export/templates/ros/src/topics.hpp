// @mark@; changes here are lost.
// Sensors from topics, actuators to topics.
#pragma once

#include <cstdint>
#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "graph.hpp"
#include "mapping.hpp"

// Why sensors have no value.
struct Missing {
  std::vector<std::string> silent;    // topics from which nothing has come for longer than the time-out
  std::vector<std::string> unusable;  // of topics that do send: what their messages lack

  bool none() const { return silent.empty() && unusable.empty(); }

  // Begins with the one word and, where topics are silent, with what is to be said of them.
  std::string text(const std::string& word, const std::string& of_silent) const;
};

// Numbers from 0 to 1, 1 excluded: SplitMix64, of which the upper 24 bits are taken.
class Generator {
 public:
  explicit Generator(std::optional<std::uint64_t> seed);
  float next();

 private:
  std::uint64_t state_;
};

// The latest value of every sensor, and when it came.
class Inputs {
 public:
  // Subscribes to resolved topics. Throws MappingError for a type or a field that is not known, or that the topic does
  // not have.
  Inputs(Graph& graph, const std::vector<SensorMapping>& sensors);

  // Sensors from which nothing has come for longer than their time-out.
  Missing missing() const;

  // Draws the values of random sensors for the next cycle.
  void draw();

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
  std::vector<std::optional<double>> heard_;  // when a message came, with a value for the sensor or without
  std::vector<std::pair<std::size_t, Generator>> generators_;
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
