// @mark@; changes here are lost.
// The exported controller on a robot, whichever ROS it has.
#pragma once

#include <chrono>
#include <memory>
#include <string>
#include <vector>

#include "graph.hpp"
#include "mapping.hpp"
#include "topics.hpp"

class Control {
 public:
  // Subscribes and advertises. Throws MappingError.
  Control(Graph& graph, Mapping mapping);

  double rate() const { return mapping_.rate; }

  // One control cycle: a command is published, zeros where a sensor is silent.
  void cycle();

  // Stops the robot.
  void stop() { outputs_.stop(); }

  // Begins an episode.
  void reset();

  // To be called again and again outside of cycles. Stops the robot while the clock of a simulation stands still, for
  // there are no cycles then. Throws MappingError for a topic that others use with another type: they become known only
  // after a while.
  void look();

 private:
  using Clock = std::chrono::steady_clock;

  void watch(Clock::time_point now);
  void stopped(const Missing& missing);
  void show();

  Graph& graph_;
  Mapping mapping_;
  Inputs inputs_;
  Outputs outputs_;
  std::shared_ptr<Publisher<messages::Float32MultiArray>> steps_;
  std::vector<float> actuators_;
  bool refused_ = false;
  bool stopped_ = true;
  bool begun_ = false;
  std::string reason_;  // that was said last since the controller ran; empty while it runs
  Clock::time_point said_;
  Clock::time_point looked_;
  // Of the clock that cycles follow.
  double seen_ = -1;
  Clock::time_point moved_;
  Clock::time_point halted_;
  bool halts_ = false;
};

// The mapping for the exported controller, with topics by their full names. Throws MappingError.
Mapping resolved(Graph& graph, const Value& value);
