// The base class of simulations, and its calls by the C interface.
#pragma once

#include <swarmwright/description.hpp>
#include <swarmwright/error.hpp>
#include <swarmwright/parameters.hpp>
#include <swarmwright/scene.hpp>
#include <swarmwright/span.hpp>

#include <algorithm>
#include <chrono>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <memory>
#include <stdexcept>
#include <string>
#include <utility>
#include <vector>

// The wrapper moves simulations between threads under locks that ThreadSanitizer cannot see.
#if defined(__SANITIZE_THREAD__)
#define SWARMWRIGHT_TSAN 1
#elif defined(__has_feature)
#if __has_feature(thread_sanitizer)
#define SWARMWRIGHT_TSAN 1
#endif
#endif
#ifdef SWARMWRIGHT_TSAN
extern "C" void __tsan_acquire(void* address);
extern "C" void __tsan_release(void* address);
#endif

namespace swarmwright {

/// An environment that can be reset and stepped. One object runs one episode after another.
///
/// An episode: reset, then, until it is done, sense for every acting agent and step with their actuators; then fitness
/// and metrics. The same parameters and actuators must give the same sensors and fitness, to the bit.
///
/// An exception ends the episode and is reported to the optimization tool with its type and what(). The server stays
/// usable: the next episode begins with reset. An object is used by one thread at a time, not always the same.
class Simulation {
 public:
  virtual ~Simulation() = default;

  /// The properties of the simulation, which do not change.
  virtual Description description() const = 0;

  /// Goes to the start of an episode. `seed` is the parameter "seed": different in each of several episodes, 0 by
  /// default. Throws ParameterError if a value cannot be used, as the methods of `parameters` do.
  virtual void reset(const Parameters& parameters, std::uint64_t seed) = 0;

  /// The agents whose actuators the next step needs, ascending from 0; none when the episode has ended.
  virtual const std::vector<std::uint32_t>& acting() = 0;

  /// Whether the episode has ended. A simulation that steers its agents itself has no acting agents before: it is
  /// stepped without actuators.
  virtual bool done() { return acting().empty(); }

  /// Writes the sensors of an acting agent: finite numbers, as many as the description says.
  virtual void sense(std::uint32_t agent, Span<float> sensors) = 0;

  /// Makes one step. `actuators`: (acting agents, actuators), row-major, in the order of acting(); each number is in
  /// -1..1.
  virtual void step(Span<const float> actuators) = 0;

  /// Fitness of the episode so far, a finite number; larger is better.
  virtual double fitness() = 0;

  /// Metrics of the episode, in the order of the description, and as many; an experiment can define its fitness from
  /// them.
  virtual std::vector<double> metrics() { return {}; }

  /// Says what the episode looks like, for tools that show it elsewhere; returns how long it is to be seen. Called
  /// where the description has `scenes`.
  virtual std::chrono::milliseconds scene(Scene& /*scene*/) { return std::chrono::milliseconds(250); }

  /// Shows the current state of the episode, if that was asked for; returns how long it stays visible, 0 if there is
  /// nothing to see.
  virtual std::chrono::milliseconds show() { return std::chrono::milliseconds(0); }

 protected:
  Simulation() = default;
  Simulation(const Simulation&) = default;
  Simulation(Simulation&&) = default;
  Simulation& operator=(const Simulation&) = default;
  Simulation& operator=(Simulation&&) = default;
};

namespace detail {

/// For ThreadSanitizer: accesses of this thread to the object happen after earlier ones of other threads.
class Turn {
 public:
  explicit Turn([[maybe_unused]] void* object) noexcept
#ifdef SWARMWRIGHT_TSAN
      : object_(object) {
    __tsan_acquire(object_);
  }
  ~Turn() { __tsan_release(object_); }

 private:
  void* object_;
#else
  {
  }
#endif

 public:
  Turn(const Turn&) = delete;
  Turn& operator=(const Turn&) = delete;
};

/// A simulation as an object of the C interface.
struct Hosted {
  explicit Hosted(Simulation& other) : simulation(&other), offers(other.description()) {}
  explicit Hosted(std::unique_ptr<Simulation> other)
      : owned(std::move(other)), simulation(owned.get()), offers(simulation->description()) {}

  std::unique_ptr<Simulation> owned;
  Simulation* simulation;
  Description offers;
};

/// The metrics of an episode; throws std::logic_error if they are not as many as the description has names.
inline std::vector<double> measured(Hosted& host) {
  std::vector<double> metrics = host.simulation->metrics();
  if (metrics.size() != host.offers.metrics.size()) {
    throw std::logic_error("metrics() gives " + std::to_string(metrics.size()) + " numbers, but the description has " +
                           std::to_string(host.offers.metrics.size()) + " names");
  }
  return metrics;
}

/// Milliseconds in 32 bits.
inline std::uint32_t whole(std::chrono::milliseconds time) {
  const auto longest = std::chrono::milliseconds(std::numeric_limits<std::uint32_t>::max());
  return static_cast<std::uint32_t>(std::clamp(time, std::chrono::milliseconds(0), longest).count());
}

/// Calls a hosted simulation; an exception becomes a status.
template <class Call>
swarmwright_status hosted(void* object, Call&& call) noexcept {
  const Turn turn(object);
  return guarded([&] { call(*static_cast<Hosted*>(object)); });
}

/// The functions of all simulations, except create, which the server sets.
inline swarmwright_simulation functions() noexcept {
  swarmwright_simulation table = {};
  table.size = sizeof(table);
  table.destroy = [](void* object) noexcept {
    const Turn turn(object);
    delete static_cast<Hosted*>(object);
  };
  table.reset = [](void* object, const swarmwright_parameters* handle, std::uint64_t seed) noexcept {
    return hosted(object, [&](Hosted& host) { host.simulation->reset(Parameters(handle), seed); });
  };
  table.acting = [](void* object, const std::uint32_t** agents, std::size_t* count) noexcept {
    return hosted(object, [&](Hosted& host) {
      const std::vector<std::uint32_t>& acting = host.simulation->acting();
      *agents = acting.data();
      *count = acting.size();
    });
  };
  table.done = [](void* object, bool* done) noexcept {
    return hosted(object, [&](Hosted& host) { *done = host.simulation->done(); });
  };
  table.sense = [](void* object, std::uint32_t agent, float* sensors) noexcept {
    return hosted(object, [&](Hosted& host) { host.simulation->sense(agent, {sensors, host.offers.sensors}); });
  };
  table.step = [](void* object, const float* actuators, std::size_t count) noexcept {
    return hosted(object, [&](Hosted& host) { host.simulation->step({actuators, count}); });
  };
  table.fitness = [](void* object, double* fitness) noexcept {
    return hosted(object, [&](Hosted& host) {
      *fitness = host.simulation->fitness();
      // The engine asks for metrics in some modes only: whether an episode fails must not depend on that.
      if (!host.offers.metrics.empty() && host.simulation->done()) {
        measured(host);
      }
    });
  };
  table.metrics = [](void* object, double* metrics) noexcept {
    return hosted(object, [&](Hosted& host) {
      const std::vector<double> numbers = measured(host);
      std::copy(numbers.begin(), numbers.end(), metrics);
    });
  };
  table.scene = [](void* object, swarmwright_scene* scene, std::uint32_t* milliseconds) noexcept {
    return hosted(object, [&](Hosted& host) {
      Scene filled(scene);
      *milliseconds = whole(host.simulation->scene(filled));
    });
  };
  table.show = [](void* object, std::uint32_t* milliseconds) noexcept {
    return hosted(object, [&](Hosted& host) { *milliseconds = whole(host.simulation->show()); });
  };
  return table;
}

}  // namespace detail
}  // namespace swarmwright
