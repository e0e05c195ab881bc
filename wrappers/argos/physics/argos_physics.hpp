// Missions of the arena in ARGoS 3: its engine dynamics2d moves the robots.
#pragma once

#include <swarmwright/physics.hpp>
#include <swarmwright/span.hpp>

#include <cstdint>
#include <memory>

/// Robots are those of ARGoS's plug-ins where one has the mission's size, wheel base and mass (e-puck, foot-bot),
/// otherwise discs with the mission's. Episodes repeat to the bit: each begins with a new engine.
///
/// ARGoS has one simulation in a process, so there can be one object at a time: the constructor throws
/// std::logic_error for a second one.
class ArgosPhysics : public swarmwright::Physics {
 public:
  ArgosPhysics();
  ~ArgosPhysics() override;
  ArgosPhysics(const ArgosPhysics&) = delete;
  ArgosPhysics& operator=(const ArgosPhysics&) = delete;

  void start(const swarmwright::World& world, bool changed, swarmwright::Span<const swarmwright::Pose> robots,
             swarmwright::Span<const swarmwright::Pose> objects, std::uint64_t seed) override;
  void step(swarmwright::Span<const swarmwright::Motion> robots) override;
  void poses(swarmwright::Span<swarmwright::Pose> robots, swarmwright::Span<swarmwright::Pose> objects) override;
  bool has_rays() const override { return true; }
  void rays(std::uint32_t robot, swarmwright::Span<float> distances) override;

 private:
  class Simulator;
  std::unique_ptr<Simulator> simulator_;
};
