#include "captured.hpp"
#include "library.hpp"
#include "names.hpp"
#include "robot_rays.hpp"
#include "sdf_world.hpp"
#include "shapes.hpp"

#include <ignition/gazebo/Util.hh>
#include <ignition/gazebo/components/AngularVelocityCmd.hh>
#include <ignition/gazebo/components/Collision.hh>
#include <ignition/gazebo/components/Geometry.hh>
#include <ignition/gazebo/components/Joint.hh>
#include <ignition/gazebo/components/JointEffortLimitsCmd.hh>
#include <ignition/gazebo/components/JointPositionReset.hh>
#include <ignition/gazebo/components/JointType.hh>
#include <ignition/gazebo/components/JointVelocityCmd.hh>
#include <ignition/gazebo/components/JointVelocityReset.hh>
#include <ignition/gazebo/components/LinearVelocityCmd.hh>
#include <ignition/gazebo/components/Link.hh>
#include <ignition/gazebo/components/Model.hh>
#include <ignition/gazebo/components/Name.hh>
#include <ignition/gazebo/components/ParentEntity.hh>
#include <ignition/gazebo/components/Pose.hh>
#include <ignition/gazebo/components/PoseCmd.hh>
#include <ignition/gazebo/components/Static.hh>
#include <ignition/gazebo/components/World.hh>

#include <algorithm>
#include <array>
#include <cmath>
#include <csignal>
#include <limits>
#include <map>
#include <memory>
#include <string>
#include <utility>
#include <vector>

namespace swarmwright::gazebo {

namespace {

using sim::Entity;

/// How deep robots may begin in something, metres.
constexpr double deepest_at_start = 0.001;
/// Directions in which a robot's surroundings are searched at the start.
constexpr int directions = 72;
/// Metres above the ground where nothing is.
constexpr double far_above = 1000;
/// Setting a pose leaves a rounding error of the one before, which is 1e-16, then 1e-32, then nothing.
constexpr int repetitions = 4;

/// The handlers of signals of this process, which the library would replace.
class KeptSignals {
 public:
  KeptSignals() {
    each([](int signal, struct sigaction& action) { ::sigaction(signal, nullptr, &action); });
  }
  ~KeptSignals() {
    each([](int signal, struct sigaction& action) { ::sigaction(signal, &action, nullptr); });
  }
  KeptSignals(const KeptSignals&) = delete;
  KeptSignals& operator=(const KeptSignals&) = delete;

 private:
  template <typename Call>
  void each(Call call) {
    call(SIGINT, kept_[0]);
    call(SIGTERM, kept_[1]);
  }

  std::array<struct sigaction, 2> kept_ = {};
};

/// A model that can move.
struct Movable {
  Entity model = sim::kNullEntity;
  Placement start;
  std::vector<std::pair<Entity, std::size_t>> joints;  // and their degrees of freedom
  double lift = 0;
};

/// A wheel, or no joint.
struct Wheel {
  Entity joint = sim::kNullEntity;
  double forward = 1;
  double radius = 0;
  double torque = 0;
};

struct Robot {
  Movable body;
  Entity link = sim::kNullEntity;
  Wheel left;
  Wheel right;
  double wheel_base = 0;
  RobotRays rays;
  double ray_begin = 0;
};

/// A shape of the world, the link that has it, and its model that no other one contains.
struct Placed {
  Entity link;
  Entity model;
  Shape shape;
};

// The interfaces of the library's systems are not deleted through.
#pragma GCC diagnostic push
#pragma GCC diagnostic ignored "-Wnon-virtual-dtor"
/// Gets the world when it is made, and has drives act before each step, as commands last for one step.
class Driver : public sim::System, public sim::ISystemConfigure, public sim::ISystemPreUpdate {
 public:
  void Configure(const Entity& entity, const std::shared_ptr<const sdf::Element>& /*element*/,
                 sim::EntityComponentManager& all, sim::EventManager& /*events*/) override {
    world = entity;
    manager = &all;
  }
  void PreUpdate(const sim::UpdateInfo& info, sim::EntityComponentManager& /*all*/) override {
    if (before_step && !info.paused) {
      before_step();
    }
  }

  Entity world = sim::kNullEntity;
  sim::EntityComponentManager* manager = nullptr;
  std::function<void()> before_step;
};
#pragma GCC diagnostic pop

class GzScene : public Scene {
 public:
  GzScene(const World& plan, const sdf::ElementPtr& description) : plan_(plan), steps_(steps_in_tick(plan)) {
    make(description);
    settle();
    for (std::size_t i = 0; i < plan_.robots.size(); ++i) {
      add_robot(i);
    }
    for (std::size_t i = 0; i < plan_.objects.size(); ++i) {
      objects_.push_back(movable(found(object_name(i))));
    }
    for (const Entity model : manager().ChildrenByComponents(driver_->world, components::Model())) {
      if (!is_of_mission(name_of(model)) && !is_static(model)) {
        others_.push_back(movable(model));
      }
    }
    collect_shapes();
    driver_->before_step = [this] { drive(); };
  }

  void start(Span<const Pose> robots, Span<const Pose> objects) override {
    motions_.assign(robots_.size(), {});
    std::vector<std::pair<const Movable*, Placement>> places;
    const auto flat = [](const Pose& pose, double lift) {
      return Placement(static_cast<double>(pose.x), static_cast<double>(pose.y), lift, 0, 0,
                       static_cast<double>(pose.heading));
    };
    for (std::size_t i = 0; i < robots_.size(); ++i) {
      places.emplace_back(&robots_[i].body, flat(robots[i], robots_[i].body.lift));
    }
    for (std::size_t i = 0; i < objects_.size(); ++i) {
      places.emplace_back(&objects_[i], flat(objects[i], 0));
    }
    for (const Movable& other : others_) {
      places.emplace_back(&other, other.start);
    }
    // A step elsewhere: links that move by less than a micrometre are not told to the world, so that where an episode
    // begins would depend on where the last one ended.
    driving_ = false;
    for (std::size_t i = 0; i < places.size(); ++i) {
      Placement above = places[i].second;
      above.Pos() = Vector(static_cast<double>(i), 0, far_above);
      rest(*places[i].first, above);
    }
    run(1, false);
    for (int i = 0; i < repetitions; ++i) {
      for (const auto& placement : places) {
        rest(*placement.first, Placement::Zero);
      }
      run(1, true);
    }
    for (const auto& [one, place] : places) {
      rest(*one, place);
    }
    run(1, true);
    for (const auto& [one, place] : places) {
      at_ease(*one);
      manager().SetComponentData<components::Pose>(one->model, place);
    }
    driving_ = true;
    moved_ = true;
    if (settings().world) {
      check_places(robots);
    }
  }

  void step(Span<const Motion> motions) override {
    motions_.assign(motions.begin(), motions.end());
    run(steps_, false);
    moved_ = true;
  }

  void poses(Span<Pose> robots, Span<Pose> objects) override {
    std::transform(robots_.begin(), robots_.end(), robots.begin(), [&](const Robot& robot) { return at(robot.body); });
    std::transform(objects_.begin(), objects_.end(), objects.begin(),
                   [&](const Movable& object) { return at(object); });
  }

  void rays(std::uint32_t number, Span<float> distances) override {
    place_shapes();
    const Robot& robot = robots_.at(number);
    const Placement link = sim::worldPose(robot.link, manager());
    for (std::size_t i = 0; i < distances.size(); ++i) {
      const Vector begin = link.CoordPositionAdd(robot.rays[i].begin);
      const Vector ray = link.CoordPositionAdd(robot.rays[i].end) - begin;
      const double length = ray.Length();
      const double met = nearest(begin, ray / length, length, robot.body.model).first;
      distances[i] =
          robot.rays.reading(i, met <= length ? robot.ray_begin + met : std::numeric_limits<double>::infinity());
    }
  }

 private:
  sim::EntityComponentManager& manager() const { return *driver_->manager; }

  void make(const sdf::ElementPtr& description) {
    sim::ServerConfig config;
    {
      const Captured said_before;
      config.SetSdfString("<?xml version='1.0'?><sdf version='" + sdf::SDF::Version() + "'>" +
                          description->ToString("") + "</sdf>");
      const KeptSignals signals;
      server_ = std::make_unique<sim::Server>(config);
      sdf::setFindCallback(find_resource);  // the server has set its own, which asks the network
    }
    driver_ = std::make_shared<Driver>();
    if (!server_->AddSystem(driver_).value_or(false) || driver_->manager == nullptr) {
      throw GazeboError("Gazebo did not make the world of the mission");
    }
  }

  /// Has the physics engine make the models, where they stand.
  void settle() { run(1, true); }

  void run(unsigned steps, bool paused) {
    if (!(paused ? server_->RunOnce(true) : server_->Run(true, steps, false))) {
      throw GazeboError("Gazebo does not run");
    }
  }

  std::string name_of(Entity entity) const {
    const auto* name = manager().Component<components::Name>(entity);
    return name == nullptr ? "" : name->Data();
  }

  bool is_static(Entity model) const {
    const auto* fixed = manager().Component<components::Static>(model);
    return fixed != nullptr && fixed->Data();
  }

  Entity found(const std::string& name) const {
    const Entity model = manager().EntityByComponents(components::Model(), components::Name(name),
                                                      components::ParentEntity(driver_->world));
    if (model == sim::kNullEntity) {
      throw GazeboError("Gazebo did not make the model " + name);
    }
    return model;
  }

  Entity part(Entity model, const std::string& name) const {
    const Entity entity = manager().EntityByComponents(components::Name(name), components::ParentEntity(model));
    if (entity == sim::kNullEntity) {
      throw GazeboError("Gazebo did not make " + name + " of the model " + name_of(model));
    }
    return entity;
  }

  Movable movable(Entity model, double lift = 0) const {
    Movable one;
    one.model = model;
    one.lift = lift;
    one.start = manager().Component<components::Pose>(model)->Data();
    for (const Entity joint : manager().Descendants(model)) {
      const auto* type = manager().Component<components::JointType>(joint);
      if (type == nullptr || type->Data() == sdf::JointType::FIXED) {
        continue;
      }
      const bool two = type->Data() == sdf::JointType::UNIVERSAL || type->Data() == sdf::JointType::REVOLUTE2;
      one.joints.emplace_back(joint, type->Data() == sdf::JointType::BALL ? 3 : two ? 2 : 1);
    }
    std::sort(one.joints.begin(), one.joints.end());
    return one;
  }

  void add_robot(std::size_t number) {
    const std::optional<UserModel>& user = settings().model;
    const RobotModel& model = plan_.model(number);
    Robot robot;
    robot.body = movable(found(robot_name(number)), user ? user->lift : 0);
    robot.link = part(robot.body.model, user ? user->link : body);
    if (user) {
      const double force = user->mass * static_cast<double>(model.acceleration) / 2;
      robot.wheel_base = user->left.left - user->right.left;
      for (auto [wheel, measured] : {std::pair(&robot.left, &user->left), std::pair(&robot.right, &user->right)}) {
        *wheel = {part(robot.body.model, measured->joint), measured->forward, measured->radius,
                  std::min(force * measured->radius, measured->torque)};
      }
    } else if (has_wheels(model)) {
      robot.wheel_base = static_cast<double>(model.wheel_base);
      robot.left = {part(robot.body.model, left_joint), 1, wheel_radius(model), motor_torque(model)};
      robot.right = robot.left;
      robot.right.joint = part(robot.body.model, right_joint);
    }
    for (const Wheel& wheel : {robot.left, robot.right}) {
      if (wheel.joint != sim::kNullEntity) {
        manager().SetComponentData<components::JointEffortLimitsCmd>(wheel.joint, {{-wheel.torque, wheel.torque}});
      }
    }
    robot.rays = RobotRays(model, ray_height(plan_));
    robot.ray_begin = ray_origin(model);
    robots_.push_back(std::move(robot));
  }

  void collect_shapes() {
    manager().Each<components::Collision, components::CollisionElement>(
        [&](const Entity& entity, const components::Collision*, const components::CollisionElement* collision) {
          const Entity link = manager().ParentEntity(entity);
          Entity model = link;
          while (manager().ParentEntity(model) != driver_->world) {
            model = manager().ParentEntity(model);
          }
          std::optional<Shape> shape =
              Shape::of(*collision->Data().Geom(), manager().Component<components::Pose>(entity)->Data());
          if (shape) {
            shape->move(sim::worldPose(link, manager()));
            shapes_.push_back({link, model, std::move(*shape)});
          }
          return true;
        });
    std::stable_sort(shapes_.begin(), shapes_.end(), [](const Placed& left, const Placed& other) {
      return std::pair(left.model, left.link) < std::pair(other.model, other.link);
    });
    for (Placed& placed : shapes_) {
      if (!is_static(placed.model)) {
        moving_.push_back(&placed);
      }
    }
  }

  void place_shapes() {
    if (!std::exchange(moved_, false)) {
      return;
    }
    Entity link = sim::kNullEntity;
    Placement at;
    for (Placed* placed : moving_) {
      if (placed->link != link) {
        link = placed->link;
        at = sim::worldPose(link, manager());
      }
      placed->shape.move(at);
    }
  }

  /// How far the nearest shape of other models is along a ray, and its model.
  std::pair<double, Entity> nearest(const Vector& begin, const Vector& along, double length, Entity own) const {
    std::pair<double, Entity> nearest{std::numeric_limits<double>::infinity(), sim::kNullEntity};
    for (const Placed& placed : shapes_) {
      if (placed.model != own) {
        const double met = placed.shape.met(begin, along, length);
        if (met < nearest.first) {
          nearest = {met, placed.model};
        }
      }
    }
    return nearest;
  }

  /// Throws ParameterError if a robot begins in something of the user's world.
  void check_places(Span<const Pose> robots) {
    place_shapes();
    for (std::size_t i = 0; i < robots_.size(); ++i) {
      const RobotModel& model = plan_.model(i);
      const double height = static_cast<double>(model.height);
      for (const double z : {std::min(0.01, height / 4), height / 2, height}) {
        const Vector middle(static_cast<double>(robots[i].x), static_cast<double>(robots[i].y), z);
        for (int k = 0; k < directions; ++k) {
          const double angle = 2 * std::acos(-1.0) * k / directions;
          const double length = static_cast<double>(model.radius) - deepest_at_start;
          for (const Placed& placed : shapes_) {
            if (placed.shape.met(middle, Vector(std::cos(angle), std::sin(angle), 0), length) < length &&
                !is_of_mission(name_of(placed.model))) {
              throw begins_in(i, robots[i], name_of(placed.model));
            }
          }
        }
      }
    }
  }

  /// Tells the engine to put a model somewhere, at rest.
  void rest(const Movable& movable, const Placement& placement) {
    auto& all = manager();
    all.SetComponentData<components::WorldPoseCmd>(movable.model, placement);
    all.SetComponentData<components::LinearVelocityCmd>(movable.model, Vector::Zero);
    all.SetComponentData<components::AngularVelocityCmd>(movable.model, Vector::Zero);
    for (const auto& [joint, freedoms] : movable.joints) {
      all.SetComponentData<components::JointPositionReset>(joint, std::vector<double>(freedoms, 0.0));
      all.SetComponentData<components::JointVelocityReset>(joint, std::vector<double>(freedoms, 0.0));
    }
  }

  /// Ends what rest() told, of which the engine would repeat a part.
  void at_ease(const Movable& movable) {
    auto& all = manager();
    all.RemoveComponent<components::WorldPoseCmd>(movable.model);
    all.RemoveComponent<components::LinearVelocityCmd>(movable.model);
    all.RemoveComponent<components::AngularVelocityCmd>(movable.model);
  }

  void drive() {
    if (!driving_) {
      return;
    }
    for (std::size_t i = 0; i < robots_.size(); ++i) {
      const Robot& robot = robots_[i];
      const double forward = motions_[i].forward;
      const double turn = motions_[i].turn;
      if (robot.left.joint != sim::kNullEntity) {
        const double difference = turn * robot.wheel_base / 2;
        turn_wheel(robot.left, forward - difference);
        turn_wheel(robot.right, forward + difference);
      } else {
        auto& all = manager();
        all.SetComponentData<components::LinearVelocityCmd>(
            robot.body.model, Vector(forward, static_cast<double>(motions_[i].sideways), 0));
        all.SetComponentData<components::AngularVelocityCmd>(robot.body.model, Vector(0, 0, turn));
      }
    }
  }

  void turn_wheel(const Wheel& wheel, double speed) {
    manager().SetComponentData<components::JointVelocityCmd>(wheel.joint, {wheel.forward * speed / wheel.radius});
  }

  Pose at(const Movable& movable) const {
    const Placement& pose = manager().Component<components::Pose>(movable.model)->Data();
    return on_the_ground(name_of(movable.model), pose.Pos().X(), pose.Pos().Y(), pose.Pos().Z(), pose.Rot().Yaw(),
                         movable.lift);
  }

  World plan_;
  unsigned steps_;
  std::unique_ptr<sim::Server> server_;
  std::shared_ptr<Driver> driver_;
  std::vector<Robot> robots_;
  std::vector<Movable> objects_;
  /// What can move in the user's world.
  std::vector<Movable> others_;
  std::vector<Placed> shapes_;
  std::vector<Placed*> moving_;
  std::vector<Motion> motions_;
  bool driving_ = false;
  bool moved_ = true;
};

}  // namespace

std::unique_ptr<Scene> make_scene(const World& plan, const sdf::ElementPtr& description, const std::string& /*name*/) {
  return std::make_unique<GzScene>(plan, description);
}

}  // namespace swarmwright::gazebo
