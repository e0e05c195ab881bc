// Simulators that move the robots of missions.
#pragma once

#include <swarmwright/serve.hpp>
#include <swarmwright/server.hpp>

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <functional>
#include <memory>
#include <stdexcept>
#include <string>
#include <utility>
#include <vector>

namespace swarmwright {

/// Where something is: x and y in metres, heading in radians counter-clockwise from x.
using Pose = swarmwright_pose;

/// What a robot's drive is to do in a step, in the frame of the robot, its noise included: forward and sideways in m/s,
/// turn in rad/s. The wheels of a differential drive have the speeds forward -+ turn * wheel_base / 2 (left, right).
using Motion = swarmwright_motion;

/// A lamp: x, y, z in metres, intensity.
using Light = swarmwright_light;

/// Something that robots can push: a disc, or with radius 0 a box of width and depth; metres, kilograms.
using Object = swarmwright_object;

/// A point of the floor, metres.
struct Point {
  float x;
  float y;
};

/// A wall.
struct Wall {
  /// Corners counter-clockwise.
  std::vector<Point> points;
  /// Metres.
  float height;
};

/// A part of the floor with a colour of its own.
struct Patch {
  /// Corners counter-clockwise.
  std::vector<Point> points;
  /// 0 black to 1 white; below 0: black or white, drawn anew for each episode.
  float grey;
};

/// What robots of a kind are.
struct RobotModel {
  /// Metres.
  float radius;
  float height;
  /// Kilograms.
  float mass;
  /// Between the wheels of a differential drive, metres; 0 for other drives.
  float wheel_base;
  /// Of a wheel or of the robot, m/s.
  float top_speed;
  /// Largest change of velocity by the drive, m/s^2.
  float acceleration;
  /// Where proximity rays begin, from the middle, and how far they reach from there, metres.
  float ray_start;
  float ray_range;
  /// Their directions, radians counter-clockwise from ahead.
  std::vector<float> rays;
};

/// What a simulator is to build; the same for all episodes of a mission.
struct World {
  /// Seconds of a step.
  float tick;
  /// Of the floor beside the patches, 0 black to 1 white.
  float grey;
  /// The first one is the outline, with the robots inside, the others are obstacles.
  std::vector<Wall> walls;
  /// For pictures, and for sensors of the simulator's own; later ones lie on earlier ones.
  std::vector<Patch> patches;
  std::vector<Light> lights;
  std::vector<RobotModel> models;
  /// The model of each robot.
  std::vector<std::uint32_t> robots;
  std::vector<Object> objects;

  /// The model of a robot.
  const RobotModel& model(std::size_t robot) const { return models[robots[robot]]; }
};

/// A simulator that moves robots and objects, while missions, sensors and metrics are those of the built-in simulation
/// `arena`: its parameters are those of the arena (mission, robots, robot, duration, failures, seed).
///
/// An episode: start, then step and poses for each tick. The same start and motions should give the same poses, to the
/// bit. An exception ends the episode and is reported to the optimization tool with its type and what(); the next one
/// begins with start. An object is used by one thread at a time, not always the same.
class Physics {
 public:
  virtual ~Physics() = default;

  /// Goes to the start of an episode: robots and objects are at these poses and at rest. `changed`: whether the world
  /// differs from that of the episode before; the first one is always changed. Throws ParameterError, which names the
  /// parameter of the arena that it is about ("robots", "mission.objects"), for what the simulator cannot do.
  virtual void start(const World& world, bool changed, Span<const Pose> robots, Span<const Pose> objects,
                     std::uint64_t seed) = 0;

  /// Moves on by a tick of the world; a motion for each robot.
  virtual void step(Span<const Motion> robots) = 0;

  /// Writes where all are.
  virtual void poses(Span<Pose> robots, Span<Pose> objects) = 0;

  /// Whether it has ray sensors of its own, which `rays` reads; else they are computed from the poses.
  virtual bool has_rays() const { return false; }

  /// Writes how far each proximity ray of a robot reaches from where it begins, metres; ray_range where it meets
  /// nothing. Not called before the first step of an episode.
  virtual void rays(std::uint32_t /*robot*/, Span<float> /*distances*/) {}

 protected:
  Physics() = default;
  Physics(const Physics&) = default;
  Physics(Physics&&) = default;
  Physics& operator=(const Physics&) = default;
  Physics& operator=(Physics&&) = default;
};

namespace detail {

/// A simulator as an object of the C interface.
struct HostedPhysics {
  std::unique_ptr<Physics> physics;
  World world = {};
};

inline std::vector<Point> points(const swarmwright_polygon& polygon) {
  std::vector<Point> points;
  points.reserve(polygon.count);
  for (std::size_t i = 0; i < polygon.count; ++i) {
    points.push_back({polygon.points[2 * i], polygon.points[2 * i + 1]});
  }
  return points;
}

inline World world(const swarmwright_world& plain) {
  World world = {};
  world.tick = plain.tick;
  world.grey = plain.grey;
  for (const swarmwright_polygon& wall : Span(plain.walls, plain.wall_count)) {
    world.walls.push_back({points(wall), wall.height});
  }
  for (const swarmwright_polygon& patch : Span(plain.patches, plain.patch_count)) {
    world.patches.push_back({points(patch), patch.grey});
  }
  world.lights.assign(plain.lights, plain.lights + plain.light_count);
  for (const swarmwright_robot& model : Span(plain.models, plain.model_count)) {
    world.models.push_back({model.radius, model.height, model.mass, model.wheel_base, model.top_speed,
                            model.acceleration, model.ray_start, model.ray_range,
                            std::vector<float>(model.rays, model.rays + model.ray_count)});
  }
  world.robots.assign(plain.robots, plain.robots + plain.robot_count);
  world.objects.assign(plain.objects, plain.objects + plain.object_count);
  return world;
}

/// Calls a hosted simulator; an exception becomes a status.
template <class Call>
swarmwright_status hosted_physics(void* object, Call&& call) noexcept {
  const Turn turn(object);
  return guarded([&] { call(*static_cast<HostedPhysics*>(object)); });
}

/// The functions of all simulators, except create, which the server sets.
inline swarmwright_physics physics_functions() noexcept {
  swarmwright_physics table = {};
  table.size = sizeof(table);
  table.destroy = [](void* object) noexcept {
    const Turn turn(object);
    delete static_cast<HostedPhysics*>(object);
  };
  table.start = [](void* object, const swarmwright_start* start) noexcept {
    return hosted_physics(object, [&](HostedPhysics& host) {
      if (start->changed) {
        host.world = world(*start->world);
      }
      host.physics->start(host.world, start->changed, {start->robots, host.world.robots.size()},
                          {start->objects, host.world.objects.size()}, start->seed);
    });
  };
  table.step = [](void* object, const swarmwright_motion* robots, std::size_t count) noexcept {
    return hosted_physics(object, [&](HostedPhysics& host) { host.physics->step({robots, count}); });
  };
  table.poses = [](void* object, swarmwright_pose* robots, swarmwright_pose* objects) noexcept {
    return hosted_physics(object, [&](HostedPhysics& host) {
      host.physics->poses({robots, host.world.robots.size()}, {objects, host.world.objects.size()});
    });
  };
  table.rays = [](void* object, std::uint32_t robot, float* distances, std::size_t count) noexcept {
    return hosted_physics(object, [&](HostedPhysics& host) { host.physics->rays(robot, {distances, count}); });
  };
  return table;
}

}  // namespace detail

/// What a server says of a simulator.
struct PhysicsDescription {
  /// Its name in experiments: "arena-" and the simulator's, by which they know what it is.
  std::string title;
  /// Whether it repeats episodes.
  Determinism determinism = Determinism::undeclared;
  /// For statistical determinism: as in Description.
  double tolerance = 0;
  /// Whether there can be only one in a process.
  bool only_one = true;
};

/// Offers the missions of the arena in another simulator.
///
/// Throws as Server does, and std::invalid_argument where options have more than one thread.
class PhysicsServer : public RunningServer {
 public:
  /// Makes a simulator.
  using Factory = std::function<std::unique_ptr<Physics>()>;

  PhysicsServer(const PhysicsDescription& description, Factory factory, const Options& options = {})
      : RunningServer(options), context_(std::make_unique<Context>()) {
    context_->factory = std::move(factory);
    context_->first = context_->make();
    swarmwright_physics functions = detail::physics_functions();
    functions.title = description.title.c_str();
    functions.determinism = static_cast<std::int32_t>(description.determinism);
    functions.tolerance = description.tolerance;
    functions.only_one = description.only_one ? 1 : 0;
    functions.context = context_.get();
    functions.create = &PhysicsServer::create;
    if (!context_->first->physics->has_rays()) {
      functions.rays = nullptr;
    }
    open(options, [&](const swarmwright_options* plain, swarmwright_server** server) {
      return swarmwright_server_open_physics(plain, &functions, server);
    });
  }

  PhysicsServer(const PhysicsServer&) = delete;
  PhysicsServer& operator=(const PhysicsServer&) = delete;
  PhysicsServer(PhysicsServer&&) = delete;
  PhysicsServer& operator=(PhysicsServer&&) = delete;

  ~PhysicsServer() { close(); }

 private:
  struct Context {
    std::unique_ptr<detail::HostedPhysics> make() const {
      std::unique_ptr<Physics> physics = factory();
      if (!physics) {
        throw std::invalid_argument("the factory of simulators returned a null pointer");
      }
      return std::make_unique<detail::HostedPhysics>(detail::HostedPhysics{std::move(physics)});
    }

    Factory factory;
    /// The first to be used.
    std::unique_ptr<detail::HostedPhysics> first = {};
  };

  static swarmwright_status create(void* context, void** object) noexcept {
    const detail::Turn turn(context);
    return detail::guarded([&] {
      auto& self = *static_cast<Context*>(context);
      std::unique_ptr<detail::HostedPhysics> hosted = self.first ? std::move(self.first) : self.make();
      const detail::Turn handed_over(hosted.get());
      *object = hosted.release();
    });
  }

  std::unique_ptr<Context> context_;
};

/// The main function of a server of missions: as `serve`.
inline int serve_physics(const PhysicsDescription& description, int count, char** values,
                         PhysicsServer::Factory factory) {
  return detail::serve_opened(count, values, [&](const Options& options) {
    return std::make_unique<PhysicsServer>(description, std::move(factory), options);
  });
}

/// As above, for simulators of one type.
template <class T>
int serve_physics(const PhysicsDescription& description, int count, char** values) {
  return serve_physics(description, count, values, [] { return std::make_unique<T>(); });
}

}  // namespace swarmwright
