// For simulators that have a main loop, which polls for work.
#pragma once

#include <swarmwright/description.hpp>
#include <swarmwright/error.hpp>
#include <swarmwright/parameters.hpp>
#include <swarmwright/span.hpp>

#include <chrono>
#include <cstdint>
#include <memory>
#include <optional>
#include <stdexcept>
#include <string>
#include <utility>
#include <vector>

namespace swarmwright {

/// Offers a simulator that has a main loop, as plug-ins of simulators do. The server runs in another thread; the only
/// callback are notices, during poll().
///
///     switch (plugin.poll()) {            // once a tick, or with a time to wait
///       case Plugin::Event::reset:        // go to the start with plugin.parameters(), then sense()
///       case Plugin::Event::step:         // apply plugin.actuators(), then sense() or finish()
///       case Plugin::Event::abandoned:    // the episode was given up
///       case Plugin::Event::nothing:      // no episode, or the actuators have not come yet
///     }
///
/// Used by one thread at a time. Constructing throws as Server does; the other methods throw std::invalid_argument
/// if they are called in the wrong order.
class Plugin {
 public:
  /// The next task.
  enum class Event {
    nothing = SWARMWRIGHT_NOTHING,
    /// An episode is to begin. Answer with sense, finish, refuse or fail. If another one was under way, it was given
    /// up.
    reset = SWARMWRIGHT_RESET,
    /// A step with actuators() for the agents that sensed. Answer with sense, finish or fail, any number of ticks
    /// later.
    step = SWARMWRIGHT_STEP,
    /// The episode was given up.
    abandoned = SWARMWRIGHT_ABANDONED,
  };

  explicit Plugin(const Description& offers, const Options& options = {})
      : offers_(offers), listener_(std::make_unique<detail::Listener>(options.notice)) {
    std::vector<swarmwright_metric> metrics;
    const swarmwright_description description = detail::plain(offers_, metrics);
    const swarmwright_options plain = listener_->plain(options);
    detail::check(swarmwright_plugin_open(&plain, &description, &plugin_));
  }

  Plugin(const Plugin&) = delete;
  Plugin& operator=(const Plugin&) = delete;
  Plugin(Plugin&&) = delete;
  Plugin& operator=(Plugin&&) = delete;

  /// Gives up what is under way, removes the presence and disconnects.
  ~Plugin() { swarmwright_plugin_close(plugin_); }

  /// The next task; waits for at most `patience` until there is one. Does not wait while an answer is due.
  Event poll(std::chrono::duration<double> patience = std::chrono::seconds(0)) {
    parameters_.reset();
    event_ = SWARMWRIGHT_EVENT;
    detail::check(swarmwright_plugin_poll(plugin_, patience.count(), &event_));
    if (event_.parameters != nullptr) {
      parameters_.emplace(event_.parameters);
    }
    listener_->rethrow();
    return static_cast<Event>(event_.kind);
  }

  /// The parameters of the last reset that poll() returned, valid until its next call.
  const Parameters& parameters() const { return parameters_.value(); }

  /// The seed of that reset: the parameter "seed", different in each of several episodes, 0 by default.
  std::uint64_t seed() const noexcept { return event_.seed; }

  /// The actuators of the last step that poll() returned, valid until its next call: a row for each agent that sensed.
  Span<const float> actuators() const noexcept { return {event_.actuators, event_.count}; }

  /// Answers a reset or a step: the agents that act next, ascending from 0, and their sensors, a row for each. No
  /// agents: the simulator steers them itself, and the next task is a step without actuators.
  void sense(Span<const std::uint32_t> agents, Span<const float> sensors) {
    if (sensors.size() != agents.size() * offers_.sensors) {
      throw std::invalid_argument(std::to_string(sensors.size()) + " sensors for " + std::to_string(agents.size()) +
                                  " agents, expected " + std::to_string(offers_.sensors) + " for each");
    }
    detail::check(swarmwright_plugin_sense(plugin_, agents.data(), agents.size(), sensors.data()));
  }

  /// Answers a reset or a step: the episode has ended. As many metrics as the description has.
  void finish(double fitness, Span<const double> metrics = {}) {
    if (metrics.size() != offers_.metrics.size()) {
      throw std::invalid_argument(std::to_string(metrics.size()) + " metrics, but the description has " +
                                  std::to_string(offers_.metrics.size()) + " names");
    }
    detail::check(swarmwright_plugin_finish(plugin_, fitness, metrics.data()));
  }

  /// Answers a reset: a parameter cannot be used.
  void refuse(const ParameterError& error) {
    detail::check(swarmwright_plugin_refuse(plugin_, error.name().c_str(), error.reason().c_str()));
  }

  /// Answers a reset or a step: the episode cannot go on.
  void fail(const std::string& reason) { detail::check(swarmwright_plugin_fail(plugin_, reason.c_str())); }

  /// Runs code that answers a reset or a step, and answers with its exception if it throws one: a ParameterError
  /// refuses, any other fails the episode with its type and what().
  template <class Work>
  void answer(Work&& work) {
    try {
      std::forward<Work>(work)();
    } catch (const ParameterError& error) {
      refuse(error);
    } catch (...) {
      fail(detail::words_of_current_exception());
    }
  }

 private:
  Description offers_;
  std::unique_ptr<detail::Listener> listener_;
  swarmwright_plugin* plugin_ = nullptr;
  swarmwright_event event_ = SWARMWRIGHT_EVENT;
  std::optional<Parameters> parameters_;
};

}  // namespace swarmwright
