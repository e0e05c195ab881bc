#include "controller.hpp"

#include <swarmwright/argos.hpp>

#include <argos3/core/simulator/entity/composable_entity.h>
#include <argos3/core/simulator/entity/controllable_entity.h>
#include <argos3/core/simulator/entity/embodied_entity.h>
#include <argos3/core/simulator/physics_engine/physics_engine.h>
#include <argos3/core/simulator/simulator.h>
#include <argos3/core/simulator/space/space.h>
#include <argos3/core/utility/logging/argos_log.h>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <exception>
#include <iostream>
#include <string>
#include <vector>

namespace swarmwright {

using argos::CARGoSException;  // for ARGoS's macros

namespace {

/// How long a tick without an episode may take: a viewer draws meanwhile.
constexpr std::chrono::milliseconds patience(20);
constexpr std::uint32_t actuators = 2;

/// An attribute, or a variable of the environment, so that several servers can have the same file.
std::string option(argos::TConfigurationNode& tree, const char* attribute, const char* variable,
                   const std::string& absent) {
  std::string value = absent;
  argos::GetNodeAttributeOrDefault(tree, attribute, value, value);
  const char* set = std::getenv(variable);
  return set != nullptr ? std::string(set) : value;
}

}  // namespace

ArgosSwarm::ArgosSwarm() = default;
ArgosSwarm::~ArgosSwarm() = default;

void ArgosSwarm::Init(argos::TConfigurationNode& tree) {
  find_robots();
  Description description;
  description.title = "argos";
  argos::GetNodeAttributeOrDefault(tree, "title", description.title, description.title);
  description.sensors = static_cast<std::uint32_t>(controllers_.front()->sensed().size());
  description.actuators = actuators;
  description.max_agents = static_cast<std::uint32_t>(controllers_.size());
  description.metrics = PlaceMetrics::names();
  const std::vector<Metric> own = metrics();
  own_metrics_ = own.size();
  description.metrics.insert(description.metrics.end(), own.begin(), own.end());
  Options options;
  options.broker = option(tree, "broker", "SWARMWRIGHT_BROKER", "");
  options.prefix = option(tree, "prefix", "SWARMWRIGHT_PREFIX", "");
  usual_length_ = GetSimulator().GetMaxSimulationClock();
  try {
    options.id = detail::number<std::uint64_t>("id", option(tree, "id", "SWARMWRIGHT_ID", "1"));
    swarm_ = std::make_unique<Swarm>(description, options, static_cast<std::uint32_t>(controllers_.size()));
  } catch (const std::exception& error) {
    THROW_ARGOSEXCEPTION("Swarmwright's loop functions: " << error.what());
  }
}

void ArgosSwarm::find_robots() {
  // Sorted by id, so that the agents are the same in every process.
  for (const auto& [id, entity] : GetSpace().GetEntityMapPerId()) {
    auto* controllable = dynamic_cast<argos::CControllableEntity*>(entity);
    if (controllable == nullptr) {
      continue;
    }
    auto* controller = dynamic_cast<ArgosController*>(&controllable->GetController());
    if (controller != nullptr) {
      auto& robot = dynamic_cast<argos::CComposableEntity&>(controllable->GetParent());
      controllers_.push_back(controller);
      bodies_.push_back(&robot.GetComponent<argos::CEmbodiedEntity>("body"));
    }
  }
  if (controllers_.empty()) {
    THROW_ARGOSEXCEPTION("no robot has the controller swarmwright_controller, so there is nothing to optimize");
  }
  const ArgosController& first = *controllers_.front();
  for (const ArgosController* other : controllers_) {
    if (other->sensed().size() != first.sensed().size()) {
      THROW_ARGOSEXCEPTION("robots have different sensors: "
                           << first.GetId() << " gets " << first.sensed().size() << " numbers (" << first.sensors()
                           << "), " << other->GetId() << " gets " << other->sensed().size() << " (" << other->sensors()
                           << "); all have the same controller and need as many");
    }
  }
}

std::vector<Place> ArgosSwarm::places() const {
  std::vector<Place> places;
  for (const argos::CEmbodiedEntity* body : bodies_) {
    argos::CRadians z;
    argos::CRadians y;
    argos::CRadians x;
    const argos::SAnchor& anchor = body->GetOriginAnchor();
    anchor.Orientation.ToEulerAngles(z, y, x);
    places.push_back({anchor.Position.GetX(), anchor.Position.GetY(), z.GetValue()});
  }
  return places;
}

void ArgosSwarm::PostStep() {
  if (!swarm_->running()) {
    rest();
    return;
  }
  const argos::UInt32 clock = GetSpace().GetSimulationClock();
  if (clock > 1) {
    places_.observe(places());
    tick();
  }
  try {
    if (clock >= length_ || done()) {
      const double reached = fitness();
      std::vector<double> values = places_.values();
      std::vector<double> own = measure();
      if (own.size() != own_metrics_) {
        throw std::logic_error("measure() gives " + std::to_string(own.size()) + " numbers, metrics() " +
                               std::to_string(own_metrics_) + " names");
      }
      values.insert(values.end(), own.begin(), own.end());
      swarm_->finish(reached, values);
      rest();
      return;
    }
  } catch (const std::exception& error) {
    swarm_->fail(error.what());
    rest();
    return;
  }
  sensors_.clear();
  for (const ArgosController* controller : controllers_) {
    sensors_.insert(sensors_.end(), controller->sensed().begin(), controller->sensed().end());
  }
  if (!swarm_->act(sensors_)) {
    rest();
    return;
  }
  const Span<const float> acted = swarm_->actuators();
  for (std::size_t i = 0; i < controllers_.size(); ++i) {
    controllers_[i]->drive(static_cast<double>(acted[actuators * i]), static_cast<double>(acted[actuators * i + 1]));
  }
}

void ArgosSwarm::stop_robots() {
  for (ArgosController* controller : controllers_) {
    controller->drive(0, 0);
  }
}

void ArgosSwarm::rest() {
  if (swarm_->stopped()) {
    swarm_.reset();
    std::fflush(nullptr);
    std::_Exit(0);  // viewers have no other way
  }
  stop_robots();
  // ARGoS would end at the time that its file gives.
  GetSpace().SetSimulationClock(0);
  if (swarm_->rest(patience)) {
    start();
  }
}

void ArgosSwarm::start() {
  swarm_->begin([this] {
    const double second = argos::CPhysicsEngine::GetInverseSimulationClockTick();
    const double usual = usual_length_ > 0 ? static_cast<double>(usual_length_) / second : 60;
    // ARGoS itself ends at the time that its file gives.
    const double most = usual_length_ > 0 ? usual : 1e6;
    length_ = static_cast<argos::UInt32>(
        std::lround(swarm_->parameters().number("duration", 1 / second, most, usual) * second));
    const std::uint64_t seed = swarm_->seed();
    GetSimulator().SetRandomSeed(static_cast<argos::UInt32>(seed ^ (seed >> 32)) + 1);
    GetSimulator().Reset();
    stop_robots();
    begin(swarm_->parameters(), seed);
    places_.begin(places());
  });
}

void ArgosSwarm::Destroy() { swarm_.reset(); }

}  // namespace swarmwright

using argos::CLoopFunctions;
using swarmwright::ArgosSwarm;
REGISTER_LOOP_FUNCTIONS(ArgosSwarm, "swarmwright")
