// @mark@; changes here are lost.
// The content of mapping.yaml, which maps fields of topics to sensors and actuators of the controller.
#pragma once

#include <cstddef>
#include <cstdint>
#include <optional>
#include <stdexcept>
#include <string>
#include <utility>
#include <vector>

#include "value.hpp"

// A mistake in the mapping, with its location and its remedy.
struct MappingError : std::runtime_error {
  using std::runtime_error::runtime_error;
};

using Interval = std::pair<double, double>;

// A number on a topic.
struct Place {
  std::string where;  // location in the mapping, for messages: sensors[0] (goal x)
  std::string topic;
  std::string type;   // short form: geometry_msgs/Twist
  std::string field;  // empty if the mapping names none
};

struct SensorMapping {
  Place place;  // without a topic if the value has another source
  // sensor = clip(value * scale + offset), in binary64, then rounded to binary32.
  double scale = 1;
  double offset = 0;
  std::optional<Interval> clip;
  std::optional<double> infinite;     // the value if nothing is in range; default: the largest range
  std::optional<Interval> sector;     // of a laser scan, in degrees, counter-clockwise from the front
  bool mean = false;                  // use the mean of the ranges in the sector, not the smallest
  double timeout = 0;                 // s
  bool random = false;                // a new number from 0 to 1 in each cycle
  std::optional<std::uint64_t> seed;  // of these numbers; default: a different one at each start
  std::optional<double> constant;     // the value in every cycle, for a sensor that the robot lacks
};

struct ActuatorMapping {
  Place place;
  std::vector<std::pair<std::size_t, double>> terms;  // actuators and their weights, in the controller's order
  // value = limits(sum of weight * actuator, times scale + offset), in binary64.
  double scale = 1;
  double offset = 0;
  std::optional<Interval> limits;
};

struct Mapping {
  double rate = 0;  // control cycles per second
  bool reset_after_silence = false;
  std::vector<SensorMapping> sensors;      // in the controller's order
  std::vector<ActuatorMapping> actuators;  // in the controller's order, by their first term
};

// Reads the content of mapping.yaml. Throws MappingError.
Mapping read_mapping(const Value& value, const std::vector<std::string>& sensors,
                     const std::vector<std::string>& actuators);

// Returns the short form of a type: geometry_msgs/Twist for geometry_msgs/msg/Twist.
std::string short_type(const std::string& name);

// Returns "a, b or c".
std::string choice(const std::vector<std::string>& words);
