#include "gazebo.hpp"
#include "library.hpp"
#include "robots.hpp"
#include "sdf_world.hpp"

#include <gazebo/ode/ode.h>
#include <gazebo/gazebo.hh>
#include <gazebo/physics/ode/ODECollision.hh>
#include <gazebo/physics/ode/ODEPhysics.hh>
#include <gazebo/physics/physics.hh>
#include <gazebo/sensors/sensors.hh>

#include <algorithm>
#include <string>
#include <utility>
#include <vector>

namespace swarmwright::gazebo {

namespace {

using ::gazebo::physics::LinkPtr;
using ::gazebo::physics::ModelPtr;
using ::gazebo::physics::WorldPtr;
using Placement = ignition::math::Pose3d;

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
    auto& obstacle = *static_cast<Obstacle*>(data);
    const dGeomID theirs = dGeomGetData(one) != nullptr ? one : other;
    const auto* shape = static_cast<const ::gazebo::physics::ODECollision*>(dGeomGetData(theirs));
    if (!obstacle.model.empty() || shape == nullptr || shape->GetSurface()->collideWithoutContact) {
      return;
    }
    const std::string name = shape->GetModel()->GetName();
    dContactGeom contacts[4];
    const int count = is_of_mission(name) ? 0 : dCollide(one, other, 4, contacts, sizeof(dContactGeom));
    if (std::any_of(contacts, contacts + count, [](const auto& each) { return each.depth > deepest_at_start; })) {
      obstacle.model = name;
    }
  }
};

/// A world of Gazebo with robots and objects.
class ClassicScene : public Scene {
 public:
  ClassicScene(const World& plan, const sdf::ElementPtr& description, const std::string& name)
      : plan_(plan), steps_(steps_in_tick(plan)) {
    world_ = load(description, name);
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

  ~ClassicScene() override {
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
  ClassicScene(const ClassicScene&) = delete;
  ClassicScene& operator=(const ClassicScene&) = delete;

  void start(Span<const Pose> robots, Span<const Pose> objects) override {
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

  void step(Span<const Motion> motions) override {
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

  void poses(Span<Pose> robots, Span<Pose> objects) override {
    std::transform(robots_.begin(), robots_.end(), robots.begin(), [](const Robot& robot) { return robot.at(); });
    std::transform(objects_.begin(), objects_.end(), objects.begin(),
                   [](const ModelPtr& object) { return flat(object); });
  }

  void rays(std::uint32_t number, Span<float> distances) override { robots_.at(number).look(distances); }

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
      const dGeomID body = dCreateCylinder(nullptr, static_cast<double>(model.radius), height - low);
      dGeomSetPosition(body, static_cast<double>(robots[i].x), static_cast<double>(robots[i].y), (height + low) / 2);
      Obstacle obstacle;
      dSpaceCollide2(body, reinterpret_cast<dGeomID>(engine->GetSpaceId()), &obstacle, &Obstacle::look);
      dGeomDestroy(body);
      if (!obstacle.model.empty()) {
        throw begins_in(i, robots[i], obstacle.model);
      }
    }
  }

  /// ODE tests what has moved last first. After this nothing has moved, and only what is moved next matters.
  void forget_moves() const {
    dSpaceClean(boost::dynamic_pointer_cast<::gazebo::physics::ODEPhysics>(world_->Physics())->GetSpaceId());
  }

  World plan_;
  unsigned steps_;
  WorldPtr world_;
  std::vector<Robot> robots_;
  std::vector<ModelPtr> objects_;
  /// What can move in the user's world, and where it begins.
  std::vector<std::pair<LinkPtr, Placement>> links_;
  std::uint32_t ticks_ = 0;
};

}  // namespace

std::unique_ptr<Scene> make_scene(const World& plan, const sdf::ElementPtr& description, const std::string& name) {
  return std::make_unique<ClassicScene>(plan, description, name);
}

}  // namespace swarmwright::gazebo
