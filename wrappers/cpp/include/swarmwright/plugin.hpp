// A simulator that keeps its own loop: nothing calls it, it looks in.
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

/// Offers a simulator that has its own loop, as plug-ins of simulators do. The server has a thread of its own; yours is
/// never called back but for notices, and only while it polls.
///
///     switch (plugin.poll()) {                  // once a tick, or with a time to wait
///       case Plugin::Event::reset:              // go to the start with plugin.parameters(), then plugin.sense(...)
///       case Plugin::Event::step:               // do plugin.actuators(); later plugin.sense(...) or
///       plugin.finish(...) case Plugin::Event::abandoned:          // nobody waits for this episode any more case
///       Plugin::Event::nothing:            // no episode, or what the agents do has not come yet
///     }
///
/// Used by one thread at a time. Constructing throws as Server does; the other methods throw std::invalid_argument
/// where they are called out of turn.
class Plugin {
 public:
  /// What to do.
  enum class Event {
    nothing = SWARMWRIGHT_NOTHING,
    /// An episode is to begin. Answer with sense, finish, refuse or fail. If another one was under way, it was given
    /// up.
    reset = SWARMWRIGHT_RESET,
    /// Those that sensed are to do actuators(); make a step. Answer with sense, finish or fail, as many ticks later as
    /// you like.
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

  /// Gives up what is under way and leaves the broker in good order.
  ~Plugin() { swarmwright_plugin_close(plugin_); }

  /// What to do next; waits at most so long until there is something. While an answer is due it never waits.
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

  /// Of the reset that poll() told of last, until it is called again.
  const Parameters& parameters() const { return parameters_.value(); }

  /// Of the same reset: the parameter "seed", different in each of several episodes, 0 by default.
  std::uint64_t seed() const noexcept { return event_.seed; }

  /// Of the step that poll() told of last, until it is called again: a row for each agent that sensed, in their order.
  Span<const float> actuators() const noexcept { return {event_.actuators, event_.count}; }

  /// Answers a reset or a step: these agents act next, ascending from 0, and this is what they sense, a row for each.
  /// Nobody: the simulator steers its agents itself, and is told to make a step without actuators.
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

  /// Runs code of yours that answers a reset or a step. What it throws is the answer in its place: a ParameterError
  /// refuses, anything else fails the episode with its type and what().
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
