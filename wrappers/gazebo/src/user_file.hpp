// Worlds of the user: files in SDF, checked before Gazebo gets them.
#pragma once

#include <sdf/sdf.hh>

#include <functional>
#include <string>
#include <vector>

namespace swarmwright::gazebo {

/// Where a resource is that a file names, such as "model://box"; empty if it is not found.
using Find = std::function<std::string(const std::string&)>;

/// What is in a world of the user.
struct UserWorld {
  std::string path;
  /// The element <world>, with what it includes, in the version of SDF that the library writes.
  sdf::ElementPtr world;
  /// Whether nothing in it has a course of its own: plug-ins, actors.
  bool repeatable = true;
  /// What the library says of it besides.
  std::vector<std::string> warnings;
};

/// Reads a file with a world. Throws GazeboError, which names the file, the line and the remedy, if it is missing, not
/// SDF, without a world, has a physics engine other than ODE, or names resources that are not found.
UserWorld read_world(const std::string& path, const Find& find);

/// Parses a description that this program has written.
sdf::ElementPtr parsed_world(const std::string& text);

}  // namespace swarmwright::gazebo
