// Loop functions with a fitness and a metric; docs/how-to/simulators.md shows how to build them.
#include <swarmwright/argos.hpp>

#include <argos3/core/simulator/entity/embodied_entity.h>

#include <cmath>

/// Sum over all ticks of the mean distance of the robots from a point; less is better.
class Gathering : public swarmwright::ArgosSwarm {
 public:
  std::vector<swarmwright::Metric> metrics() override { return {{"distance", "metres", "mean distance to the point"}}; }

  void begin(const swarmwright::Parameters& parameters, std::uint64_t /*seed*/) override {
    x_ = parameters.number("x", -2, 2, 0);
    sum_ = 0;
  }

  void tick() override {
    for (const argos::CEmbodiedEntity* robot : robots()) {
      const argos::CVector3& position = robot->GetOriginAnchor().Position;
      sum_ += std::hypot(position.GetX() - x_, position.GetY()) / static_cast<double>(robots().size());
    }
  }

  double fitness() override { return -sum_; }
  std::vector<double> measure() override { return {sum_}; }

 private:
  double x_ = 0;
  double sum_ = 0;
};

using argos::CLoopFunctions;
REGISTER_LOOP_FUNCTIONS(Gathering, "gathering")
