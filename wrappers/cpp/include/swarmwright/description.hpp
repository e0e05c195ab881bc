// The description of a simulation, and the options of a server.
#pragma once

#include <swarmwright/swarmwright.h>

#include <chrono>
#include <cstdint>
#include <cstdlib>
#include <exception>
#include <functional>
#include <iostream>
#include <string>
#include <utility>
#include <vector>

namespace swarmwright {

/// A quantity that a simulation measures in an episode besides the fitness.
struct Metric {
  /// A letter or _, then letters, digits and _; not "fitness".
  std::string name;
  /// agents, steps, metres, ...
  std::string unit = {};
  /// Meaning, in a sentence.
  std::string description = {};
};

/// How far two evaluations of one episode with one controller agree, on any server.
enum class Determinism {
  /// Not declared.
  undeclared = SWARMWRIGHT_UNDECLARED,
  /// To the bit: results depend on parameters, seed and actuators only.
  bitwise = SWARMWRIGHT_BITWISE,
  /// Within a tolerance.
  statistical = SWARMWRIGHT_STATISTICAL,
  /// Not at all.
  none = SWARMWRIGHT_NONE,
};

/// The properties of a simulation, which do not change.
struct Description {
  /// Its name in experiment files.
  std::string title;
  /// Sensor values of an agent, at least 1.
  std::uint32_t sensors = 0;
  /// Actuator values of an agent, at least 1.
  std::uint32_t actuators = 0;
  /// Spatial dimensions.
  std::uint32_t dimensions = 2;
  /// Largest number of agents; 0 for no limit.
  std::uint32_t max_agents = 0;
  /// The metrics, in the order of Simulation::metrics().
  std::vector<Metric> metrics = {};
  Determinism determinism = Determinism::undeclared;
  /// For statistical determinism: how far fitness and metrics may differ, relative to the larger one, absolute below
  /// 1.
  double tolerance = 0;
  /// Whether Simulation::scene says what episodes look like.
  bool scenes = false;
};

/// What a notice is about.
enum class Notice {
  /// The server is free.
  ready = SWARMWRIGHT_NOTICE_READY,
  /// An optimization tool has it.
  busy = SWARMWRIGHT_NOTICE_BUSY,
  /// A warning for the operator.
  warning = SWARMWRIGHT_NOTICE_WARNING,
  /// The connection to the broker is lost; the server reconnects.
  lost = SWARMWRIGHT_NOTICE_LOST,
};

namespace detail {

/// A variable of the environment; empty if it is not set.
inline std::string variable(const char* name) {
  const char* value = std::getenv(name);
  return value == nullptr ? std::string() : std::string(value);
}

}  // namespace detail

/// Options of a server. The user name and password come from the environment (SWARMWRIGHT_USERNAME, ...), unless the
/// broker is one that the same user runs on this machine.
struct Options {
  /// mqtt://, mqtts://, ws://, wss:// or unix:///PATH; empty for the environment's SWARMWRIGHT_BROKER, else
  /// mqtt://localhost:1883.
  std::string broker = {};
  /// The server's id, from 0, unique on the broker.
  std::uint64_t id = 1;
  /// Prefix of all topics: that of the environment, SWARMWRIGHT_PREFIX, unless another one is assigned; empty for none.
  std::string prefix = detail::variable("SWARMWRIGHT_PREFIX");
  /// How long a step waits for actuators before it is given up.
  std::chrono::duration<double> step_timeout = std::chrono::seconds(60);
  /// Threads of an offloaded evaluation, each with another simulation; 0 for one per processor.
  std::uint32_t threads = 1;
  /// Receives messages for the operator; standard error by default. Its exceptions are rethrown by run() or poll().
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

/// Passes notices on, and keeps exceptions of the listener until they can be rethrown.
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

  /// The server that is stopped when the listener throws.
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
