// @mark@; changes here are lost.
// Reads sensors from topics, and publishes actuators on topics.
#pragma once

#include <cstdint>
#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "graph.hpp"
#include "mapping.hpp"

// The reasons for sensors without a value.
struct Missing {
  std::vector<std::string> silent;    // topics without a message for longer than the time-out
  std::vector<std::string> unusable;  // defects of the messages of other topics

  bool none() const { return silent.empty() && unusable.empty(); }

  // Returns the reasons: a word, and for silent topics a text about them.
  std::string text(const std::string& word, const std::string& of_silent) const;
};

// Random numbers in 0 .. 1, without 1: the upper 24 bits of SplitMix64.
class Generator {
 public:
  explicit Generator(std::optional<std::uint64_t> seed);
  float next();

 private:
  std::uint64_t state_;
};

// The latest value of every sensor, and its time.
class Inputs {
 public:
  // Subscribes to resolved topics. Throws MappingError for an unknown type or field, or one that the topic does not
  // have.
  Inputs(Graph& graph, const std::vector<SensorMapping>& sensors);

  // Returns the sensors without a message for longer than their time-out.
  Missing missing() const;

  // Draws the values of random sensors for the next cycle.
  void draw();

  const std::vector<float>& values() const { return values_; }

  // Throws MappingError for a topic that other nodes use with another type.
  void check_types() const;

 private:
  template <typename Message>
  bool subscribe(const std::string& topic, const std::string& type);

  Graph& graph_;
  const std::vector<SensorMapping>& sensors_;
  std::vector<float> values_;
  std::vector<std::optional<double>> times_;
  std::vector<std::optional<double>> heard_;  // time of the latest message, with or without a value for the sensor
  std::vector<std::pair<std::size_t, Generator>> generators_;
};

// The topics of the actuators.
class Outputs {
 public:
  // Advertises resolved topics. Throws MappingError, see Inputs.
  Outputs(Graph& graph, const std::vector<ActuatorMapping>& actuators);

  // Publishes a command on each topic.
  void publish(const std::vector<float>& actuators);

  // Publishes zeros.
  void stop();

  // See Inputs.
  void check_types() const;

 private:
  template <typename Message>
  bool advertise(const std::string& topic, const std::string& type);

  Graph& graph_;
  const std::vector<ActuatorMapping>& actuators_;
  // For each topic, a function that publishes a command; without actuators, zeros.
  std::vector<std::function<void(const std::vector<float>*)>> topics_;
};
