// Models of robots of the user: what their files say, measured in Gazebo.
#pragma once

#include <swarmwright/physics.hpp>

#include "user_file.hpp"

#include <sdf/sdf.hh>

#include <ignition/math/Pose3.hh>
#include <ignition/math/Vector3.hh>

#include <string>
#include <utility>
#include <vector>

namespace swarmwright::gazebo {

/// A wheel of a model.
struct UserWheel {
  std::string joint;
  /// Where it is, to the left of the model's origin, and its radius; metres.
  double left = 0;
  double radius = 0;
  /// 1 if the joint turns forward with positive speeds, -1 if backward.
  double forward = 1;
  /// Limits of the joint: m/s at the rim, Nm; infinite where the file has none.
  double top_speed = 0;
  double torque = 0;
};

/// A ray of a sensor, in the frame of the model: where it begins, and a vector of length 1.
struct UserRay {
  ignition::math::Vector3d origin;
  ignition::math::Vector3d along;
};

/// A model of a robot.
struct UserModel {
  std::string path;
  UserFile file;
  UserWheel left;
  UserWheel right;
  double mass = 0;
  /// How high the model's origin is above the ground on which it stands, metres.
  double lift = 0;
  /// The link that has the wheels, and where it is in the model.
  std::string link;
  ignition::math::Pose3d link_at;
  /// The sensor whose rays are those of the mission's robots; empty for rays as the mission has them.
  std::string sensor;
  std::vector<UserRay> rays;
  /// How far they reach, metres.
  double reach = 0;

  /// The element <model>, without plug-ins and sensors.
  sdf::ElementPtr model() const;
};

/// What the user says of a model.
struct ModelChoice {
  std::string path;
  std::string left;
  std::string right;
  std::string sensor;
};

/// A text in quotation marks.
std::string in_quotes(const std::string& text);

/// Reads a model and measures it. Throws GazeboError, which names the file and what in it, if it cannot be used.
UserModel user_model(const ModelChoice& choice);

/// Throws ParameterError, which names file and element, if a robot of a mission is not what the model is: without two
/// wheels, with wheels elsewhere, faster than them, or with rays that the sensor does not have.
void check_model(const UserModel& user, const RobotModel& model);

/// Where the rays of a mission's robot begin and end, in the frame of the model's link, for a world whose rays have
/// this height above the ground.
std::vector<std::pair<ignition::math::Vector3d, ignition::math::Vector3d>> aims_of(const UserModel& user,
                                                                                   const RobotModel& model,
                                                                                   double height);

}  // namespace swarmwright::gazebo
