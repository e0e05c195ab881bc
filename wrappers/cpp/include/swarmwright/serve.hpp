// The main function of a simulation server.
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
#include <locale>
#include <memory>
#include <sstream>
#include <stdexcept>
#include <string>
#include <string_view>
#include <system_error>
#include <type_traits>
#include <utility>

namespace swarmwright {

namespace detail {

/// The server that signals stop; global, since signal handlers have no other access to it.
inline std::atomic<const swarmwright_server*> stopped_by_signals{nullptr};
inline volatile std::sig_atomic_t stop_requested = 0;

extern "C" inline void swarmwright_stop_by_signal(int) {
  stop_requested = 1;
  swarmwright_server_stop(stopped_by_signals.load());
}

/// Lets signals stop a server during the lifetime of this object.
class StoppedBySignals {
 public:
  explicit StoppedBySignals(RunningServer& server) noexcept {
    stopped_by_signals = server.handle();
    if (stop_requested != 0) {
      server.stop();
    }
  }
  ~StoppedBySignals() { stopped_by_signals = nullptr; }
  StoppedBySignals(const StoppedBySignals&) = delete;
  StoppedBySignals& operator=(const StoppedBySignals&) = delete;
};

/// The whole text as a number. Throws std::invalid_argument.
template <class Number>
Number number(std::string_view name, const std::string& text) {
  Number value{};
  bool whole = false;
  if constexpr (std::is_floating_point_v<Number>) {  // g++ 10 has no std::from_chars for it
    std::istringstream read(text);
    read.imbue(std::locale::classic());
    whole = static_cast<bool>(read >> std::noskipws >> value) && read.peek() == std::istringstream::traits_type::eof();
  } else {
    const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), value);
    whole = error == std::errc() && end == text.data() + text.size();
  }
  if (!whole) {
    throw std::invalid_argument(std::string(name) + ": \"" + text + "\" is not a number in its range");
  }
  return value;
}

}  // namespace detail

/// How to start a program whose arguments are read by `arguments`.
inline constexpr const char* usage =
    "usage: [--broker URL] [--id NUMBER] [--prefix PREFIX] [--step-timeout SECONDS] [--threads NUMBER]\n"
    "  --broker        mqtt://HOST:PORT, mqtts://, ws://, wss:// or unix:///PATH;\n"
    "                  SWARMWRIGHT_BROKER, else mqtt://localhost:1883\n"
    "  --id            the server's id, from 0, unique on the broker; 1 by default\n"
    "  --prefix        prefix of all topics, \"\" for none; SWARMWRIGHT_PREFIX, else none\n"
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
      throw std::invalid_argument(name + ": expected a value after it");
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

namespace detail {

/// The main function of a server that `open` makes from options.
template <class Open>
int serve_opened(int count, char** values, Open&& open) {
  for (int i = 1; i < count; ++i) {
    if (std::string_view(values[i]) == "--help") {
      std::cout << usage;
      return 0;
    }
  }
  try {
    const Options options = arguments(count, values);
    // Before the start, so that a program terminated while it starts closes its server, too.
    std::signal(SIGINT, swarmwright_stop_by_signal);
    std::signal(SIGTERM, swarmwright_stop_by_signal);
    const auto server = open(options);
    const StoppedBySignals stopped(*server);
    server->run();
    return 0;
  } catch (const std::invalid_argument& error) {
    std::cerr << "error: " << error.what() << std::endl;
    return 2;
  } catch (const std::exception& error) {
    std::cerr << "error: " << error.what() << std::endl;
    return 1;
  }
}

}  // namespace detail

/// The main function of a server: reads its arguments, serves until it is terminated (SIGINT, SIGTERM). Returns the
/// exit status: 0, 1 if the server could not be started, 2 for wrong arguments, with a message on standard error.
inline int serve(int count, char** values, Server::Factory factory) {
  return detail::serve_opened(
      count, values, [&](const Options& options) { return std::make_unique<Server>(std::move(factory), options); });
}

/// As above, for simulations of one type.
template <class T>
int serve(int count, char** values) {
  return serve(count, values, [] { return std::make_unique<T>(); });
}

}  // namespace swarmwright
