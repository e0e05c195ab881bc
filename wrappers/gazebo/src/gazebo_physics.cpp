#include <swarmwright/gazebo_physics.hpp>

#include "gazebo.hpp"
#include "library.hpp"
#include "sdf_world.hpp"

#include <algorithm>
#include <fstream>
#include <numeric>
#include <string>
#include <utility>
#include <vector>

namespace swarmwright::gazebo {

namespace {

/// Worlds that no episode is in; kept, since making one takes a quarter of a second and 1.5 MB for each robot that
/// Gazebo never frees.
constexpr std::size_t most_idle = 8;
/// In all of them; a robot of a world takes 9 MB.
constexpr std::size_t most_idle_robots = 100;

/// What tells one world from another: its description, and where rays look, which is not in it.
std::string key_of(const World& world) {
  std::string key = mission_text(world);
  for (const RobotModel& model : world.models) {
    for (const float angle : model.rays) {
      key += ' ' + std::to_string(angle);
    }
    for (const float number : {model.acceleration, model.ray_start, model.ray_range, model.wheel_base}) {
      key += " " + std::to_string(number);
    }
  }
  for (const std::uint32_t robot : world.robots) {
    key += ' ' + std::to_string(robot);
  }
  return key;
}

/// The world of the library for that of a mission.
std::unique_ptr<Scene> made(const World& world) {
  static std::uint64_t count = 0;
  const std::string name = "arena_" + std::to_string(count++);
  if (settings().model) {
    for (const RobotModel& model : world.models) {
      check_model(*settings().model, model);
    }
  }
  const sdf::ElementPtr description = world_element(world, name);
  if (!settings().save_world.empty()) {
    std::ofstream(settings().save_world) << "<?xml version='1.0'?>\n<sdf version='" << sdf::SDF::Version() << "'>\n"
                                         << description->ToString("  ") << "</sdf>\n";
  }
  return make_scene(world, description, name);
}

}  // namespace

/// A world of the library, and what tells it from others.
class GazeboPhysics::Place {
 public:
  Place(const World& world, std::string key)
      : key_(std::move(key)), robots_(world.robots.size()), scene_(made(world)) {}

  const std::string& key() const { return key_; }
  std::size_t robots() const { return robots_; }
  Scene& scene() { return *scene_; }

 private:
  std::string key_;
  std::size_t robots_;
  std::unique_ptr<Scene> scene_;
};

GazeboPhysics::GazeboPhysics() = default;

GazeboPhysics::~GazeboPhysics() {
  try {
    const Access access;
    leave();
  } catch (...) {
    // Gazebo could not be started: there is no world.
  }
}

std::vector<std::unique_ptr<GazeboPhysics::Place>>& GazeboPhysics::idle() {
  // Never destroyed: at the end of the process Gazebo is gone before.
  static auto& places = *new std::vector<std::unique_ptr<Place>>();
  return places;
}

void GazeboPhysics::leave() {
  if (!place_) {
    return;
  }
  std::vector<std::unique_ptr<Place>>& places = idle();
  places.push_back(std::move(place_));
  const auto robots = [&] {
    return std::accumulate(places.begin(), places.end(), std::size_t{0},
                           [](std::size_t sum, const auto& entry) { return sum + entry->robots(); });
  };
  // The one that was left last stays: it is often the next one.
  while (places.size() > most_idle || (places.size() > 1 && robots() > most_idle_robots)) {
    places.erase(places.begin());
  }
}

void GazeboPhysics::start(const World& world, bool changed, Span<const Pose> robots, Span<const Pose> objects,
                          std::uint64_t /*seed*/) {
  const Access access;
  guarded("start an episode", [&] {
    if (changed || !place_) {
      leave();
      const std::string key = key_of(world);
      std::vector<std::unique_ptr<Place>>& places = idle();
      const auto same =
          std::find_if(places.begin(), places.end(), [&](const auto& entry) { return entry->key() == key; });
      if (same != places.end()) {
        place_ = std::move(*same);
        places.erase(same);
      } else {
        place_ = std::make_unique<Place>(world, key);
      }
    }
    place_->scene().start(robots, objects);
  });
}

void GazeboPhysics::step(Span<const Motion> robots) {
  const Access access;
  guarded("make a step", [&] { place_->scene().step(robots); });
}

void GazeboPhysics::poses(Span<Pose> robots, Span<Pose> objects) {
  const Access access;
  guarded("say where robots are", [&] { place_->scene().poses(robots, objects); });
}

bool GazeboPhysics::has_rays() const { return settings().rays; }

void GazeboPhysics::rays(std::uint32_t robot, Span<float> distances) {
  const Access access;
  guarded("measure distances", [&] { place_->scene().rays(robot, distances); });
}

}  // namespace swarmwright::gazebo
