// The library of Gazebo Fortress alone: as many ticks as it makes in a world that swarmwright-gz has saved, with the
// same steps; robots drive about with other speeds every second, and their poses are read.
//
//   gazebo-loop WORLD STEPS_OF_A_TICK TICKS
//
// Prints ticks a second.

#include <ignition/gazebo/EntityComponentManager.hh>
#include <ignition/gazebo/Server.hh>
#include <ignition/gazebo/ServerConfig.hh>
#include <ignition/gazebo/System.hh>
#include <ignition/gazebo/components/Joint.hh>
#include <ignition/gazebo/components/JointType.hh>
#include <ignition/gazebo/components/JointVelocityCmd.hh>
#include <ignition/gazebo/components/Model.hh>
#include <ignition/gazebo/components/Name.hh>
#include <ignition/gazebo/components/Pose.hh>

#include <ignition/common/Console.hh>

#include <algorithm>
#include <chrono>
#include <cstdlib>
#include <iostream>
#include <memory>
#include <random>
#include <string>
#include <utility>
#include <vector>

namespace {

namespace sim = ignition::gazebo;
namespace components = ignition::gazebo::components;

// The interfaces of the library's systems are not deleted through.
#pragma GCC diagnostic push
#pragma GCC diagnostic ignored "-Wnon-virtual-dtor"
/// Turns the wheels before each step, since commands last for one.
class Driver : public sim::System, public sim::ISystemConfigure, public sim::ISystemPreUpdate {
 public:
  void Configure(const sim::Entity& /*entity*/, const std::shared_ptr<const sdf::Element>& /*element*/,
                 sim::EntityComponentManager& all, sim::EventManager& /*events*/) override {
    manager = &all;
    all.Each<components::Joint, components::JointType>(
        [&](const sim::Entity& joint, const components::Joint*, const components::JointType* type) {
          if (type->Data() == sdf::JointType::REVOLUTE) {
            wheels.emplace_back(joint, 0);
          }
          return true;
        });
    all.Each<components::Model, components::Name>(
        [&](const sim::Entity& model, const components::Model*, const components::Name* name) {
          if (name->Data().compare(0, 6, "robot_") == 0) {
            robots.push_back(model);
          }
          return true;
        });
  }
  void PreUpdate(const sim::UpdateInfo& /*info*/, sim::EntityComponentManager& all) override {
    for (const auto& [joint, speed] : wheels) {
      all.SetComponentData<components::JointVelocityCmd>(joint, {speed});
    }
  }

  sim::EntityComponentManager* manager = nullptr;
  std::vector<std::pair<sim::Entity, double>> wheels;
  std::vector<sim::Entity> robots;
};
#pragma GCC diagnostic pop

}  // namespace

int main(int count, char** values) {
  if (count != 4) {
    std::cerr << "usage: gazebo-loop WORLD STEPS_OF_A_TICK TICKS" << std::endl;
    return 2;
  }
  const unsigned steps = static_cast<unsigned>(std::stoul(values[2]));
  const unsigned ticks = static_cast<unsigned>(std::stoul(values[3]));
  ignition::common::Console::SetVerbosity(1);
  sim::ServerConfig config;
  config.SetSdfFile(values[1]);
  sim::Server server(config);
  const auto driver = std::make_shared<Driver>();
  if (!server.AddSystem(driver).value_or(false) || driver->robots.empty()) {
    return 1;
  }
  server.RunOnce(true);
  std::mt19937 random(1);
  double sum = 0;
  const auto start = std::chrono::steady_clock::now();
  for (unsigned tick = 0; tick < ticks; ++tick) {
    for (auto& [joint, speed] : driver->wheels) {
      if (tick % 10 == 0) {
        speed = static_cast<double>(random() % 1200) / 100 - 6;
      }
    }
    server.Run(true, steps, false);
    for (const sim::Entity robot : driver->robots) {
      sum += driver->manager->Component<components::Pose>(robot)->Data().Pos().X();
    }
  }
  const std::chrono::duration<double> took = std::chrono::steady_clock::now() - start;
  std::cout << "{\"robots\": " << driver->robots.size() << ", \"ticks_per_second\": " << ticks / took.count()
            << ", \"check\": " << sum << "}" << std::endl;
  std::_Exit(0);
}
