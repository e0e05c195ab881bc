// A whole program that serves a simulation.
#pragma once

#include <swarmwright/server.hpp>

#include <atomic>
#include <charconv>
#include <chrono>
#include <csignal>
#include <cstddef>
#include <cstdint>
#include <exception>
#include <iostream>
#include <memory>
#include <stdexcept>
#include <string>
#include <string_view>
#include <system_error>
#include <utility>

namespace swarmwright {

namespace detail {

/// What signals stop. Signal handlers have nothing else to find it by.
inline std::atomic<const swarmwright_server*> stopped_by_signals{nullptr};
inline volatile std::sig_atomic_t told_to_stop = 0;

extern "C" inline void swarmwright_stop_by_signal(int) {
  told_to_stop = 1;
  swarmwright_server_stop(stopped_by_signals.load());
}

/// Lets signals stop a server as long as this is there.
class StoppedBySignals {
 public:
  explicit StoppedBySignals(Server& server) noexcept {
    stopped_by_signals = server.handle();
    if (told_to_stop != 0) {
      server.stop();
    }
  }
  ~StoppedBySignals() { stopped_by_signals = nullptr; }
  StoppedBySignals(const StoppedBySignals&) = delete;
  StoppedBySignals& operator=(const StoppedBySignals&) = delete;
};

/// A number that fills the text. Throws std::invalid_argument.
template <class Number>
Number number(std::string_view name, const std::string& text) {
  Number value{};
  const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), value);
  if (error != std::errc() || end != text.data() + text.size()) {
    throw std::invalid_argument(std::string(name) + ": \"" + text + "\" is no number that it can be");
  }
  return value;
}

}  // namespace detail

/// How to start a program whose arguments are read by `arguments`.
inline constexpr const char* usage =
    "usage: [--broker URL] [--id NUMBER] [--prefix PREFIX] [--step-timeout SECONDS] [--threads NUMBER]\n"
    "  --broker        mqtt://HOST:PORT, mqtts://, ws:// or wss://; SWARMWRIGHT_BROKER, else mqtt://localhost:1883\n"
    "  --id            the server's id, from 0, its own on the broker; 1 by default\n"
    "  --prefix        what stands before all topics; nothing by default\n"
    "  --step-timeout  after how long a step that misses actuators is given up; 60 by default\n"
    "  --threads       of an offloaded evaluation, 0 for one per processor; 1 by default\n";

/// Options from the arguments of a program. Throws std::invalid_argument if one is unknown, has no value, or none that
/// it can have.
inline Options arguments(int count, const char* const* values) {
  Options options;
  for (int i = 1; i < count; ++i) {
    std::string name = values[i];
    std::string value;
    const std::size_t equals = name.compare(0, 2, "--") == 0 ? name.find('=') : std::string::npos;
    const bool joined = equals != std::string::npos;
    if (joined) {
      value = name.substr(equals + 1);
      name.resize(equals);
    } else if (i + 1 < count) {
      value = values[i + 1];
    }
    std::string* text = name == "--broker" ? &options.broker : name == "--prefix" ? &options.prefix : nullptr;
    const bool number = name == "--id" || name == "--step-timeout" || name == "--threads";
    if (text == nullptr && !number) {
      throw std::invalid_argument(name + ": unknown\n" + usage);
    }
    if (!joined && ++i >= count) {
      throw std::invalid_argument(name + ": expected a value behind it");
    }
    if (text != nullptr) {
      *text = value;
    } else if (name == "--id") {
      options.id = detail::number<std::uint64_t>(name, value);
    } else if (name == "--threads") {
      options.threads = detail::number<std::uint32_t>(name, value);
    } else {
      options.step_timeout = std::chrono::duration<double>(detail::number<double>(name, value));
    }
  }
  return options;
}

/// A whole program: reads its arguments, serves until it is told to end (SIGINT, SIGTERM). Returns its exit status: 0,
/// 1 where no server could be offered, 2 for wrong arguments; then it has said why on standard error.
inline int serve(int count, char** values, Server::Factory factory) {
  for (int i = 1; i < count; ++i) {
    if (std::string_view(values[i]) == "--help") {
      std::cout << usage;
      return 0;
    }
  }
  try {
    const Options options = arguments(count, values);
    // Before the start: who is told to end while starting leaves in order all the same.
    std::signal(SIGINT, detail::swarmwright_stop_by_signal);
    std::signal(SIGTERM, detail::swarmwright_stop_by_signal);
    Server server(std::move(factory), options);
    const detail::StoppedBySignals stopped(server);
    server.run();
    return 0;
  } catch (const std::invalid_argument& error) {
    std::cerr << "error: " << error.what() << std::endl;
    return 2;
  } catch (const std::exception& error) {
    std::cerr << "error: " << error.what() << std::endl;
    return 1;
  }
}

/// As above, of simulations of one kind.
template <class T>
int serve(int count, char** values) {
  return serve(count, values, [] { return std::make_unique<T>(); });
}

}  // namespace swarmwright
