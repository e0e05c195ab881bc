// Gazebo's library alone: as many ticks as it makes in a world that swarmwright-gazebo has saved, with the same steps
// and the same ray sensors; robots drive about with other speeds every second, and their poses are read.
//
//   gazebo-loop WORLD STEPS_OF_A_TICK TICKS [EPISODE]
//
// Prints ticks a second. EPISODE: ticks after which the world is reset.

#include <gazebo/gazebo.hh>
#include <gazebo/physics/physics.hh>
#include <gazebo/sensors/sensors.hh>

#include <chrono>
#include <cstdlib>
#include <iostream>
#include <random>
#include <string>
#include <vector>

int main(int count, char** values) {
  if (count < 4) {
    std::cerr << "usage: gazebo-loop WORLD STEPS_OF_A_TICK TICKS [EPISODE]" << std::endl;
    return 2;
  }
  const unsigned steps = static_cast<unsigned>(std::stoul(values[2]));
  const unsigned ticks = static_cast<unsigned>(std::stoul(values[3]));
  const unsigned episode = count > 4 ? static_cast<unsigned>(std::stoul(values[4])) : ticks;
  gazebo::common::Console::SetQuiet(true);
  if (!gazebo::setupServer(std::vector<std::string>())) {
    return 1;
  }
  const gazebo::physics::WorldPtr world = gazebo::loadWorld(values[1]);
  if (!world) {
    return 1;
  }
  gazebo::sensors::run_once(true);
  std::vector<gazebo::physics::ModelPtr> robots;
  for (const gazebo::physics::ModelPtr& model : world->Models()) {
    if (model->GetName().compare(0, 6, "robot_") == 0) {
      robots.push_back(model);
      for (const gazebo::physics::JointPtr& joint : model->GetJoints()) {
        joint->SetParam("fmax", 0, 0.015);
      }
    }
  }
  const auto put_back = [&] {
    world->Reset();
    for (std::size_t i = 0; i < robots.size(); ++i) {
      // Into the middle, 0.4 m apart.
      const auto column = static_cast<double>(i % 4);
      const auto row = static_cast<double>(i / 4);
      robots[i]->SetWorldPose({0.4 * column - 0.6, 0.4 * row - 0.7, 0, 0, 0, static_cast<double>(i)});
    }
  };
  const gazebo::sensors::Sensor_V sensors = gazebo::sensors::SensorManager::Instance()->GetSensors();
  const std::vector<gazebo::physics::ModelPtr> none;
  std::mt19937 random(1);
  double sum = 0;
  const auto start = std::chrono::steady_clock::now();
  for (unsigned tick = 0; tick < ticks; ++tick) {
    if (tick % episode == 0) {
      put_back();
    }
    for (const gazebo::physics::ModelPtr& robot : tick % 10 == 0 ? robots : none) {
      for (const gazebo::physics::JointPtr& joint : robot->GetJoints()) {
        joint->SetParam("vel", 0, static_cast<double>(random() % 1200) / 100 - 6);
      }
    }
    gazebo::runWorld(world, steps);
    for (const gazebo::sensors::SensorPtr& sensor : sensors) {
      sensor->Update(true);
    }
    for (const gazebo::physics::ModelPtr& robot : robots) {
      sum += robot->WorldPose().Pos().X();
    }
  }
  const std::chrono::duration<double> took = std::chrono::steady_clock::now() - start;
  std::cout << "{\"robots\": " << robots.size() << ", \"sensors\": " << sensors.size()
            << ", \"ticks_per_second\": " << ticks / took.count() << ", \"check\": " << sum << "}" << std::endl;
  std::_Exit(0);
}
