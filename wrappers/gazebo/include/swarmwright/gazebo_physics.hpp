// Missions of the arena in Gazebo.
#pragma once

#include <swarmwright/physics.hpp>

#include <cstdint>
#include <memory>
#include <vector>

namespace swarmwright::gazebo {

/// Motion, collisions and proximity rays of Gazebo for missions of the arena.
///
/// Every object has a world of its own; Gazebo computes one at a time, in whichever thread. With Gazebo classic the
/// same world, poses and motions give the same poses and rays, to the bit, after any episodes and beside others; with
/// Gazebo Fortress after any episodes of this process.
class GazeboPhysics : public Physics {
 public:
  GazeboPhysics();
  ~GazeboPhysics() override;
  GazeboPhysics(const GazeboPhysics&) = delete;
  GazeboPhysics& operator=(const GazeboPhysics&) = delete;

  /// Throws GazeboError if Gazebo cannot be started or cannot make the world, ParameterError if a robot begins in
  /// something of the user's world.
  void start(const World& world, bool changed, Span<const Pose> robots, Span<const Pose> objects,
             std::uint64_t seed) override;
  /// Throws GazeboError if a robot or an object has left the ground.
  void step(Span<const Motion> robots) override;
  void poses(Span<Pose> robots, Span<Pose> objects) override;
  bool has_rays() const override;
  void rays(std::uint32_t robot, Span<float> distances) override;

 private:
  class Place;
  static std::vector<std::unique_ptr<Place>>& idle();
  void leave();

  std::unique_ptr<Place> place_;
};

}  // namespace swarmwright::gazebo
