// Gazebo's library in this process: started once, with a master of its own, and used by one thread at a time.
#pragma once

#include "user_file.hpp"
#include "user_model.hpp"

#include <mutex>
#include <optional>
#include <stdexcept>
#include <string>

namespace swarmwright::gazebo {

/// Gazebo cannot do what was asked of it.
class GazeboError : public std::runtime_error {
 public:
  using std::runtime_error::runtime_error;
};

/// How Gazebo is started and how robots are moved in it; the same for the whole process.
struct Settings {
  /// Where Gazebo's master listens on the loopback interface, for tools such as gzclient; 0 for any free port.
  int port = 0;
  /// Seconds of a step of the physics engine, at most; a tick of the arena is divided into equal steps. 0: that of the
  /// user's world, else 0.0025 with a model of the user and 0.005 without.
  double step = 0;
  /// Robots with two wheels: motors turn the wheels, which roll on the ground. false: the body gets the velocity.
  bool wheels = true;
  /// Proximity rays are those of Gazebo's sensors. false: they are computed from the poses.
  bool rays = true;
  /// File that gets the description of each world that is made; empty for none.
  std::string save_world = {};
  /// The world of the user in which missions take place; none: they are on an empty floor.
  std::optional<UserWorld> world = {};
  /// The walls of missions stand in the user's world, too.
  bool walls = true;
  /// The model of the user that all robots are; none: they are made from what the mission says of them.
  std::optional<UserModel> model = {};
};

/// The settings; to be changed before Gazebo is used for the first time.
Settings& settings();

/// Access to Gazebo, which is started by the first one. Throws GazeboError if it cannot be started: the port is taken.
class Access {
 public:
  Access();

 private:
  std::unique_lock<std::recursive_mutex> lock_;
};

/// Reads a world for the settings. Models are searched beside the file, in its folder models, in GAZEBO_MODEL_PATH and
/// where Gazebo has its own. Throws GazeboError if it cannot be used.
UserWorld user_world(const std::string& path);

/// Reads a model of the user, with the same search.
UserFile user_file(const std::string& path);

}  // namespace swarmwright::gazebo
