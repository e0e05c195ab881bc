#include "stage_physics.hpp"

#include <stage.hh>

#include <fcntl.h>
#include <unistd.h>

#include <algorithm>
#include <clocale>
#include <cmath>
#include <cstddef>
#include <cstdio>
#include <iomanip>
#include <memory>
#include <mutex>
#include <new>
#include <sstream>
#include <stdexcept>
#include <string>
#include <utility>
#include <vector>

namespace {

using swarmwright::Motion;
using swarmwright::ParameterError;
using swarmwright::Point;
using swarmwright::Pose;
using swarmwright::RobotModel;
using swarmwright::Span;
using swarmwright::World;

constexpr double pi = 3.14159265358979323846;
/// Corners of a robot's outline.
constexpr int corners = 12;
/// Cells of Stage's map in the radius of the smallest robot, and in the reach of the shortest rays, at least.
constexpr double cells_in_radius = 4;
constexpr double cells_in_ray = 10;
/// Worlds that a server keeps; more would be a mistake, such as walls drawn anew for each episode.
constexpr std::size_t most_worlds = 64;
constexpr std::size_t most_robots = 10000;
const char* const robot_type = "swarmwright_robot";

/// While it exists, what Stage says about loading is kept from the standard output.
class Silence {
 public:
  Silence() {
    std::fflush(stdout);
    before_ = dup(STDOUT_FILENO);
    const int nowhere = open("/dev/null", O_WRONLY | O_CLOEXEC);
    if (before_ >= 0 && nowhere >= 0) {
      dup2(nowhere, STDOUT_FILENO);
    }
    if (nowhere >= 0) {
      close(nowhere);
    }
  }
  ~Silence() {
    std::fflush(stdout);
    if (before_ >= 0) {
      dup2(before_, STDOUT_FILENO);
      close(before_);
    }
  }
  Silence(const Silence&) = delete;
  Silence& operator=(const Silence&) = delete;

 private:
  int before_ = -1;
};

/// Where the next robots are made: Stage moves models by their addresses, so these must ascend for episodes to be the
/// same in every process.
struct Places {
  std::unique_ptr<unsigned char[]> memory;
  std::size_t used = 0;
  std::size_t count = 0;
};
Places* places = nullptr;

class Robot : public Stg::ModelPosition {
 public:
  using Stg::ModelPosition::ModelPosition;

  static Stg::Model* make(Stg::World* world, Stg::Model* parent, const std::string& type) {
    if (places->used == places->count) {
      throw std::logic_error("more robots than places");
    }
    void* at = places->memory.get() + sizeof(Robot) * places->used++;
    return new (at) Robot(world, parent, type);
  }
};

/// The member of Stage's worlds that says how many threads update sensors. There are none here, but Stage makes a
/// thread all the same, hands over to it in each update, and waits for ever if it is not ready at the first one.
struct Workers {
  using Member = unsigned Stg::World::*;
  friend Member reach(Workers);
};
template <class Tag, typename Tag::Member member>
struct Reach {
  friend typename Tag::Member reach(Tag) { return member; }
};
template struct Reach<Workers, &Stg::World::worker_threads>;

/// What that thread does, once it is called: nothing more.
int sleep_for_good(Stg::Model* /*model*/, void* /*argument*/) {
  for (;;) {
    pause();
  }
}

/// Once for the process.
void initialize() {
  static std::once_flag done;
  std::call_once(done, [] {
    const Silence silence;
    static char name[] = "swarmwright-stage";
    static char* values[] = {name, nullptr};
    int count = 1;
    char** entry = values;
    Stg::Init(&count, &entry);
    Stg::Model::name_map[robot_type] = &Robot::make;
  });
}

/// Stops at everything but the robot itself.
bool is_hit(Stg::Model* met, const Stg::Model* finder, const void* /*argument*/) { return met != finder; }

/// A polygon as a block of a model, of a size that does not change it.
void block(std::ostringstream& text, const std::vector<std::pair<double, double>>& points) {
  text << "  block( points " << points.size();
  for (std::size_t i = 0; i < points.size(); ++i) {
    text << " point[" << i << "] [ " << points[i].first << ' ' << points[i].second << " ]";
  }
  text << " z [ 0 1 ] )\n";
}

void wall(std::ostringstream& text, const swarmwright::Wall& source, std::size_t number) {
  double low_x = 0;
  double high_x = 0;
  double low_y = 0;
  double high_y = 0;
  std::vector<std::pair<double, double>> points;
  for (const Point& point : source.points) {
    const double x = static_cast<double>(point.x);
    const double y = static_cast<double>(point.y);
    if (points.empty()) {
      low_x = high_x = x;
      low_y = high_y = y;
    }
    low_x = std::min(low_x, x);
    high_x = std::max(high_x, x);
    low_y = std::min(low_y, y);
    high_y = std::max(high_y, y);
    points.emplace_back(x, y);
  }
  text << "model(\n  name \"wall" << number << "\"\n  size [ " << high_x - low_x << ' ' << high_y - low_y
       << " 1 ]\n  pose [ " << (low_x + high_x) / 2 << ' ' << (low_y + high_y) / 2
       << " 0 0 ]\n  obstacle_return 1\n  ranger_return 1\n";
  block(text, points);
  text << ")\n";
}

void robot(std::ostringstream& text, const RobotModel& model, std::size_t number) {
  std::vector<std::pair<double, double>> points;
  const double radius = static_cast<double>(model.radius);
  for (int i = 0; i < corners; ++i) {
    points.emplace_back(radius * std::cos(2 * pi * i / corners), radius * std::sin(2 * pi * i / corners));
  }
  const bool wheels = model.wheel_base > 0;
  text << robot_type << "(\n  name \"robot" << number << "\"\n  size [ " << 2 * radius << ' ' << 2 * radius
       << " 1 ]\n  drive \"" << (wheels ? "diff" : "omni") << "\"\n  obstacle_return 1\n  ranger_return 1\n";
  block(text, points);
  text << ")\n";
}

/// The mission as a world file; robots stand where the episode puts them.
std::string world_file(const World& world) {
  double cell = 1;
  for (const RobotModel& model : world.models) {
    cell = std::min(cell, static_cast<double>(model.radius) / cells_in_radius);
    if (!model.rays.empty()) {
      cell = std::min(cell, static_cast<double>(model.ray_range) / cells_in_ray);
    }
  }
  std::ostringstream text;
  // Stage does not read exponents.
  text << std::fixed << std::setprecision(9) << "resolution " << cell << "\ninterval_sim "
       << 1000 * static_cast<double>(world.tick) << "\nthreads 1\n";
  for (std::size_t i = 0; i < world.walls.size(); ++i) {
    wall(text, world.walls[i], i);
  }
  for (std::size_t i = 0; i < world.robots.size(); ++i) {
    robot(text, world.model(i), i);
  }
  return text.str();
}

}  // namespace

class StagePhysics::Simulator {
 public:
  Simulator(const World& world, std::string file) : file_(std::move(file)), world_(new Stg::World("swarmwright")) {
    places_.count = world.robots.size();
    places_.memory = std::make_unique<unsigned char[]>(sizeof(Robot) * places_.count);
    places = &places_;
    std::istringstream content(file_);
    const Silence silence;
    if (!world_->Load(content, std::string())) {
      throw std::runtime_error("Stage cannot read the mission's world");
    }
    world_->*reach(Workers()) = 0;
    world_->Enqueue(1, 0, world_->ground, &sleep_for_good, nullptr);
    for (std::size_t i = 0; i < world.robots.size(); ++i) {
      auto* robot = dynamic_cast<Robot*>(world_->GetModel("robot" + std::to_string(i)));
      if (robot == nullptr) {
        throw std::runtime_error("Stage has not made robot " + std::to_string(i));
      }
      for (Stg::Bounds& bounds : robot->velocity_bounds) {
        bounds = Stg::Bounds(-1e3, 1e3);
      }
      robot->Subscribe();
      robots_.push_back(robot);
      models_.push_back(world.model(i));
    }
  }

  const std::string& file() const { return file_; }

  void start(Span<const Pose> robots) {
    for (std::size_t i = 0; i < robots_.size(); ++i) {
      const Stg::Pose to(static_cast<double>(robots[i].x), static_cast<double>(robots[i].y), 0,
                         static_cast<double>(robots[i].heading));
      robots_[i]->Stop();
      robots_[i]->SetVelocity(Stg::Velocity(0, 0, 0, 0));
      robots_[i]->SetStall(false);
      // Both layers of the map are drawn only if the pose changes.
      robots_[i]->SetPose(Stg::Pose(to.x + 1e-3, to.y, 0, to.a));
      robots_[i]->SetPose(to);
    }
  }

  void step(Span<const Motion> motions) {
    for (std::size_t i = 0; i < robots_.size(); ++i) {
      robots_[i]->SetSpeed(static_cast<double>(motions[i].forward), static_cast<double>(motions[i].sideways),
                           static_cast<double>(motions[i].turn));
    }
    world_->Update();
  }

  void poses(Span<Pose> robots) const {
    for (std::size_t i = 0; i < robots_.size(); ++i) {
      const Stg::Pose at = robots_[i]->GetGlobalPose();
      robots[i] = {static_cast<float>(at.x), static_cast<float>(at.y), static_cast<float>(Stg::normalize(at.a))};
    }
  }

  void rays(std::uint32_t number, Span<float> distances) const {
    const RobotModel& model = models_[number];
    const Stg::Pose at = robots_[number]->GetGlobalPose();
    const double start = static_cast<double>(model.ray_start);
    const double range = static_cast<double>(model.ray_range);
    for (std::size_t i = 0; i < distances.size(); ++i) {
      const double angle = Stg::normalize(at.a + static_cast<double>(model.rays[i]));
      const Stg::Pose from(at.x + start * std::cos(angle), at.y + start * std::sin(angle), 0, angle);
      const Stg::RaytraceResult hit = world_->Raytrace(from, range, &is_hit, robots_[number], nullptr, false);
      distances[i] = hit.mod == nullptr ? model.ray_range : static_cast<float>(std::min(hit.range, range));
    }
  }

 private:
  std::string file_;
  Places places_;
  // Never deleted: its thread uses it as long as the process lives.
  Stg::World* world_;
  std::vector<Robot*> robots_;
  std::vector<RobotModel> models_;
};

StagePhysics::StagePhysics() { initialize(); }

StagePhysics::~StagePhysics() {
  for (std::unique_ptr<Simulator>& simulator : simulators_) {
    simulator.release();  // NOLINT: the robots in its memory are still Stage's
  }
}

void StagePhysics::start(const World& world, bool changed, Span<const Pose> robots, Span<const Pose> objects,
                         std::uint64_t /*seed*/) {
  if (changed || current_ == nullptr) {
    current_ = nullptr;
    if (!objects.empty()) {
      throw ParameterError("mission.objects",
                           "models of Stage do not push each other; expected a mission without objects");
    }
    if (robots.size() > most_robots) {
      throw ParameterError("robots", std::to_string(robots.size()) + " are too many for Stage, expected at most " +
                                         std::to_string(most_robots));
    }
    std::string file = world_file(world);
    const auto match = std::find_if(simulators_.begin(), simulators_.end(),
                                    [&file](const auto& simulator) { return simulator->file() == file; });
    if (match == simulators_.end() && simulators_.size() == most_worlds) {
      throw std::runtime_error("this server has had " + std::to_string(most_worlds) +
                               " missions of different walls or robots, which Stage keeps; start another one");
    }
    if (match == simulators_.end()) {
      simulators_.push_back(std::make_unique<Simulator>(world, std::move(file)));
      current_ = simulators_.back().get();
    } else {
      current_ = match->get();
    }
  }
  current_->start(robots);
}

void StagePhysics::step(Span<const Motion> robots) { current_->step(robots); }

void StagePhysics::poses(Span<Pose> robots, Span<Pose> /*objects*/) { current_->poses(robots); }

void StagePhysics::rays(std::uint32_t robot, Span<float> distances) { current_->rays(robot, distances); }
