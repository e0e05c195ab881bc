// A swarm of robots in a simulator that keeps its loop, as plug-ins of ARGoS and Stage have it.
#pragma once

#include <swarmwright/description.hpp>
#include <swarmwright/plugin.hpp>
#include <swarmwright/serve.hpp>
#include <swarmwright/span.hpp>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <csignal>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <numeric>
#include <string>
#include <utility>
#include <vector>

namespace swarmwright {

/// Where a robot is: metres, radians.
struct Place {
  double x = 0;
  double y = 0;
  double heading = 0;
};

/// Metrics that can be measured from where robots are.
class PlaceMetrics {
 public:
  static std::vector<Metric> names() {
    return {{"way", "metres", "mean way of the robots"},
            {"distance_to_center", "metres", "mean distance of the robots from their mean, at the end"},
            {"nearest_distance", "metres", "mean distance to the nearest other robot, at the end"},
            {"order", "", "1 where all robots look the same way at the end"}};
  }

  /// At the start of an episode.
  void begin(Span<const Place> robots) {
    robots_.assign(robots.begin(), robots.end());
    way_ = 0;
  }

  /// After each tick.
  void observe(Span<const Place> robots) {
    double sum = 0;
    for (std::size_t i = 0; i < robots.size(); ++i) {
      sum += std::hypot(robots[i].x - robots_[i].x, robots[i].y - robots_[i].y);
    }
    way_ += sum / static_cast<double>(robots.size());
    robots_.assign(robots.begin(), robots.end());
  }

  /// In the order of the names.
  std::vector<double> values() const {
    const auto count = static_cast<double>(robots_.size());
    Place mean;
    double cos = 0;
    double sin = 0;
    for (const Place& robot : robots_) {
      mean.x += robot.x / count;
      mean.y += robot.y / count;
      cos += std::cos(robot.heading) / count;
      sin += std::sin(robot.heading) / count;
    }
    double from_mean = 0;
    double nearest = 0;
    for (const Place& robot : robots_) {
      from_mean += std::hypot(robot.x - mean.x, robot.y - mean.y) / count;
      double least = std::numeric_limits<double>::infinity();
      for (const Place& other : robots_) {
        if (&other != &robot) {
          least = std::min(least, std::hypot(robot.x - other.x, robot.y - other.y));
        }
      }
      nearest += (robots_.size() > 1 ? least : 0) / count;
    }
    return {way_, from_mean, nearest, std::hypot(cos, sin)};
  }

 private:
  std::vector<Place> robots_;
  double way_ = 0;
};

namespace detail {

inline volatile std::sig_atomic_t swarm_stopped = 0;

extern "C" inline void swarmwright_swarm_signal(int) { swarm_stopped = 1; }

}  // namespace detail

/// Episodes of a swarm whose robots all sense and act in every tick. The simulator asks once a tick, after its robots
/// have sensed:
///
///     if (swarm.stopped()) {
///       ...                                       // delete the swarm, and end
///     } else if (!swarm.running()) {
///       if (swarm.rest()) ...                     // go to the start with swarm.parameters() and swarm.seed()
///     } else if (the episode is at its end) {
///       swarm.finish(fitness, metrics)
///     } else if (swarm.act(sensors)) ...          // apply swarm.actuators(), and tick
class Swarm {
 public:
  /// Throws as Plugin does. From now on SIGTERM and SIGINT stop the swarm.
  Swarm(const Description& description, const Options& options, std::uint32_t robots)
      : plugin_(description, options), agents_(robots) {
    std::iota(agents_.begin(), agents_.end(), 0U);
    std::signal(SIGTERM, detail::swarmwright_swarm_signal);
    std::signal(SIGINT, detail::swarmwright_swarm_signal);
  }

  /// Whether the program is to end.
  bool stopped() const noexcept { return detail::swarm_stopped != 0; }

  /// Whether an episode is under way.
  bool running() const noexcept { return running_; }

  /// Waits for an episode, for at most `patience`; whether one is to begin.
  bool rest(std::chrono::duration<double> patience) {
    running_ = again_ || plugin_.poll(patience) == Plugin::Event::reset;
    again_ = false;
    return running_;
  }

  /// Sends what the robots sense, (robots, sensors), and waits for their actuators. False: the episode was given up, or
  /// the swarm is stopped.
  bool act(Span<const float> sensors) {
    plugin_.sense(agents_, sensors);
    while (!stopped()) {
      switch (plugin_.poll(std::chrono::milliseconds(100))) {
        case Plugin::Event::step:
          return true;
        case Plugin::Event::reset:
          again_ = true;
          running_ = false;
          return false;
        case Plugin::Event::abandoned:
          running_ = false;
          return false;
        case Plugin::Event::nothing:
          break;
      }
    }
    return false;
  }

  /// The actuators, (robots, actuators), until the next call.
  Span<const float> actuators() const noexcept { return plugin_.actuators(); }

  /// Of the episode that is to begin, until the next call.
  const Parameters& parameters() const { return plugin_.parameters(); }
  std::uint64_t seed() const noexcept { return plugin_.seed(); }

  /// Runs what begins the episode; its exception refuses or fails it. Whether it has begun.
  template <class Work>
  bool begin(Work&& work) {
    running_ = false;
    plugin_.answer([&] {
      std::forward<Work>(work)();
      running_ = true;
    });
    return running_;
  }

  /// The episode has ended.
  void finish(double fitness, Span<const double> metrics) {
    running_ = false;
    plugin_.finish(fitness, metrics);
  }

  /// The episode cannot go on.
  void fail(const std::string& reason) {
    running_ = false;
    plugin_.fail(reason);
  }

 private:
  Plugin plugin_;
  std::vector<std::uint32_t> agents_;
  bool running_ = false;
  /// An episode came while another one was under way.
  bool again_ = false;
};

}  // namespace swarmwright
