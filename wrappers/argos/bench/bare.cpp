// What ARGoS's own loop takes: foot-bots with proximity sensors and a controller of their own, in an arena of twelve
// walls. Steps per second:
//
//   argos-bare ROBOTS TICKS

#include <argos3/core/control_interface/ci_controller.h>
#include <argos3/core/simulator/loop_functions.h>
#include <argos3/core/simulator/simulator.h>
#include <argos3/core/simulator/space/space.h>
#include <argos3/core/utility/logging/argos_log.h>
#include <argos3/core/utility/plugins/dynamic_loading.h>
#include <argos3/plugins/robots/foot-bot/control_interface/ci_footbot_proximity_sensor.h>
#include <argos3/plugins/robots/generic/control_interface/ci_differential_steering_actuator.h>

#include <chrono>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <iostream>
#include <sstream>

using argos::CARGoSException;

/// Drives ahead, and turns away from what is near.
class Wanderer : public argos::CCI_Controller {
 public:
  void Init(argos::TConfigurationNode&) override {
    wheels_ = GetActuator<argos::CCI_DifferentialSteeringActuator>("differential_steering");
    proximity_ = GetSensor<argos::CCI_FootBotProximitySensor>("footbot_proximity");
  }
  void ControlStep() override {
    double left = 0;
    double right = 0;
    for (const auto& reading : proximity_->GetReadings()) {
      (reading.Angle.GetValue() > 0 ? left : right) += reading.Value;
    }
    wheels_->SetLinearVelocity(30 * std::tanh(1 + left - 2 * right), 30 * std::tanh(1 - left + right));
  }

 private:
  argos::CCI_DifferentialSteeringActuator* wheels_ = nullptr;
  argos::CCI_FootBotProximitySensor* proximity_ = nullptr;
};

using argos::CCI_Controller;
REGISTER_CONTROLLER(Wanderer, "wanderer")

namespace {

std::string experiment(int robots) {
  constexpr double apothem = 1.231;
  constexpr double step = 0.5235987755982988;  // a twelfth of a turn
  std::ostringstream text;
  text << "<argos-configuration><framework><system threads=\"0\"/><experiment length=\"0\" ticks_per_second=\"10\" "
          "random_seed=\"1\"/></framework><controllers><wanderer id=\"w\"><actuators><differential_steering "
          "implementation=\"default\"/></actuators><sensors><footbot_proximity implementation=\"default\" "
          "show_rays=\"false\"/></sensors><params/></wanderer></controllers><arena size=\"10,10,2\">";
  // As large for more robots.
  const double scale = std::sqrt(std::fmax(robots, 20) / 20);
  for (int i = 0; i < 12; ++i) {
    text << "<box id=\"wall" << i << "\" size=\"0.01," << 0.66 * scale << ",0.5\" movable=\"false\"><body position=\""
         << apothem * scale * std::cos(i * step) << ',' << apothem * scale * std::sin(i * step) << ",0\" orientation=\""
         << 30 * i << ",0,0\"/></box>";
  }
  const int side = static_cast<int>(std::ceil(std::sqrt(robots)));
  for (int i = 0; i < robots; ++i) {
    text << "<foot-bot id=\"f" << i << "\"><body position=\"" << 0.3 * (i % side - (side - 1) / 2.0) << ','
         << 0.3 * (i / side - (side - 1) / 2.0) << ",0\" orientation=\"" << 137 * i % 360
         << ",0,0\"/><controller config=\"w\"/></foot-bot>";
  }
  text << "</arena><physics_engines><dynamics2d id=\"dyn2d\"/></physics_engines><media/></argos-configuration>";
  return text.str();
}

}  // namespace

int main(int count, char** values) {
  if (count != 3) {
    std::cerr << "usage: argos-bare ROBOTS TICKS" << std::endl;
    return 2;
  }
  try {
    std::ostringstream output;
    std::streambuf* before = std::cout.rdbuf(output.rdbuf());
    argos::CDynamicLoading::LoadAllLibraries();
    ticpp::Document document;
    document.Parse(experiment(std::atoi(values[1])));
    argos::CSimulator& simulator = argos::CSimulator::GetInstance();
    simulator.Load(document);
    std::cout.rdbuf(before);
    const int ticks = std::atoi(values[2]);
    const auto start = std::chrono::steady_clock::now();
    for (int i = 0; i < ticks; ++i) {
      simulator.UpdateSpace();
    }
    const std::chrono::duration<double> took = std::chrono::steady_clock::now() - start;
    std::printf("%.1f\n", ticks / took.count());
    std::fflush(nullptr);
    std::_Exit(0);
  } catch (const std::exception& error) {
    std::cerr << "error: " << error.what() << std::endl;
    std::_Exit(1);
  }
}
