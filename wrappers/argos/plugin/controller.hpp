// The controller of robots that an optimization tool steers.
#pragma once

#include <argos3/core/control_interface/ci_controller.h>

#include <functional>
#include <string>
#include <vector>

namespace swarmwright {

/// Reads the sensors that the experiment gives it, and drives two wheels.
class ArgosController : public argos::CCI_Controller {
 public:
  void Init(argos::TConfigurationNode& tree) override;
  void ControlStep() override;

  /// What it sensed in this tick, or at first zeros.
  const std::vector<float>& sensed() const { return sensed_; }

  /// The sensors in their order, for errors.
  const std::string& sensors() const { return sensors_; }

  /// Speeds of the wheels as a part of the largest one, -1..1.
  void drive(double left, double right) { wheels_(left * top_speed_, right * top_speed_); }

 private:
  void find_sensors();
  void find_wheels();

  std::vector<std::function<void(std::vector<float>&)>> readers_;
  std::vector<float> sensed_;
  std::string sensors_;
  std::function<void(double, double)> wheels_;
  /// cm/s.
  double top_speed_ = 0;
};

}  // namespace swarmwright
