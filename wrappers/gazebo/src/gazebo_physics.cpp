#include <swarmwright/gazebo_physics.hpp>

#include "gazebo.hpp"
#include "robots.hpp"
#include "sdf_world.hpp"

#include <gazebo/ode/ode.h>
#include <gazebo/gazebo.hh>
#include <gazebo/physics/ode/ODECollision.hh>
#include <gazebo/physics/ode/ODEPhysics.hh>
#include <gazebo/physics/physics.hh>
#include <gazebo/sensors/sensors.hh>

#include <sdf/sdf.hh>

#include <algorithm>
#include <cmath>
#include <fstream>
#include <numeric>
#include <sstream>
#include <string>
#include <utility>
#include <vector>

namespace swarmwright::gazebo {

namespace {

using ::gazebo::physics::LinkPtr;
using ::gazebo::physics::ModelPtr;
using ::gazebo::physics::WorldPtr;
using Placement = ignition::math::Pose3d;

/// Worlds that no episode is in; kept, since making one takes a quarter of a second and 1.5 MB for each robot that
/// Gazebo never frees.
constexpr std::size_t most_idle = 8;
/// In all of them; a robot of a world takes 9 MB.
constexpr std::size_t most_idle_robots = 100;
/// How deep robots may begin in something, metres.
constexpr double deepest_at_start = 0.001;

/// What of the user's world a shape is in.
struct Obstacle {
  std::string model;

  /// Called by ODE for pairs of shapes or of groups of them.
  static void look(void* data, dGeomID one, dGeomID other) {
    if (dGeomIsSpace(one) != 0 || dGeomIsSpace(other) != 0) {
      dSpaceCollide2(one, other, data, &look);
      return;
    }
    auto& found = *static_cast<Obstacle*>(data);
    const dGeomID theirs = dGeomGetData(one) != nullptr ? one : other;
    const auto* shape = static_cast<const ::gazebo::physics::ODECollision*>(dGeomGetData(theirs));
    if (!found.model.empty() || shape == nullptr || shape->GetSurface()->collideWithoutContact) {
      return;
    }
    const std::string name = shape->GetModel()->GetName();
    dContactGeom contacts[4];
    const int count = is_of_mission(name) ? 0 : dCollide(one, other, 4, contacts, sizeof(dContactGeom));
    if (std::any_of(contacts, contacts + count, [](const auto& each) { return each.depth > deepest_at_start; })) {
      found.model = name;
    }
  }
};

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

}  // namespace

/// A world of Gazebo with robots and objects.
class GazeboPhysics::Place {
 public:
  Place(const World& world, std::string key) : key_(std::move(key)), plan_(world), steps_(steps_in_tick(world)) {
    static std::uint64_t made = 0;
    name_ = "arena_" + std::to_string(made++);
    if (settings().model) {
      for (const RobotModel& model : plan_.models) {
        check_model(*settings().model, model);
      }
    }
    const sdf::ElementPtr description = world_element(plan_, name_);
    if (!settings().save_world.empty()) {
      std::ofstream(settings().save_world) << "<?xml version='1.0'?>\n<sdf version='" << sdf::SDF::Version() << "'>\n"
                                           << description->ToString("  ") << "</sdf>\n";
    }
    world_ = load(description, name_);
    // No step is to start from the forces of the one before: they are not put back with the robots.
    world_->Physics()->SetParam("warm_start_factor", 0.0);
    if (settings().world) {
      world_->Physics()->SetParam("island_threads", 0);
      world_->Physics()->SetParam("thread_position_correction", false);
      for (const ModelPtr& model : world_->Models()) {
        collect_links(model);
      }
    }
    ::gazebo::sensors::run_once(true);  // makes the sensors known
    for (std::size_t i = 0; i < plan_.robots.size(); ++i) {
      robots_.emplace_back(world_, plan_, i);
    }
    for (std::size_t i = 0; i < plan_.objects.size(); ++i) {
      objects_.push_back(found(world_, object_name(i)));
    }
  }

  ~Place() {
    try {
      robots_.clear();
      objects_.clear();
      links_.clear();
      // Gazebo keeps all worlds that were made, and with them their descriptions, which are by far the largest part.
      const sdf::ElementPtr description = world_->SDF();
      world_->Fini();
      description->Reset();
    } catch (...) {
      // It stays in memory.
    }
  }
  Place(const Place&) = delete;
  Place& operator=(const Place&) = delete;

  const std::string& key() const { return key_; }
  std::size_t robots() const { return robots_.size(); }

  void start(Span<const Pose> robots, Span<const Pose> objects) {
    forget_moves();
    world_->Reset();
    forget_moves();
    ticks_ = 0;
    for (std::size_t i = 0; i < robots_.size(); ++i) {
      robots_[i].put(robots[i]);
      robots_[i].drive({0, 0, 0});
    }
    for (std::size_t i = 0; i < objects_.size(); ++i) {
      put(objects_[i], objects[i]);
    }
    for (const auto& [link, pose] : links_) {
      link->SetWorldPose(pose);
      link->ResetPhysicsStates();
    }
    if (settings().world) {
      check_places(robots);
    }
  }

  void step(Span<const Motion> motions) {
    // The solver draws the order of constraints from a generator that all worlds share.
    world_->Physics()->SetSeed(++ticks_);
    bool velocities = false;
    for (std::size_t i = 0; i < robots_.size(); ++i) {
      velocities |= robots_[i].pushed();
      robots_[i].drive(motions[i]);
    }
    if (!velocities) {
      ::gazebo::runWorld(world_, steps_);
      return;
    }
    for (unsigned made = 0; made < steps_; ++made) {
      for (std::size_t i = 0; made > 0 && i < robots_.size(); ++i) {
        robots_[i].drive(motions[i]);
      }
      ::gazebo::runWorld(world_, 1);
    }
  }

  void poses(Span<Pose> robots, Span<Pose> objects) const {
    std::transform(robots_.begin(), robots_.end(), robots.begin(), [](const Robot& one) { return one.at(); });
    std::transform(objects_.begin(), objects_.end(), objects.begin(), [](const ModelPtr& one) { return flat(one); });
  }

  void rays(std::uint32_t number, Span<float> distances) const { robots_.at(number).look(distances); }

 private:
  /// What can move in the user's world, to be put back.
  void collect_links(const ModelPtr& model) {
    if (model->IsStatic() || is_of_mission(model->GetName())) {
      return;
    }
    for (const LinkPtr& link : model->GetLinks()) {
      links_.emplace_back(link, link->WorldPose());
    }
    for (const ModelPtr& part : model->NestedModels()) {
      collect_links(part);
    }
  }

  /// Throws ParameterError if a robot begins in something of the user's world.
  void check_places(Span<const Pose> robots) const {
    const auto engine = boost::dynamic_pointer_cast<::gazebo::physics::ODEPhysics>(world_->Physics());
    engine->InitForThread();
    for (std::size_t i = 0; i < robots_.size(); ++i) {
      const RobotModel& model = plan_.model(i);
      const double height = static_cast<double>(model.height);
      const double low = std::min(0.01, height / 4);
      const dGeomID room = dCreateCylinder(nullptr, static_cast<double>(model.radius), height - low);
      dGeomSetPosition(room, static_cast<double>(robots[i].x), static_cast<double>(robots[i].y), (height + low) / 2);
      Obstacle found;
      dSpaceCollide2(room, reinterpret_cast<dGeomID>(engine->GetSpaceId()), &found, &Obstacle::look);
      dGeomDestroy(room);
      if (!found.model.empty()) {
        std::ostringstream text;
        text << "robot " << i << " begins at x = " << robots[i].x << ", y = " << robots[i].y << " in the model \""
             << found.model << "\" of " << settings().world->path
             << ": move that away from where the mission has its robots begin, or choose another mission";
        throw ParameterError("mission", text.str());
      }
    }
  }

  /// ODE tests what has moved last first. After this nothing has moved, and only what is moved next matters.
  void forget_moves() const {
    dSpaceClean(boost::dynamic_pointer_cast<::gazebo::physics::ODEPhysics>(world_->Physics())->GetSpaceId());
  }

  std::string key_;
  World plan_;
  unsigned steps_;
  std::string name_;
  WorldPtr world_;
  std::vector<Robot> robots_;
  std::vector<ModelPtr> objects_;
  /// What can move in the user's world, and where it begins.
  std::vector<std::pair<LinkPtr, Placement>> links_;
  std::uint32_t ticks_ = 0;
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
                           [](std::size_t sum, const auto& one) { return sum + one->robots(); });
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
      const auto same = std::find_if(places.begin(), places.end(), [&](const auto& one) { return one->key() == key; });
      if (same != places.end()) {
        place_ = std::move(*same);
        places.erase(same);
      } else {
        place_ = std::make_unique<Place>(world, key);
      }
    }
    place_->start(robots, objects);
  });
}

void GazeboPhysics::step(Span<const Motion> robots) {
  const Access access;
  guarded("make a step", [&] { place_->step(robots); });
}

void GazeboPhysics::poses(Span<Pose> robots, Span<Pose> objects) {
  const Access access;
  guarded("say where robots are", [&] { place_->poses(robots, objects); });
}

bool GazeboPhysics::has_rays() const { return settings().rays; }

void GazeboPhysics::rays(std::uint32_t robot, Span<float> distances) {
  const Access access;
  guarded("measure distances", [&] { place_->rays(robot, distances); });
}

}  // namespace swarmwright::gazebo
