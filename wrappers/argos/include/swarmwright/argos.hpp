// Experiments of ARGoS 3 as simulations: loop functions to derive from.
//
//   class Gathering : public swarmwright::ArgosSwarm { ... double fitness() override; };
//   REGISTER_LOOP_FUNCTIONS(Gathering, "gathering")
//
// How to use it: docs/how-to/simulators.md.
#pragma once

#include <swarmwright/swarm.hpp>

#include <argos3/core/simulator/loop_functions.h>

#include <cstddef>
#include <cstdint>
#include <memory>
#include <string>
#include <vector>

namespace argos {
class CEmbodiedEntity;
}  // namespace argos

namespace swarmwright {

class ArgosController;

/// Offers the experiment that ARGoS has loaded. Its robots with the controller swarmwright_controller are the agents;
/// an episode lasts as long as the file says (framework, experiment, length), or as many seconds as the parameter
/// `duration`.
///
/// Derived classes may override Init, Reset, PreStep, PostStep and Destroy, and call these ones in them: at first in
/// Init and PostStep, at the end in Destroy.
class ArgosSwarm : public argos::CLoopFunctions {
 public:
  ArgosSwarm();
  ~ArgosSwarm() override;
  ArgosSwarm(const ArgosSwarm&) = delete;
  ArgosSwarm& operator=(const ArgosSwarm&) = delete;

  void Init(argos::TConfigurationNode& tree) override;
  void PostStep() override;
  void Destroy() override;

 protected:
  /// What the experiment measures beside `way`, `distance_to_center`, `nearest_distance` and `order`; it does not
  /// change.
  virtual std::vector<Metric> metrics() { return {}; }

  /// An episode begins: the robots are where Reset has put them. Throws ParameterError for parameters that cannot be
  /// used.
  virtual void begin(const Parameters& /*parameters*/, std::uint64_t /*seed*/) {}

  /// After each tick of an episode.
  virtual void tick() {}

  /// Whether the episode ends before its time. Not IsExperimentFinished, which ends ARGoS.
  virtual bool done() { return false; }

  /// At its end: larger is better.
  virtual double fitness() { return -places_.values()[1]; }

  /// At its end, in the order of metrics().
  virtual std::vector<double> measure() { return {}; }

  /// The agents, by their ids.
  const std::vector<argos::CEmbodiedEntity*>& robots() const { return bodies_; }

 private:
  void find_robots();
  std::vector<Place> places() const;
  void rest();
  void start();
  void stop_robots();

  std::unique_ptr<Swarm> swarm_;
  std::vector<ArgosController*> controllers_;
  std::vector<argos::CEmbodiedEntity*> bodies_;
  std::vector<float> sensors_;
  std::size_t own_metrics_ = 0;
  PlaceMetrics places_;
  /// Ticks of the episode.
  argos::UInt32 length_ = 0;
  argos::UInt32 usual_length_ = 0;
};

}  // namespace swarmwright
