#include "controller.hpp"

#include <argos3/plugins/robots/foot-bot/control_interface/ci_footbot_base_ground_sensor.h>
#include <argos3/plugins/robots/foot-bot/control_interface/ci_footbot_light_sensor.h>
#include <argos3/plugins/robots/foot-bot/control_interface/ci_footbot_motor_ground_sensor.h>
#include <argos3/plugins/robots/foot-bot/control_interface/ci_footbot_proximity_sensor.h>
#include <argos3/plugins/robots/generic/control_interface/ci_differential_steering_actuator.h>
#include <argos3/plugins/robots/generic/control_interface/ci_ground_sensor.h>
#include <argos3/plugins/robots/generic/control_interface/ci_light_sensor.h>
#include <argos3/plugins/robots/generic/control_interface/ci_proximity_sensor.h>
#include <argos3/plugins/robots/generic/control_interface/ci_range_and_bearing_sensor.h>
#ifdef SWARMWRIGHT_EPUCK
#include <argos3/plugins/robots/e-puck/control_interface/ci_epuck_ground_sensor.h>
#include <argos3/plugins/robots/e-puck/control_interface/ci_epuck_light_sensor.h>
#include <argos3/plugins/robots/e-puck/control_interface/ci_epuck_proximity_sensor.h>
#include <argos3/plugins/robots/e-puck/control_interface/ci_epuck_range_and_bearing_sensor.h>
#include <argos3/plugins/robots/e-puck/control_interface/ci_epuck_wheels_actuator.h>
#endif

#include <cmath>
#include <cstddef>
#include <string>
#include <vector>

namespace swarmwright {

using argos::CARGoSException;  // for ARGoS's macros

namespace {

constexpr double footbot_speed = 10;
constexpr double quarter = 1.5707963267948966;

float number(double value) { return static_cast<float>(value); }

/// Readings with a value.
template <class Sensor>
void values(Sensor& sensor, std::vector<float>& into) {
  for (const auto& reading : sensor.GetReadings()) {
    into.push_back(number(reading.Value));
  }
}

/// Readings that are numbers.
template <class Sensor>
void numbers(Sensor& sensor, std::vector<float>& into) {
  for (const double reading : sensor.GetReadings()) {
    into.push_back(number(reading));
  }
}

/// Who is heard: their number n as 1 - 2/(1 + e^n), and sums of 1/(1 + range in cm) ahead, left, behind and right.
class Heard {
 public:
  void add(double range, double bearing) {
    ++count_;
    const double turned = std::remainder(bearing, 4 * quarter);
    const auto side = static_cast<std::size_t>(std::lround(turned / quarter) + 4) % 4;
    sides_[side] += 1 / (1 + range);
  }
  void write(std::vector<float>& into) const {
    into.push_back(number(1 - 2 / (1 + std::exp(count_))));
    for (const double side : sides_) {
      into.push_back(number(side));
    }
  }

 private:
  double count_ = 0;
  double sides_[4] = {0, 0, 0, 0};
};

}  // namespace

void ArgosController::Init(argos::TConfigurationNode& tree) {
  find_sensors();
  find_wheels();
  argos::GetNodeAttributeOrDefault(tree, "max_speed", top_speed_, top_speed_);
  if (!(top_speed_ > 0)) {
    THROW_ARGOSEXCEPTION("swarmwright_controller: max_speed: " << top_speed_
                                                               << " found, expected a number above 0, in cm/s");
  }
  ControlStep();
}

void ArgosController::ControlStep() {
  sensed_.clear();
  for (const auto& read : readers_) {
    read(sensed_);
  }
}

void ArgosController::find_sensors() {
  const auto add = [this](const char* name, auto device, auto read) {
    using Pointer = decltype(device);
    if (HasSensor(name)) {
      Pointer sensor = GetSensor<std::remove_pointer_t<Pointer>>(name);
      readers_.emplace_back([sensor, read](std::vector<float>& into) { read(*sensor, into); });
      sensors_ += (sensors_.empty() ? "" : ", ") + std::string(name);
    }
  };
  using argos::CCI_FootBotBaseGroundSensor;
  using argos::CCI_FootBotLightSensor;
  using argos::CCI_FootBotMotorGroundSensor;
  using argos::CCI_FootBotProximitySensor;
  using argos::CCI_GroundSensor;
  using argos::CCI_LightSensor;
  using argos::CCI_ProximitySensor;
  using argos::CCI_RangeAndBearingSensor;
  const auto valued = [](auto& sensor, std::vector<float>& into) { values(sensor, into); };
  const auto plain = [](auto& sensor, std::vector<float>& into) { numbers(sensor, into); };
  add("footbot_proximity", static_cast<CCI_FootBotProximitySensor*>(nullptr), valued);
  add("proximity", static_cast<CCI_ProximitySensor*>(nullptr), plain);
  add("footbot_light", static_cast<CCI_FootBotLightSensor*>(nullptr), valued);
  add("light", static_cast<CCI_LightSensor*>(nullptr), plain);
  add("footbot_motor_ground", static_cast<CCI_FootBotMotorGroundSensor*>(nullptr), valued);
  add("footbot_base_ground", static_cast<CCI_FootBotBaseGroundSensor*>(nullptr), valued);
  add("ground", static_cast<CCI_GroundSensor*>(nullptr), plain);
  add("range_and_bearing", static_cast<CCI_RangeAndBearingSensor*>(nullptr),
      [](auto& sensor, std::vector<float>& into) {
        Heard heard;
        for (const auto& packet : sensor.GetReadings()) {
          heard.add(packet.Range, packet.HorizontalBearing.GetValue());
        }
        heard.write(into);
      });
#ifdef SWARMWRIGHT_EPUCK
  add("epuck_proximity", static_cast<argos::CCI_EPuckProximitySensor*>(nullptr), valued);
  add("epuck_light", static_cast<argos::CCI_EPuckLightSensor*>(nullptr), valued);
  add("epuck_ground", static_cast<argos::CCI_EPuckGroundSensor*>(nullptr), [](auto& sensor, std::vector<float>& into) {
    const auto& readings = sensor.GetReadings();
    into.push_back(number(readings.Left));
    into.push_back(number(readings.Center));
    into.push_back(number(readings.Right));
  });
  add("epuck_range_and_bearing", static_cast<argos::CCI_EPuckRangeAndBearingSensor*>(nullptr),
      [](auto& sensor, std::vector<float>& into) {
        Heard heard;
        for (const auto* packet : sensor.GetPackets()) {
          heard.add(packet->Range, packet->Bearing.GetValue());
        }
        heard.write(into);
      });
#endif
  if (readers_.empty()) {
    THROW_ARGOSEXCEPTION(
        "robot \"" << GetId()
                   << "\" has no sensor that swarmwright_controller reads; it reads footbot_proximity, "
                      "proximity, footbot_light, light, footbot_motor_ground, footbot_base_ground, "
                      "ground, range_and_bearing, and those of the e-puck's plug-in");
  }
}

void ArgosController::find_wheels() {
  if (HasActuator("differential_steering")) {
    auto* wheels = GetActuator<argos::CCI_DifferentialSteeringActuator>("differential_steering");
    wheels_ = [wheels](double left, double right) { wheels->SetLinearVelocity(left, right); };
    top_speed_ = footbot_speed;
    return;
  }
#ifdef SWARMWRIGHT_EPUCK
  if (HasActuator("epuck_wheels")) {
    constexpr double epuck_speed = 12;
    auto* wheels = GetActuator<argos::CCI_EPuckWheelsActuator>("epuck_wheels");
    wheels_ = [wheels](double left, double right) { wheels->SetLinearVelocity(left, right); };
    top_speed_ = epuck_speed;
    return;
  }
#endif
  THROW_ARGOSEXCEPTION("robot \"" << GetId()
                                  << "\" has no wheels for swarmwright_controller; add the actuator "
                                     "differential_steering, or epuck_wheels, to the controller");
}

}  // namespace swarmwright

using argos::CCI_Controller;
using swarmwright::ArgosController;
REGISTER_CONTROLLER(ArgosController, "swarmwright_controller")
