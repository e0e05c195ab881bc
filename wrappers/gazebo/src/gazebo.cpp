#include "gazebo.hpp"

#include "library.hpp"
#include "sdf_world.hpp"

#include <cmath>
#include <sstream>
#include <string>

namespace swarmwright::gazebo {

namespace {

std::recursive_mutex& mutex() {
  static std::recursive_mutex shared;
  return shared;
}

enum class State { not_started, running, failed };
State state = State::not_started;

constexpr double off_the_ground = 0.5;

}  // namespace

UserFile user_file(const std::string& path) {
  const Access access;
  search_beside(path);
  return read_model(path, find_resource);
}

UserWorld user_world(const std::string& path) {
  const Access access;
  search_beside(path);
  UserWorld world = read_world(path, find_resource);
  const sdf::ElementPtr element = world.world();
  for (sdf::ElementPtr model = element->HasElement("model") ? element->GetElement("model") : nullptr; model;
       model = model->GetNextElement("model")) {
    const auto name = model->Get<std::string>("name");
    if (is_of_mission(name)) {
      throw GazeboError(path + ": <model name=\"" + name + "\">: missions call their own models so; rename it");
    }
  }
  return world;
}

Settings& settings() {
  static Settings shared;
  return shared;
}

Access::Access() : lock_(mutex()) {
  switch (state) {
    case State::running:
      return;
    case State::not_started:
      state = State::failed;
      start_library();
      state = State::running;
      return;
    case State::failed:
      throw GazeboError("Gazebo could not be started before");
  }
}

Pose on_the_ground(const std::string& model, double x, double y, double z, double yaw, double lift) {
  if (!std::isfinite(x + y + yaw) || !(std::abs(z - lift) < off_the_ground)) {
    throw GazeboError(model +
                      " has left the ground: Gazebo's contacts are unstable with steps of this length; set a smaller "
                      "--step" +
                      (settings().world ? "; or " + settings().world->path + " has no floor there, at z = 0" : ""));
  }
  return {static_cast<float>(x), static_cast<float>(y), static_cast<float>(yaw)};
}

ParameterError begins_in(std::size_t robot, const Pose& pose, const std::string& model) {
  std::ostringstream text;
  text << "robot " << robot << " begins at x = " << pose.x << ", y = " << pose.y << " in the model \"" << model
       << "\" of " << settings().world->path
       << ": move that away from where the mission has its robots begin, or choose another mission";
  return {"mission", text.str()};
}

}  // namespace swarmwright::gazebo
