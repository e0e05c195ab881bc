// A server that calls a simulation.
#pragma once

#include <swarmwright/simulation.hpp>

#include <chrono>
#include <functional>
#include <memory>
#include <stdexcept>
#include <utility>
#include <vector>

namespace swarmwright {

/// A server that is connected to the broker: what all kinds of servers can do.
class RunningServer {
 public:
  RunningServer(const RunningServer&) = delete;
  RunningServer& operator=(const RunningServer&) = delete;
  RunningServer(RunningServer&&) = delete;
  RunningServer& operator=(RunningServer&&) = delete;

  /// Serves until it is stopped, then disconnects.
  void run() {
    detail::check(swarmwright_server_run(server_));
    listener_->rethrow();
  }

  /// For programs with a main loop: waits for events for at most `patience` and handles them, which calls the
  /// simulation. A server that is not polled for 45 s loses its connection, until it is polled again.
  void poll(std::chrono::duration<double> patience = std::chrono::seconds(0)) {
    detail::check(swarmwright_server_poll(server_, patience.count()));
    listener_->rethrow();
  }

  /// Makes run() return within 0.1 s after the simulation has returned. May be called from any thread, from the
  /// simulation and from signal handlers.
  void stop() noexcept { swarmwright_server_stop(server_); }

  /// For the C interface.
  const swarmwright_server* handle() const noexcept { return server_; }

 protected:
  explicit RunningServer(const Options& options) : listener_(std::make_unique<detail::Listener>(options.notice)) {}

  /// To be called by the destructors of the kinds of servers, before what their functions use is gone.
  ~RunningServer() { close(); }

  /// Gives up what is under way, removes the presence, disconnects, and waits for an episode in another thread to end.
  void close() noexcept { swarmwright_server_close(std::exchange(server_, nullptr)); }

  /// Connects: `call` opens the server with the options and a place for it.
  template <class Call>
  void open(const Options& options, Call&& call) {
    const swarmwright_options plain = listener_->plain(options);
    detail::check(call(&plain, &server_));
    listener_->stops(server_);
  }

 private:
  std::unique_ptr<detail::Listener> listener_;
  swarmwright_server* server_ = nullptr;
};

/// Offers a simulation to optimization tools, with all modes and messages of the protocol.
///
/// Throws std::invalid_argument for options that are not valid, Error if the broker does not answer or refuses access,
/// or the id is taken.
class Server : public RunningServer {
 public:
  /// Makes a simulation.
  using Factory = std::function<std::unique_ptr<Simulation>()>;

  /// Offers simulations of one kind; one is made for each episode that runs in parallel.
  explicit Server(Factory factory, const Options& options = {})
      : RunningServer(options), context_(std::make_unique<Context>(std::move(factory))) {
    context_->first = context_->make();
    offer(options, false);
  }

  /// Offers a simulation of which there can be only one, as when it drives another program. It must outlive the server.
  explicit Server(Simulation& only, const Options& options = {})
      : RunningServer(options), context_(std::make_unique<Context>(Factory())) {
    context_->first = std::make_unique<detail::Hosted>(only);
    offer(options, true);
  }

  /// A server whose factory makes objects of type T.
  template <class T>
  static Server offering(const Options& options = {}) {
    return Server([] { return std::make_unique<T>(); }, options);
  }

  Server(const Server&) = delete;
  Server& operator=(const Server&) = delete;
  Server(Server&&) = delete;
  Server& operator=(Server&&) = delete;

  ~Server() { close(); }

 private:
  struct Context {
    explicit Context(Factory maker) : factory(std::move(maker)) {}

    std::unique_ptr<detail::Hosted> make() const {
      std::unique_ptr<Simulation> simulation = factory();
      if (!simulation) {
        throw std::invalid_argument("the factory of simulations returned a null pointer");
      }
      return std::make_unique<detail::Hosted>(std::move(simulation));
    }

    Factory factory;
    /// Made for its description; the first to be used.
    std::unique_ptr<detail::Hosted> first;
  };

  static swarmwright_status create(void* context, void** object) noexcept {
    const detail::Turn turn(context);
    return detail::guarded([&] {
      auto& self = *static_cast<Context*>(context);
      std::unique_ptr<detail::Hosted> hosted = self.first ? std::move(self.first) : self.make();
      const detail::Turn handed_over(hosted.get());
      *object = hosted.release();
    });
  }

  void offer(const Options& options, bool only_one) {
    std::vector<swarmwright_metric> metrics;
    const Description offers = context_->first->offers;
    const swarmwright_description description = detail::plain(offers, metrics);
    swarmwright_simulation functions = detail::functions();
    functions.context = context_.get();
    functions.only_one = only_one ? 1 : 0;
    functions.create = &Server::create;
    if (!offers.scenes) {
      functions.scene = nullptr;
    }
    open(options, [&](const swarmwright_options* plain, swarmwright_server** server) {
      return swarmwright_server_open(plain, &description, &functions, server);
    });
  }

  std::unique_ptr<Context> context_;
};

}  // namespace swarmwright
