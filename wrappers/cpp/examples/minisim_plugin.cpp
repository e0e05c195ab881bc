// The same server as a plug-in: main() has the place of a simulator's main loop, which calls tick().
//
//   minisim_plugin --broker mqtt://localhost:1883 --id 6

#include "minisim/minisim.hpp"

#include <swarmwright/swarmwright.hpp>

#include <atomic>
#include <chrono>
#include <csignal>
#include <exception>
#include <iostream>
#include <stdexcept>
#include <vector>

namespace {

using swarmwright::Plugin;

/// The plug-in of the simulator.
class MinisimPlugin {
 public:
  explicit MinisimPlugin(const swarmwright::Options& options) : plugin_(world_.description(), options) {}

  /// Called by the simulator in every iteration of its main loop.
  void tick() {
    // A simulator that draws or computes between its ticks would not wait here.
    switch (plugin_.poll(std::chrono::milliseconds(100))) {
      case Plugin::Event::reset:
        plugin_.answer([this] {
          world_.reset(plugin_.parameters(), plugin_.seed());
          report();
        });
        break;
      case Plugin::Event::step:
        plugin_.answer([this] {
          world_.step(plugin_.actuators());
          report();
        });
        break;
      case Plugin::Event::abandoned:
      case Plugin::Event::nothing:
        break;
    }
  }

 private:
  /// Sends the sensors of the agents, or the results of the episode.
  void report() {
    if (world_.done()) {
      plugin_.finish(world_.fitness(), world_.metrics());
      return;
    }
    const std::vector<std::uint32_t>& agents = world_.acting();
    std::vector<float> sensors(agents.size() * width_);
    for (std::size_t i = 0; i < agents.size(); ++i) {
      world_.sense(agents[i], swarmwright::Span<float>(sensors).subspan(i * width_, width_));
    }
    plugin_.sense(agents, sensors);
  }

  minisim::Minisim world_;
  std::size_t width_ = world_.description().sensors;
  Plugin plugin_;
};

std::atomic<bool> told_to_stop{false};

}  // namespace

int main(int count, char** values) {
  std::signal(SIGINT, [](int) { told_to_stop = true; });
  std::signal(SIGTERM, [](int) { told_to_stop = true; });
  try {
    MinisimPlugin plugin(swarmwright::arguments(count, values));
    while (!told_to_stop) {
      plugin.tick();
    }
    return 0;
  } catch (const std::invalid_argument& error) {
    std::cerr << "error: " << error.what() << std::endl;
    return 2;
  } catch (const std::exception& error) {
    std::cerr << "error: " << error.what() << std::endl;
    return 1;
  }
}
