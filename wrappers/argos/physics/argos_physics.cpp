#include "argos_physics.hpp"

#include "body.hpp"
#include "polygons.hpp"

#include <argos3/core/control_interface/ci_controller.h>
#include <argos3/core/simulator/physics_engine/physics_engine.h>
#include <argos3/core/simulator/simulator.h>
#include <argos3/core/simulator/space/space.h>
#include <argos3/core/utility/logging/argos_log.h>
#include <argos3/core/utility/math/ray3.h>
#include <argos3/core/utility/plugins/dynamic_loading.h>
#include <argos3/plugins/simulator/entities/wheeled_entity.h>

#include <pthread.h>

#include <atomic>
#include <cmath>
#include <cstddef>
#include <iomanip>
#include <iostream>
#include <memory>
#include <mutex>
#include <set>
#include <sstream>
#include <stdexcept>
#include <string>
#include <utility>
#include <vector>

/// ARGoS's robots need a controller; the server steers them.
class Idle : public argos::CCI_Controller {};

using argos::CCI_Controller;
REGISTER_CONTROLLER(Idle, "swarmwright_idle")

namespace {

using argos::CQuaternion;
using argos::CRadians;
using argos::CVector3;
using swarmwright::Motion;
using swarmwright::ParameterError;
using swarmwright::Pose;
using swarmwright::RobotModel;
using swarmwright::Span;
using swarmwright::World;

/// Of walls, metres.
constexpr double thickness = 0.01;
/// Where rays are, metres above the floor: every body reaches higher.
constexpr double ray_height = 0.03;
/// A tick of more robots takes seconds. Their ids, which are sorted as text, have five digits: enough for 100,000.
constexpr std::size_t most_robots = 10000;
constexpr const char* engine_id = "dyn2d";
constexpr double gravity = 9.81;
constexpr double pi = 3.14159265358979323846;
/// Metres from a disc's middle at which its largest force acts on its heading, as for the e-puck of ARGoS: such
/// robots turn at once.
constexpr double lever = 1;

/// A robot that a plug-in of ARGoS has.
struct Known {
  const char* entity;
  double radius;
  double wheel_base;
  double mass;
};
constexpr Known known_robots[] = {{"e-puck", 0.035, 0.053, 0.4}, {"foot-bot", 0.085036758, 0.14, 1.6}};
/// How far a model may differ from it, metres and kilograms.
constexpr double tolerance = 1e-4;

std::atomic<bool> in_use{false};

/// The thread for which ARGoS's log has a buffer from the beginning.
const pthread_t first_thread = pthread_self();

/// ARGoS's log keeps a buffer for each thread that it was told of.
void register_thread() {
  static std::mutex mutex;
  static std::set<pthread_t> threads = {first_thread};
  thread_local bool done = false;
  if (done) {
    return;
  }
  const std::lock_guard<std::mutex> lock(mutex);
  // Ids of threads that have ended come again, with their buffers.
  if (threads.insert(pthread_self()).second) {
    argos::LOG.AddThreadSafeBuffer();
    argos::LOGERR.AddThreadSafeBuffer();
  }
  done = true;
}

/// While it exists, what ARGoS says about the engine it makes is kept from the standard output.
class Silence {
 public:
  Silence() : before_(std::cout.rdbuf(said_.rdbuf())) {}
  ~Silence() {
    argos::LOG.Flush();
    std::cout.rdbuf(before_);
  }
  Silence(const Silence&) = delete;
  Silence& operator=(const Silence&) = delete;

 private:
  std::ostringstream said_;
  std::streambuf* before_;
};

/// An arena with nothing in it. Ticks of ARGoS are whole parts of a second.
std::string experiment(unsigned ticks_per_second) {
  std::ostringstream text;
  text
      << "<?xml version=\"1.0\"?>\n<argos-configuration>\n"
      << "<framework><system threads=\"0\"/><experiment length=\"0\" ticks_per_second=\"" << ticks_per_second
      << "\" random_seed=\"1\"/></framework>\n"
      << "<controllers><swarmwright_idle id=\"idle\"><actuators/><sensors/><params/></swarmwright_idle></controllers>\n"
      << "<arena size=\"10000,10000,10\" center=\"0,0,0\"/>\n"
      << "<physics_engines><dynamics2d id=\"" << engine_id << "\"/></physics_engines>\n<media/>\n<visualization/>\n"
      << "</argos-configuration>\n";
  return text.str();
}

CQuaternion towards(double heading) {
  CQuaternion orientation;
  orientation.FromAngleAxis(CRadians(heading), CVector3::Z);
  return orientation;
}

/// Puts something where it is to be, whatever is there.
void move(argos::CEmbodiedEntity& entity, const Pose& to) {
  entity.MoveTo(CVector3(static_cast<double>(to.x), static_cast<double>(to.y), 0),
                towards(static_cast<double>(to.heading)), false, true);
}

Pose pose(const argos::SAnchor& anchor) {
  CRadians z;
  CRadians y;
  CRadians x;
  anchor.Orientation.ToEulerAngles(z, y, x);
  return {static_cast<float>(anchor.Position.GetX()), static_cast<float>(anchor.Position.GetY()),
          static_cast<float>(z.GetValue())};
}

/// The same id for the same number; ids are sorted as the numbers are.
std::string numbered(const char* name, std::size_t number) {
  std::ostringstream text;
  text << name << std::setw(5) << std::setfill('0') << number;
  return text.str();
}

void add(argos::CEntity& entity) {
  argos::CallEntityOperation<argos::CSpaceOperationAddEntity, argos::CSpace, void>(
      argos::CSimulator::GetInstance().GetSpace(), entity);
}

void remove(argos::CEntity& entity) {
  argos::CallEntityOperation<argos::CSpaceOperationRemoveEntity, argos::CSpace, void>(
      argos::CSimulator::GetInstance().GetSpace(), entity);
}

const Known* known(const RobotModel& model) {
  for (const Known& robot : known_robots) {
    if (std::abs(static_cast<double>(model.radius) - robot.radius) < tolerance &&
        std::abs(static_cast<double>(model.wheel_base) - robot.wheel_base) < tolerance &&
        std::abs(static_cast<double>(model.mass) - robot.mass) < tolerance &&
        argos::CFactory<argos::CEntity>::Exists(robot.entity)) {
      return &robot;
    }
  }
  return nullptr;
}

/// A robot in the simulation: of a plug-in, with wheels, or a body of ours.
struct Robot {
  argos::CComposableEntity* entity = nullptr;
  argos::CEmbodiedEntity* embodied = nullptr;
  argos::CWheeledEntity* wheels = nullptr;
  argos::SwarmwrightBody* body = nullptr;
  const RobotModel* model = nullptr;
};

}  // namespace

/// What is in the simulator.
class ArgosPhysics::Simulator {
 public:
  Simulator() = default;
  ~Simulator() {
    register_thread();
    clear();
  }
  Simulator(const Simulator&) = delete;
  Simulator& operator=(const Simulator&) = delete;

  void start(const World& world, bool changed, Span<const Pose> robots, Span<const Pose> objects, std::uint64_t seed) {
    register_thread();
    const Silence silence;
    load(world);
    if (changed || !made_) {
      made_ = false;
      clear();
      world_ = world;
      put_walls();
      for (const swarmwright::Object& object : world_.objects) {
        put_object(object);
      }
      for (const std::uint32_t kind : world_.robots) {
        put_robot(world_.models.at(kind));
      }
      made_ = true;
    }
    argos::CSimulator& simulator = argos::CSimulator::GetInstance();
    simulator.SetRandomSeed(static_cast<argos::UInt32>(seed ^ (seed >> 32)) | 1U);
    simulator.Reset();
    for (std::size_t i = 0; i < objects.size(); ++i) {
      move(objects_[i]->embodied(), objects[i]);
    }
    for (std::size_t i = 0; i < robots.size(); ++i) {
      move(*robots_[i].embodied, robots[i]);
      if (robots_[i].body != nullptr) {
        robots_[i].body->forward = robots_[i].body->sideways = robots_[i].body->turn = 0;
      }
    }
    renew_engine();
  }

  void step(Span<const Motion> motions) {
    register_thread();
    for (std::size_t i = 0; i < motions.size(); ++i) {
      const Robot& robot = robots_[i];
      const Motion& motion = motions[i];
      if (robot.wheels != nullptr) {
        const double half = static_cast<double>(motion.turn) * static_cast<double>(robot.model->wheel_base) / 2;
        argos::Real speeds[] = {static_cast<double>(motion.forward) - half, static_cast<double>(motion.forward) + half};
        robot.wheels->SetVelocities(speeds);
      } else {
        robot.body->forward = static_cast<double>(motion.forward);
        robot.body->sideways = static_cast<double>(motion.sideways);
        robot.body->turn = static_cast<double>(motion.turn);
      }
    }
    argos::CSimulator::GetInstance().UpdateSpace();
  }

  void poses(Span<Pose> robots, Span<Pose> objects) const {
    for (std::size_t i = 0; i < robots.size(); ++i) {
      robots[i] = pose(robots_[i].embodied->GetOriginAnchor());
    }
    for (std::size_t i = 0; i < objects.size(); ++i) {
      objects[i] = pose(objects_[i]->embodied().GetOriginAnchor());
    }
  }

  void rays(std::uint32_t number, Span<float> distances) const {
    const Robot& robot = robots_[number];
    const RobotModel& model = *robot.model;
    const argos::SAnchor& anchor = robot.embodied->GetOriginAnchor();
    const Pose at = pose(anchor);
    const double start = static_cast<double>(model.ray_start);
    const double range = static_cast<double>(model.ray_range);
    for (std::size_t i = 0; i < distances.size(); ++i) {
      const double angle = static_cast<double>(at.heading) + static_cast<double>(model.rays[i]);
      const double ahead_x = std::cos(angle);
      const double ahead_y = std::sin(angle);
      const double x = anchor.Position.GetX();
      const double y = anchor.Position.GetY();
      const argos::CRay3 ray(CVector3(x + start * ahead_x, y + start * ahead_y, ray_height),
                             CVector3(x + (start + range) * ahead_x, y + (start + range) * ahead_y, ray_height));
      argos::SEmbodiedEntityIntersectionItem hit;
      const bool met = argos::GetClosestEmbodiedEntityIntersectedByRay(hit, ray, *robot.embodied);
      distances[i] = met ? static_cast<float>(hit.TOnRay * range) : model.ray_range;
    }
  }

 private:
  /// Makes ARGoS ready, once for the process: it cannot load a second experiment.
  static void load(const World& world) {
    static unsigned loaded = 0;
    const double exact = 1 / static_cast<double>(world.tick);
    const auto ticks = static_cast<unsigned>(std::lround(exact));
    if (ticks == 0 || std::abs(exact - ticks) > 1e-3 * exact) {
      throw std::runtime_error("ARGoS divides a second into whole ticks, but a tick is " + std::to_string(world.tick) +
                               " s");
    }
    if (loaded != 0 && loaded != ticks) {
      throw std::runtime_error("ARGoS has begun with " + std::to_string(loaded) +
                               " ticks a second and cannot change to " + std::to_string(ticks) +
                               "; start another server");
    }
    if (loaded != 0) {
      return;
    }
    argos::LOG.DisableColoredOutput();
    argos::LOGERR.DisableColoredOutput();
    argos::CDynamicLoading::LoadAllLibraries();
    ticpp::Document document;
    document.Parse(experiment(ticks));
    argos::CSimulator::GetInstance().Load(document);
    loaded = ticks;
  }

  /// The order in which contacts are solved depends on all that was in the engine before: puts everything into a new
  /// one.
  void renew_engine() {
    static argos::CPhysicsEngine& engine = argos::CSimulator::GetInstance().GetPhysicsEngine(engine_id);
    static argos::TConfigurationNode& configuration = argos::GetNode(
        argos::GetNode(argos::CSimulator::GetInstance().GetConfigurationRoot(), "physics_engines"), "dynamics2d");
    std::vector<argos::CEntity*> all(walls_.begin(), walls_.end());
    all.insert(all.end(), objects_.begin(), objects_.end());
    for (const Robot& robot : robots_) {
      all.push_back(robot.entity);
    }
    for (argos::CEntity* entity : all) {
      engine.RemoveEntity(*entity);
    }
    engine.Destroy();
    engine.Init(configuration);
    for (argos::CEntity* entity : all) {
      engine.AddEntity(*entity);
    }
  }

  void put_walls() {
    for (std::size_t wall = 0; wall < world_.walls.size(); ++wall) {
      const std::vector<Convex> parts = wall == 0 ? fence(world_.walls[wall], thickness) : filled(world_.walls[wall]);
      for (const Convex& part : parts) {
        argos::SwarmwrightShape shape;
        for (const Corner& corner : part) {
          shape.corners.emplace_back(corner.x, corner.y);
        }
        auto* body = new argos::SwarmwrightBody(numbered("wall", walls_.size()), shape);
        add(*body);
        walls_.push_back(body);
      }
    }
  }

  void put_object(const swarmwright::Object& object) {
    argos::SwarmwrightShape shape;
    shape.kind = argos::SwarmwrightShape::Kind::loose;
    shape.mass = static_cast<double>(object.mass);
    shape.force = static_cast<double>(object.friction) * shape.mass * gravity;
    // The torque of an even pressure below a disc; a box counts as the disc of its area.
    double reach = static_cast<double>(object.radius);
    if (object.radius <= 0) {
      const double x = static_cast<double>(object.width) / 2;
      const double y = static_cast<double>(object.depth) / 2;
      shape.corners = {{-x, -y}, {x, -y}, {x, y}, {-x, y}};
      reach = std::sqrt(4 * x * y / pi);
    } else {
      shape.radius = reach;
    }
    shape.torque = shape.force * reach * 2 / 3;
    auto* body = new argos::SwarmwrightBody(numbered("object", objects_.size()), shape);
    add(*body);
    objects_.push_back(body);
  }

  void put_robot(const RobotModel& model) {
    Robot robot;
    robot.model = &model;
    const std::string id = numbered("robot", robots_.size());
    if (const Known* plugged = known(model)) {
      configurations_.emplace_back(std::make_unique<ticpp::Document>());
      configurations_.back()->Parse(
          "<" + std::string(plugged->entity) + " id=\"" + id +
          "\"><body position=\"0,0,0\" orientation=\"0,0,0\"/><controller config=\"idle\"/></" + plugged->entity + ">");
      argos::CEntity* entity = argos::CFactory<argos::CEntity>::New(plugged->entity);
      robot.entity = dynamic_cast<argos::CComposableEntity*>(entity);
      if (robot.entity == nullptr) {
        throw std::runtime_error(std::string("ARGoS's plug-in for the ") + plugged->entity + " has no parts");
      }
      entity->Init(*configurations_.back()->FirstChildElement());
      robot.embodied = &robot.entity->GetComponent<argos::CEmbodiedEntity>("body");
      robot.wheels = &robot.entity->GetComponent<argos::CWheeledEntity>("wheels");
    } else {
      argos::SwarmwrightShape shape;
      shape.kind = argos::SwarmwrightShape::Kind::driven;
      shape.radius = static_cast<double>(model.radius);
      shape.mass = static_cast<double>(model.mass);
      shape.force = shape.mass * static_cast<double>(model.acceleration);
      shape.torque = shape.force * lever;
      robot.body = new argos::SwarmwrightBody(id, shape);
      robot.entity = robot.body;
      robot.embodied = &robot.body->embodied();
    }
    add(*robot.entity);
    robots_.push_back(robot);
  }

  /// Removes everything, the last first.
  void clear() {
    while (!robots_.empty()) {
      remove(*robots_.back().entity);
      robots_.pop_back();
    }
    configurations_.clear();
    clear(objects_);
    clear(walls_);
  }

  static void clear(std::vector<argos::SwarmwrightBody*>& bodies) {
    while (!bodies.empty()) {
      remove(*bodies.back());
      bodies.pop_back();
    }
  }

  World world_ = {};
  bool made_ = false;
  std::vector<argos::SwarmwrightBody*> walls_;
  std::vector<argos::SwarmwrightBody*> objects_;
  std::vector<Robot> robots_;
  std::vector<std::unique_ptr<ticpp::Document>> configurations_;
};

ArgosPhysics::ArgosPhysics() {
  if (in_use.exchange(true)) {
    throw std::logic_error("ARGoS has one simulation in a process; start more servers instead of more threads");
  }
  simulator_ = std::make_unique<Simulator>();
}

ArgosPhysics::~ArgosPhysics() {
  simulator_.reset();
  in_use = false;
}

void ArgosPhysics::start(const World& world, bool changed, Span<const Pose> robots, Span<const Pose> objects,
                         std::uint64_t seed) {
  if (robots.size() > most_robots) {
    throw ParameterError("robots", std::to_string(robots.size()) + " are too many for ARGoS, expected at most " +
                                       std::to_string(most_robots));
  }
  simulator_->start(world, changed, robots, objects, seed);
}

void ArgosPhysics::step(Span<const Motion> robots) { simulator_->step(robots); }

void ArgosPhysics::poses(Span<Pose> robots, Span<Pose> objects) { simulator_->poses(robots, objects); }

void ArgosPhysics::rays(std::uint32_t robot, Span<float> distances) { simulator_->rays(robot, distances); }
