// @mark@; changes here are lost.
#include "control.hpp"

#include <sstream>
#include <utility>

#include "exported.h"

namespace {

constexpr std::chrono::seconds kStill(2);
constexpr std::chrono::milliseconds kRepeat(500);
constexpr std::chrono::seconds kSayEvery(10);
constexpr std::chrono::seconds kSayChange(1);

void resolve(Graph& graph, Place& place) {
  try {
    place.topic = graph.resolve(place.topic);
  } catch (const std::exception& error) {
    throw MappingError(place.where + ": topic '" + place.topic + "': " + error.what());
  }
}

}  // namespace

Mapping resolved(Graph& graph, const Value& value) {
  Mapping mapping = read_mapping(value, {exported_sensor_names, exported_sensor_names + exported_sensors},
                                 {exported_actuator_names, exported_actuator_names + exported_actuators});
  for (SensorMapping& sensor : mapping.sensors) {
    if (!sensor.place.topic.empty()) resolve(graph, sensor.place);
  }
  for (ActuatorMapping& actuator : mapping.actuators) resolve(graph, actuator.place);
  return mapping;
}

Control::Control(Graph& graph, Mapping mapping)
    : graph_(graph),
      mapping_(std::move(mapping)),
      inputs_(graph_, mapping_.sensors),
      outputs_(graph_, mapping_.actuators),
      steps_(graph_.advertise<messages::Float32MultiArray>(graph_.resolve("~/steps"), 1000)),
      actuators_(static_cast<std::size_t>(exported_actuators)),
      moved_(Clock::now()) {
  // In addition to the service: another implementation of DDS in ROS 2 finds topics, but no services.
  graph_.receive_all<messages::Empty>(graph_.resolve("~/reset"), [this](const messages::Empty&) { reset(); });
  exported_reset();
}

void Control::cycle() {
  const Missing missing = inputs_.missing();
  if (!missing.none()) {
    stopped(missing);
    return;
  }
  if (stopped_) {
    std::ostringstream text;
    text << "all sensors are there: the controller runs at " << mapping_.rate << " Hz";
    graph_.info(text.str());
    if (mapping_.reset_after_silence) exported_reset();
    stopped_ = false;
    begun_ = true;
    reason_.clear();
  }
  inputs_.draw();
  // Inputs are finite, so this is an overflow, or a topic as the source of random numbers.
  if (!exported_step(inputs_.values().data(), actuators_.data())) {
    if (!refused_) {
      graph_.warn(
          "stopped: the controller refuses the step: a node has overflowed (reset it), "
          "or a random number is not from 0 to 1");
    }
    refused_ = true;
    outputs_.stop();
    return;
  }
  refused_ = false;
  outputs_.publish(actuators_);
  show();
}

void Control::reset() {
  exported_reset();
  graph_.info("the controller was reset");
}

void Control::look() {
  const Clock::time_point now = Clock::now();
  watch(now);
  if (begun_ || now - looked_ < std::chrono::seconds(1)) return;
  looked_ = now;
  inputs_.check_types();
  outputs_.check_types();
}

// Cycles follow the clock of a simulation, if any; if that clock stops, only this stops the robot.
void Control::watch(Clock::time_point now) {
  const double seconds = graph_.seconds();
  if (seconds != seen_) {
    if (halts_) graph_.info("/clock goes on");
    seen_ = seconds;
    moved_ = now;
    halts_ = false;
    return;
  }
  if (now - moved_ < kStill || (halts_ && now - halted_ < kRepeat)) return;
  if (!halts_) {
    graph_.warn(seconds > 0 ? "stopped: /clock stands still"
                            : "stopped: nothing comes from /clock, and use_sim_time is set");
  }
  halts_ = true;
  halted_ = now;
  outputs_.stop();
}

// Logs the reason, again if it changes and at intervals; stops the robot in every cycle, because it may subscribe
// later.
void Control::stopped(const Missing& missing) {
  const Clock::time_point now = Clock::now();
  const std::string reason =
      begun_ ? missing.text("stopped", ": nothing comes from ") : missing.text("waiting", " for ");
  const auto since = now - said_;
  if (reason_.empty() || since >= kSayEvery || (reason != reason_ && since >= kSayChange)) {
    said_ = now;
    reason_ = reason;
    if (begun_) {
      graph_.warn(reason);
    } else {
      graph_.info(reason);
    }
  }
  stopped_ = true;
  outputs_.stop();
}

// Publishes sensors and actuators for other nodes: a single row, sensors first.
void Control::show() {
  if (steps_->listeners() == 0) return;
  messages::Float32MultiArray step;
  step.layout.dim.resize(1);
  step.layout.dim[0].label = "sensors, actuators";
  step.layout.dim[0].size = exported_sensors + exported_actuators;
  step.layout.dim[0].stride = exported_sensors + exported_actuators;
  step.data = inputs_.values();
  step.data.insert(step.data.end(), actuators_.begin(), actuators_.end());
  steps_->publish(step);
}
