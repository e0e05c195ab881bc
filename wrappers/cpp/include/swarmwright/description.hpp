// What a simulation says of itself, and how a server of it is to be run.
#pragma once

#include <swarmwright/swarmwright.h>

#include <chrono>
#include <cstdint>
#include <exception>
#include <functional>
#include <iostream>
#include <string>
#include <utility>
#include <vector>

namespace swarmwright {

/// A number that a simulation measures in an episode beside the fitness.
struct Metric {
  /// A letter or _, then letters, digits and _; not "fitness".
  std::string name;
  /// agents, steps, metres, ...
  std::string unit = {};
  /// Meaning, in a sentence.
  std::string description = {};
};

/// How far two evaluations of one episode with one controller agree, wherever they were made.
enum class Determinism {
  /// Nothing is said of it.
  undeclared = SWARMWRIGHT_UNDECLARED,
  /// To the bit: all follows from parameters, seed and actuators.
  bitwise = SWARMWRIGHT_BITWISE,
  /// Within a tolerance.
  statistical = SWARMWRIGHT_STATISTICAL,
  /// Not at all.
  none = SWARMWRIGHT_NONE,
};

/// What a simulation says of itself; the same at any time.
struct Description {
  /// The title that experiments name.
  std::string title;
  /// Numbers that an agent senses, at least 1.
  std::uint32_t sensors = 0;
  /// Numbers that an agent is given to do, at least 1.
  std::uint32_t actuators = 0;
  /// Spatial dimensions.
  std::uint32_t dimensions = 2;
  /// Most agents; 0 for no limit.
  std::uint32_t max_agents = 0;
  /// What is measured, in the order of Simulation::metrics().
  std::vector<Metric> metrics = {};
  Determinism determinism = Determinism::undeclared;
  /// Of a statistical determinism: how far fitness and metrics may differ, as a part of the larger one, absolute
  /// below 1.
  double tolerance = 0;
};

/// What a notice is about.
enum class Notice {
  /// The server is free.
  ready = SWARMWRIGHT_NOTICE_READY,
  /// An optimization tool has it.
  busy = SWARMWRIGHT_NOTICE_BUSY,
  /// Something is not as it should be.
  warning = SWARMWRIGHT_NOTICE_WARNING,
  /// The broker is gone; it is tried again.
  lost = SWARMWRIGHT_NOTICE_LOST,
};

/// How a server is to be run. The account at the broker comes from the environment (SWARMWRIGHT_USERNAME, ...).
struct Options {
  /// mqtt://, mqtts://, ws:// or wss://; empty for the environment's SWARMWRIGHT_BROKER, else mqtt://localhost:1883.
  std::string broker = {};
  /// The server's id, from 0, which no other server on the broker has.
  std::uint64_t id = 1;
  /// What stands before all topics.
  std::string prefix = {};
  /// After how long a step that misses actuators is given up.
  std::chrono::duration<double> step_timeout = std::chrono::seconds(60);
  /// Threads of an offloaded evaluation, each with a simulation of its own; 0 for one per processor.
  std::uint32_t threads = 1;
  /// Is told what the operator should know; on standard error by default. What it throws comes out of run() or poll().
  std::function<void(Notice, const std::string&)> notice = [](Notice, const std::string& text) {
    std::cerr << text << std::endl;
  };
};

namespace detail {

/// A description for the C interface, which points into `from` and `metrics`.
inline swarmwright_description plain(const Description& from, std::vector<swarmwright_metric>& metrics) {
  metrics.clear();
  for (const Metric& metric : from.metrics) {
    metrics.push_back({metric.name.c_str(), metric.unit.c_str(), metric.description.c_str()});
  }
  swarmwright_description description = SWARMWRIGHT_DESCRIPTION;
  description.title = from.title.c_str();
  description.dimensions = from.dimensions;
  description.max_agents = from.max_agents;
  description.sensors = from.sensors;
  description.actuators = from.actuators;
  description.metrics = metrics.data();
  description.metric_count = metrics.size();
  description.determinism = static_cast<std::int32_t>(from.determinism);
  description.tolerance = from.tolerance;
  return description;
}

/// Passes notices on, and keeps what the listener throws until it can be thrown again.
class Listener {
 public:
  explicit Listener(std::function<void(Notice, const std::string&)> call) : call_(std::move(call)) {}

  /// Options for the C interface, which point to this and into `from`.
  swarmwright_options plain(const Options& from) {
    swarmwright_options options = SWARMWRIGHT_OPTIONS;
    options.broker = from.broker.empty() ? nullptr : from.broker.c_str();
    options.id = from.id;
    options.prefix = from.prefix.c_str();
    options.step_timeout = from.step_timeout.count();
    options.threads = from.threads;
    options.notice = call_ ? &Listener::tell : nullptr;
    options.context = this;
    return options;
  }

  /// The server that is not to run on once the listener has thrown.
  void stops(const swarmwright_server* server) noexcept { server_ = server; }

  void rethrow() {
    if (error_) {
      std::rethrow_exception(std::exchange(error_, nullptr));
    }
  }

 private:
  static void tell(void* context, std::int32_t kind, const char* text) noexcept {
    auto& self = *static_cast<Listener*>(context);
    try {
      self.call_(static_cast<Notice>(kind), text);
    } catch (...) {
      self.error_ = std::current_exception();
      swarmwright_server_stop(self.server_);
    }
  }

  std::function<void(Notice, const std::string&)> call_;
  std::exception_ptr error_;
  const swarmwright_server* server_ = nullptr;
};

}  // namespace detail
}  // namespace swarmwright
