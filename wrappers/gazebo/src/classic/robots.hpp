// Robots in a world of Gazebo: their places, drives and rays.
#pragma once

#include <swarmwright/physics.hpp>

#include "robot_rays.hpp"
#include "sdf_world.hpp"

#include <gazebo/ode/ode.h>
#include <gazebo/physics/PhysicsTypes.hh>
#include <gazebo/sensors/SensorTypes.hh>

#include <sdf/sdf.hh>

#include <cstddef>
#include <string>
#include <vector>

namespace swarmwright::gazebo {

/// Makes a world.
::gazebo::physics::WorldPtr load(const sdf::ElementPtr& description, const std::string& name);

/// A model of a world. Throws GazeboError if it is not there.
::gazebo::physics::ModelPtr found(const ::gazebo::physics::WorldPtr& world, const std::string& name);

/// Puts a model on the floor, at rest; `lift`: its origin above the floor.
void put(const ::gazebo::physics::ModelPtr& model, const Pose& pose, double lift = 0);

/// Where a model is. Throws GazeboError if it has left the ground.
Pose flat(const ::gazebo::physics::ModelPtr& model, double lift = 0);

/// A robot of a mission.
class Robot {
 public:
  /// Throws GazeboError if Gazebo did not make all of it.
  Robot(const ::gazebo::physics::WorldPtr& world, const World& plan, std::size_t number);

  /// Whether it is moved by velocities of its body, which each step of Gazebo needs anew.
  bool pushed() const { return !left_.joint; }
  void put(const Pose& pose) const { gazebo::put(placed_, pose, lift_); }
  Pose at() const { return flat(placed_, lift_); }
  void drive(const Motion& motion) const;
  /// Writes how far its rays reach.
  void look(Span<float> distances) const;

 private:
  struct Wheel {
    ::gazebo::physics::JointPtr joint;
    double forward = 1;  // -1: the joint turns the other way
    double radius = 0;
  };
  /// A shape of it, and which others it meets.
  struct Part {
    dGeomID geometry;
    unsigned long category;
    unsigned long collides;
  };

  void add_motor(Wheel& wheel, const std::string& joint, double torque) const;
  void add_eye(const std::string& name, const World& plan);

  RobotModel model_;
  ::gazebo::physics::ModelPtr placed_;
  ::gazebo::physics::LinkPtr body_;
  double lift_ = 0;
  double wheel_base_ = 0;
  Wheel left_;  // without a joint: the body gets its velocity
  Wheel right_;
  ::gazebo::sensors::RaySensorPtr eye_;
  RobotRays rays_;
  std::vector<Part> parts_;
};

}  // namespace swarmwright::gazebo
