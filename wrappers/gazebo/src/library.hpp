// What this wrapper needs of a library of Gazebo. A program has one of them: the folder classic has Gazebo 11's.
#pragma once

#include <swarmwright/physics.hpp>

#include "gazebo.hpp"
#include "user_model.hpp"

#include <sdf/sdf.hh>

#include <cstdint>
#include <functional>
#include <memory>
#include <string>

namespace swarmwright::gazebo {

/// What users are told of the library, and what it can do.
struct Traits {
  /// The command of the server, and the title of its missions without --title.
  const char* server;
  const char* title;
  /// Whether it has a master, which listens on a port.
  bool has_master;
  /// Whether proximity rays are sensors of its worlds.
  bool has_ray_sensors;
  /// Whether episodes have the same bits again, in any order and beside others.
  bool bitwise;
  /// The environment variable with folders of models.
  const char* model_path;
  /// The types of <physics> that a world may name, each between blanks.
  const char* engines;
  const char* expected_engine;
  /// The types of sensors whose rays --sensor takes, each between blanks.
  const char* ray_sensors;
  /// Elements of SDF that its worlds need besides.
  const char* world_parts;
};
extern const Traits traits;

/// A world that the library has made of a description in SDF, with the robots and objects of a mission.
class Scene {
 public:
  virtual ~Scene() = default;
  /// Puts all that can move where it begins, at rest. Throws ParameterError if a robot begins in something of the
  /// user's world.
  virtual void start(Span<const Pose> robots, Span<const Pose> objects) = 0;
  /// Makes the steps of one tick of the arena.
  virtual void step(Span<const Motion> motions) = 0;
  /// Throws GazeboError if a robot or an object has left the ground.
  virtual void poses(Span<Pose> robots, Span<Pose> objects) = 0;
  /// Writes how far the rays of a robot reach.
  virtual void rays(std::uint32_t robot, Span<float> distances) = 0;
};

/// Starts the library in this process; called once, before all else. Throws GazeboError if it cannot be started.
void start_library();

/// Whether a plug-in that a world names has no effect of its own: this wrapper leaves it out.
bool is_left_out(const std::string& plugin_file);

/// Makes a world; `name` is that of the description and of no other world of this process.
std::unique_ptr<Scene> make_scene(const World& plan, const sdf::ElementPtr& description, const std::string& name);

/// Measures a model: all of a UserModel except its file and the name of its sensor. Throws GazeboError if it cannot be
/// used.
void measure(UserModel& user, const ModelChoice& choice, const sdf::ElementPtr& model);

/// Where a resource is that a file names; empty if it is not found.
std::string find_resource(const std::string& name);

/// Has models and meshes be searched beside a file of the user.
void search_beside(const std::string& path);

/// Makes a call; exceptions that do not derive from std::exception become a GazeboError.
void guarded(const char* task, const std::function<void()>& call);

/// Where robots and objects are. Throws GazeboError if it is not on the ground; `lift`: a model's origin above it.
Pose on_the_ground(const std::string& model, double x, double y, double z, double yaw, double lift);

/// The error of a robot that begins in something of the user's world.
ParameterError begins_in(std::size_t robot, const Pose& pose, const std::string& model);

}  // namespace swarmwright::gazebo
