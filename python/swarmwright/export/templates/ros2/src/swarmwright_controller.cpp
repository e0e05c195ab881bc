// @mark@; changes here are lost.
// Runs the exported controller: sensors from topics, commands to topics, at a rate, see mapping.yaml.
#include <atomic>
#include <chrono>
#include <csignal>
#include <cstdlib>
#include <exception>
#include <memory>
#include <string>
#include <thread>

#include "control.hpp"
#include "graph.hpp"
#include "mapping.hpp"
#include "rclcpp/rclcpp.hpp"
#include "std_srvs/srv/empty.hpp"
#include "yaml.hpp"

namespace {

std::atomic<bool> ended{false};

void end(int) { ended = true; }

void end_on_signals() {
  for (const int number : {SIGINT, SIGTERM}) std::signal(number, end);
  // A closed terminal; nohup ignores it.
  if (std::signal(SIGHUP, end) == SIG_IGN) std::signal(SIGHUP, SIG_IGN);
}

Value mapping(rclcpp::Node& node) {
  const std::string file = node.declare_parameter<std::string>("mapping", "");
  if (file.empty()) {
    throw MappingError("the parameter mapping is missing; controller.launch.py sets it, mapping:=FILE");
  }
  return read_yaml(file);
}

void run(const rclcpp::Node::SharedPtr& node) {
  using Empty = std_srvs::srv::Empty;
  const Value read = mapping(*node);
  Graph graph(node);
  Control control(graph, resolved(graph, read));
  const auto reset = node->create_service<Empty>(
      "~/reset", [&](const std::shared_ptr<Empty::Request>, std::shared_ptr<Empty::Response>) { control.reset(); });
  const std::chrono::duration<double> period(1 / control.rate());
  const auto cycle = [&control] { control.cycle(); };
  rclcpp::TimerBase::SharedPtr timer;
  if (graph.simulated()) {
    timer = rclcpp::create_timer(node, node->get_clock(), rclcpp::Duration::from_seconds(period.count()), cycle);
  } else {
    timer = node->create_wall_timer(period, cycle);
  }
  rclcpp::executors::SingleThreadedExecutor executor;
  executor.add_node(node);
  while (rclcpp::ok() && !ended) {
    executor.spin_once(std::chrono::milliseconds(50));
    control.look();
  }
  if (!rclcpp::ok()) return;
  control.stop();
  std::this_thread::sleep_for(std::chrono::milliseconds(100));  // until the message is sent
}

}  // namespace

int main(int argc, char** argv) {
  rclcpp::init(argc, argv, rclcpp::InitOptions(), rclcpp::SignalHandlerOptions::None);
  end_on_signals();
  const auto node = std::make_shared<rclcpp::Node>("swarmwright_controller");
  int status = EXIT_SUCCESS;
  try {
    run(node);
  } catch (const MappingError& error) {
    RCLCPP_FATAL(node->get_logger(), "%s", error.what());
    status = 2;
  }
  rclcpp::shutdown();
  return status;
}
