// Missions of the arena in Stage.
#pragma once

#include <swarmwright/physics.hpp>
#include <swarmwright/span.hpp>

#include <cstdint>
#include <memory>
#include <vector>

/// Robots are discs that stop where they would touch something, as Stage's models do; nothing can be pushed: start()
/// throws ParameterError for missions with objects. Rays are Stage's, in steps of its map's resolution: a quarter of
/// the smallest robot's radius, or a tenth of the shortest rays' reach if that is less. Episodes repeat to the bit.
class StagePhysics : public swarmwright::Physics {
 public:
  StagePhysics();
  ~StagePhysics() override;
  StagePhysics(const StagePhysics&) = delete;
  StagePhysics& operator=(const StagePhysics&) = delete;

  void start(const swarmwright::World& world, bool changed, swarmwright::Span<const swarmwright::Pose> robots,
             swarmwright::Span<const swarmwright::Pose> objects, std::uint64_t seed) override;
  void step(swarmwright::Span<const swarmwright::Motion> robots) override;
  void poses(swarmwright::Span<swarmwright::Pose> robots, swarmwright::Span<swarmwright::Pose> objects) override;
  bool has_rays() const override { return true; }
  void rays(std::uint32_t robot, swarmwright::Span<float> distances) override;

 private:
  class Simulator;
  // Stage cannot give a world back, so they are kept for the next episode in them.
  std::vector<std::unique_ptr<Simulator>> simulators_;
  Simulator* current_ = nullptr;
};
