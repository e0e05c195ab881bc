// The world of a mission as SDF, Gazebo's format.
#pragma once

#include <swarmwright/physics.hpp>

#include <sdf/sdf.hh>

#include <cstddef>
#include <string>

namespace swarmwright::gazebo {

/// Names of models, and of what is in them.
std::string robot_name(std::size_t robot);
std::string object_name(std::size_t object);
inline constexpr const char* body = "body";
inline constexpr const char* eye = "eye";
inline constexpr const char* left_joint = "left_joint";
inline constexpr const char* right_joint = "right_joint";

/// Whether a robot has wheels in the simulator.
bool has_wheels(const RobotModel& model);
/// Radius of its wheels, metres.
double wheel_radius(const RobotModel& model);
/// Largest torque of the motor of a wheel, Nm: that which gives the robot the acceleration of its model.
double motor_torque(const RobotModel& model);

/// Where rays begin: inside of the body, so that they also see what touches it; metres from its middle.
double ray_origin(const RobotModel& model);
/// Height of the rays above the ground, metres: everything in the world is taller.
double ray_height(const World& world);

/// Steps of Gazebo in a tick.
unsigned steps_in_tick(const World& world);

/// Whether a name is that of a robot, an object or a wall of a mission.
bool is_of_mission(const std::string& name);

/// What tells the world of a mission from those of others, in SDF.
std::string mission_text(const World& world);

/// The world with its walls, robots and objects, which stand in a row outside of the walls: in the user's world, where
/// the settings have one.
sdf::ElementPtr world_element(const World& world, const std::string& name);

}  // namespace swarmwright::gazebo
