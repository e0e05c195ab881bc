// What Stage's own loop takes: robots with rangers of 24 beams and a controller of their own, between four walls. Steps
// per second:
//
//   stage-bare ROBOTS TICKS

#include <stage.hh>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <iostream>
#include <sstream>
#include <string>
#include <thread>
#include <utility>
#include <vector>

namespace {

std::string world_file(int robots) {
  const double side = 3 * std::sqrt(std::max(robots, 10) / 10.0);
  std::ostringstream text;
  text
      << "resolution 0.02\ninterval_sim 100\nmodel( size [ " << side << ' ' << side
      << " 0.5 ] block( points 4 point[0] [ 0 0 ] point[1] [ 4 0 ] point[2] [ 4 4 ] point[3] [ 0 4 ] z [ 0 0.5 ] ) )\n";
  const int row = static_cast<int>(std::ceil(std::sqrt(robots)));
  for (int i = 0; i < robots; ++i) {
    text << "position( name \"r" << i << "\" size [ 0.17 0.17 0.2 ] drive \"diff\" pose [ "
         << side * ((i % row + 0.5) / row - 0.5) << ' ' << side * ((i / row + 0.5) / row - 0.5) << " 0 "
         << 137 * i % 360 << " ] velocity_bounds [ -1 1 0 0 0 0 -180 180 ] "
         << "ranger( sensor( range [ 0 1 ] fov 345 samples 24 ) ) )\n";
  }
  return text.str();
}

/// Drives ahead, and turns away from what is near.
void drive(Stg::ModelPosition& robot, const Stg::ModelRanger& ranger) {
  double left = 0;
  double right = 0;
  const Stg::ModelRanger::Sensor& sensor = ranger.GetSensors().front();
  for (std::size_t i = 0; i < sensor.ranges.size(); ++i) {
    (i < sensor.ranges.size() / 2 ? right : left) += 1 - sensor.ranges[i];
  }
  robot.SetSpeed(0.3 * std::tanh(1 - 0.2 * (left + right)), 0, 2 * std::tanh(right - left + 0.1));
}

}  // namespace

int main(int count, char** values) {
  if (count != 3) {
    std::cerr << "usage: stage-bare ROBOTS TICKS" << std::endl;
    return 2;
  }
  int none = 1;
  Stg::Init(&none, &values);
  Stg::World world("bare");
  const int robots = std::atoi(values[1]);
  std::istringstream file(world_file(robots));
  if (!world.Load(file, std::string())) {
    return 1;
  }
  // Stage waits for ever if its threads are not ready at the first update.
  std::this_thread::sleep_for(std::chrono::milliseconds(200));
  std::vector<std::pair<Stg::ModelPosition*, Stg::ModelRanger*>> all;
  for (int i = 0; i < robots; ++i) {
    auto* robot = dynamic_cast<Stg::ModelPosition*>(world.GetModel("r" + std::to_string(i)));
    auto* ranger = dynamic_cast<Stg::ModelRanger*>(robot->GetChildren().front());
    robot->Subscribe();
    ranger->Subscribe();
    all.emplace_back(robot, ranger);
  }
  const int ticks = std::atoi(values[2]);
  const auto start = std::chrono::steady_clock::now();
  for (int i = 0; i < ticks; ++i) {
    world.Update();
    for (const auto& [robot, ranger] : all) {
      drive(*robot, *ranger);
    }
  }
  const std::chrono::duration<double> took = std::chrono::steady_clock::now() - start;
  std::printf("%.1f\n", ticks / took.count());
  std::fflush(nullptr);
  std::_Exit(0);
}
