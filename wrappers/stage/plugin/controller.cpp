// A controller for worlds of Stage, which offers their robots to optimization tools:
//
//   position( ... ctrl "swarmwright_stage broker=mqtt://localhost:1883 id=6" )
//
// How to use it: docs/how-to/simulators.md.

#include <swarmwright/swarm.hpp>

#include <stage.hh>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <exception>
#include <iostream>
#include <map>
#include <memory>
#include <sstream>
#include <stdexcept>
#include <string>
#include <utility>
#include <vector>

namespace {

using swarmwright::Place;
using swarmwright::PlaceMetrics;
using swarmwright::Span;

constexpr std::uint32_t actuators = 2;
/// How long an update without an episode may take: a window draws meanwhile.
constexpr std::chrono::milliseconds patience(20);
/// Of the options.
constexpr double largest = 1e6;

/// Stops at everything that rangers see, but the robot itself.
bool is_hit(Stg::Model* met, const Stg::Model* finder, const void* /*argument*/) {
  return !met->IsRelated(finder) && met->vis.ranger_return >= 0;
}

/// A robot: a position model with what is mounted on it.
struct Robot {
  Stg::ModelPosition* position;
  std::vector<Stg::ModelRanger*> rangers;
  std::vector<Stg::ModelFiducial*> fiducials;

  explicit Robot(Stg::ModelPosition* model) : position(model) { find(model); }

  void find(Stg::Model* model) {
    if (auto* ranger = dynamic_cast<Stg::ModelRanger*>(model)) {
      rangers.push_back(ranger);
    } else if (auto* fiducial = dynamic_cast<Stg::ModelFiducial*>(model)) {
      fiducials.push_back(fiducial);
    }
    for (Stg::Model* child : model->GetChildren()) {
      find(child);
    }
  }

  std::size_t numbers() const {
    std::size_t count = fiducials.size();
    for (const Stg::ModelRanger* ranger : rangers) {
      for (const Stg::ModelRanger::Sensor& sensor : ranger->GetSensors()) {
        count += sensor.sample_count;
      }
    }
    return count;
  }

  /// The same each time: Stage's own rangers look while robots move in another thread.
  void sense(std::vector<float>& into) const {
    for (const Stg::ModelRanger* ranger : rangers) {
      for (const Stg::ModelRanger::Sensor& sensor : ranger->GetSensors()) {
        scan(*ranger, sensor, into);
      }
    }
    for (Stg::ModelFiducial* fiducial : fiducials) {
      const auto count = static_cast<double>(fiducial->GetFiducials().size());
      into.push_back(static_cast<float>(1 - 2 / (1 + std::exp(count))));
    }
  }

 private:
  static void scan(const Stg::ModelRanger& ranger, const Stg::ModelRanger::Sensor& sensor, std::vector<float>& into) {
    const unsigned samples = sensor.sample_count;
    const double between = samples > 1 ? sensor.fov / (samples - 1) : 0;
    Stg::Pose from = sensor.pose;
    from.a += samples > 1 ? -sensor.fov / 2 : 0;
    from.z += sensor.size.z / 2;
    from = ranger.LocalToGlobal(from);
    Stg::Ray ray(&ranger, from, sensor.range.max, &is_hit, nullptr, true);
    for (unsigned i = 0; i < samples; ++i) {
      const double range = ranger.GetWorld()->Raytrace(ray).range;
      // 1 at the robot, 0 at the end of the range.
      into.push_back(static_cast<float>(1 - std::clamp(range / sensor.range.max, 0.0, 1.0)));
      ray.origin.a += between;
    }
  }
};

/// All robots of a world that have this controller.
class Server {
 public:
  explicit Server(std::string arguments) : arguments_(std::move(arguments)) {
    std::istringstream words(arguments_);
    std::string word;
    words >> word;  // the controller's name
    while (words >> word) {
      const std::size_t equals = word.find('=');
      const std::string name = word.substr(0, equals);
      if (equals == std::string::npos || (name != "broker" && name != "id" && name != "prefix" && name != "title" &&
                                          name != "duration" && name != "speed" && name != "turn")) {
        throw std::invalid_argument(
            "ctrl: \"" + word + "\" is unknown; expected broker=, id=, prefix=, title=, duration=, speed= or turn=");
      }
      options_[name] = word.substr(equals + 1);
    }
    speed_ = positive("speed", 0.4);
    turn_ = positive("turn", 1.5);
    duration_ = positive("duration", 60);
  }

  /// One server has one set of options.
  void expect(const std::string& arguments) const {
    if (arguments != arguments_) {
      throw std::invalid_argument("ctrl: robots have different options: \"" + arguments_ + "\" and \"" + arguments +
                                  "\"; all have the same ones");
    }
  }

  void add(Stg::Model* model) {
    auto* position = dynamic_cast<Stg::ModelPosition*>(model);
    if (position == nullptr) {
      throw std::invalid_argument(std::string("ctrl: ") + model->Token() +
                                  " is not a position model, so it cannot drive; give the controller to one");
    }
    robots_.emplace_back(position);
    const Robot& robot = robots_.back();
    if (robot.numbers() == 0) {
      throw std::invalid_argument(std::string("ctrl: ") + model->Token() +
                                  " senses nothing; add a ranger or a fiducial model to it");
    }
    position->Subscribe();
    for (Stg::ModelFiducial* fiducial : robot.fiducials) {
      fiducial->Subscribe();
    }
    if (position->GetWorld()->IsGUI()) {
      for (Stg::ModelRanger* ranger : robot.rangers) {
        ranger->Subscribe();  // to be seen
      }
    }
  }

  /// At the end of each update.
  void update(Stg::World& world) {
    if (!swarm_) {
      open(world);
    }
    if (!swarm_->running()) {
      rest(world);
      return;
    }
    if (ticks_ > 0) {
      metrics_.observe(places());
    }
    if (ticks_ == length_) {
      const std::vector<double> values = metrics_.values();
      swarm_->finish(-values[1], values);
      rest(world);
      return;
    }
    ++ticks_;
    sensors_.clear();
    for (const Robot& robot : robots_) {
      robot.sense(sensors_);
    }
    if (!swarm_->act(sensors_)) {
      rest(world);
      return;
    }
    const Span<const float> acted = swarm_->actuators();
    for (std::size_t i = 0; i < robots_.size(); ++i) {
      const double left = static_cast<double>(acted[actuators * i]);
      const double right = static_cast<double>(acted[actuators * i + 1]);
      robots_[i].position->SetSpeed((left + right) / 2 * speed_, 0, (right - left) / 2 * turn_);
    }
  }

 private:
  std::string option(const std::string& name, const char* variable, const std::string& absent) const {
    const char* set = variable != nullptr ? std::getenv(variable) : nullptr;
    if (set != nullptr) {
      return set;
    }
    const auto option = options_.find(name);
    return option != options_.end() ? option->second : absent;
  }

  double positive(const std::string& name, double absent) const {
    const auto option = options_.find(name);
    if (option == options_.end()) {
      return absent;
    }
    const auto value = swarmwright::detail::number<double>("ctrl: " + name, option->second);
    if (!(value > 0 && value <= largest)) {
      throw std::invalid_argument("ctrl: " + name + ": " + option->second +
                                  " found, expected a number above 0, 1e6 at most");
    }
    return value;
  }

  void open(Stg::World& world) {
    // As they are made, so that the agents are the same in every process.
    std::sort(robots_.begin(), robots_.end(),
              [](const Robot& a, const Robot& b) { return a.position->GetId() < b.position->GetId(); });
    for (const Robot& robot : robots_) {
      if (robot.numbers() != robots_.front().numbers()) {
        throw std::invalid_argument(
            std::string("ctrl: robots have different sensors: ") + robots_.front().position->Token() + " gets " +
            std::to_string(robots_.front().numbers()) + " numbers, " + robot.position->Token() + " gets " +
            std::to_string(robot.numbers()) + "; all have the same controller and need as many");
      }
    }
    for (Stg::Model* model : world.GetChildren()) {
      starts_.emplace_back(model, model->GetPose());
    }
    swarmwright::Description description;
    description.title = option("title", nullptr, "stage");
    description.sensors = static_cast<std::uint32_t>(robots_.front().numbers());
    description.actuators = actuators;
    description.max_agents = static_cast<std::uint32_t>(robots_.size());
    description.metrics = PlaceMetrics::names();
    swarmwright::Options options;
    options.broker = option("broker", "SWARMWRIGHT_BROKER", "");
    options.prefix = option("prefix", "SWARMWRIGHT_PREFIX", "");
    options.id = swarmwright::detail::number<std::uint64_t>("ctrl: id", option("id", "SWARMWRIGHT_ID", "1"));
    swarm_ = std::make_unique<swarmwright::Swarm>(description, options, description.max_agents);
  }

  std::vector<Place> places() const {
    std::vector<Place> places;
    for (const Robot& robot : robots_) {
      const Stg::Pose at = robot.position->GetGlobalPose();
      places.push_back({at.x, at.y, at.a});
    }
    return places;
  }

  void stop() {
    for (const Robot& robot : robots_) {
      robot.position->Stop();
      robot.position->SetVelocity(Stg::Velocity(0, 0, 0, 0));
      robot.position->SetStall(false);
    }
  }

  void rest(Stg::World& world) {
    if (swarm_->stopped()) {
      swarm_.reset();
      std::fflush(nullptr);
      std::_Exit(0);  // Stage has no other way
    }
    stop();
    if (!swarm_->rest(patience)) {
      return;
    }
    swarm_->begin([&] {
      const double interval = static_cast<double>(world.sim_interval) / 1e6;
      length_ = std::lround(swarm_->parameters().number("duration", interval, largest, duration_) / interval);
      ticks_ = 0;
      for (const auto& [model, start] : starts_) {
        // Both layers of the map are drawn only if the pose changes.
        model->SetPose(Stg::Pose(start.x + 1e-3, start.y, start.z, start.a));
        model->SetPose(start);
      }
      metrics_.begin(places());
    });
  }

  /// As the file has them.
  std::string arguments_;
  std::map<std::string, std::string> options_;
  /// m/s and rad/s with both wheels at their largest speed, along or against each other.
  double speed_ = 0;
  double turn_ = 0;
  double duration_ = 0;
  std::vector<Robot> robots_;
  std::vector<std::pair<Stg::Model*, Stg::Pose>> starts_;
  std::unique_ptr<swarmwright::Swarm> swarm_;
  std::vector<float> sensors_;
  PlaceMetrics metrics_;
  long ticks_ = 0;
  long length_ = 0;
};

std::unique_ptr<Server> server;

/// For mistakes of the user's: Stage would go on without the controller.
template <class Work>
void or_exit(Work&& work) {
  try {
    std::forward<Work>(work)();
  } catch (const std::exception& error) {
    std::fflush(stdout);
    std::cerr << "\nerror: swarmwright_stage: " << error.what() << std::endl;
    std::_Exit(1);
  }
}

int updated(Stg::World* world, void* /*argument*/) {
  or_exit([&] { server->update(*world); });
  return 0;
}

}  // namespace

/// Called by Stage for each model that has this controller.
extern "C" int Init(Stg::Model* model, Stg::CtrlArgs* arguments) {
  or_exit([&] {
    if (!server) {
      server = std::make_unique<Server>(arguments->worldfile);
      model->GetWorld()->AddUpdateCallback(&updated, nullptr);
    }
    server->expect(arguments->worldfile);
    server->add(model);
  });
  return 0;
}
