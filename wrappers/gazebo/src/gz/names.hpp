// The library of Gazebo Fortress: its headers, which have warnings, and short names.
#pragma once

#include <ignition/gazebo/EntityComponentManager.hh>
#include <ignition/gazebo/Server.hh>
#include <ignition/gazebo/ServerConfig.hh>
#include <ignition/gazebo/System.hh>
#include <ignition/gazebo/Types.hh>

#include <ignition/math/Pose3.hh>
#include <ignition/math/Vector3.hh>

namespace swarmwright::gazebo {

namespace sim = ignition::gazebo;
namespace components = ignition::gazebo::components;
using Placement = ignition::math::Pose3d;
using Vector = ignition::math::Vector3d;

}  // namespace swarmwright::gazebo
