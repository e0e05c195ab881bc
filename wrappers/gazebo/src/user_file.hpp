// Files of the user: worlds and models, checked before Gazebo gets them.
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
  std::string text;
  /// Whether nothing in it has a course of its own: plug-ins, actors.
  bool repeatable = true;
  /// What the library says of it besides.
  std::vector<std::string> warnings;

  /// The element <world>, with what it includes, in the version of SDF that the library writes; read anew: copies of
  /// elements have numbers of six digits only.
  sdf::ElementPtr world() const;
};

/// Reads a file with a world. Throws GazeboError, which names the file, the line and the remedy, if it is missing, not
/// SDF, without a world, has a physics engine other than ODE, or names resources that are not found.
UserWorld read_world(const std::string& path, const Find& find);

/// A model in a file of the user, in SDF or URDF.
struct UserFile {
  std::string text;
  std::vector<std::string> warnings;

  /// The element <model>, read anew: copies of elements have numbers of six digits only.
  sdf::ElementPtr model() const;
};

/// Reads a file with a model, in SDF or URDF; what xacro has made of one in xacro is in the file that the environment
/// variable SWARMWRIGHT_MODEL_TEXT names. Throws GazeboError as read_world does.
UserFile read_model(const std::string& path, const Find& find);

/// Parses a description that this program has written.
sdf::ElementPtr parsed_world(const std::string& text);

}  // namespace swarmwright::gazebo
