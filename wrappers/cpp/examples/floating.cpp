// The smallest simulator that moves the robots of missions: they go where their drives tell them, through everything.
//
//   floating --broker mqtt://localhost:1883 --id 6

#include <swarmwright/swarmwright.hpp>

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <vector>

namespace {

using swarmwright::Motion;
using swarmwright::Pose;
using swarmwright::Span;
using swarmwright::World;

class Floating : public swarmwright::Physics {
 public:
  void start(const World& world, bool /*changed*/, Span<const Pose> robots, Span<const Pose> objects,
             std::uint64_t /*seed*/) override {
    tick_ = world.tick;
    robots_.assign(robots.begin(), robots.end());
    objects_.assign(objects.begin(), objects.end());
  }

  void step(Span<const Motion> robots) override {
    for (std::size_t i = 0; i < robots.size(); ++i) {
      Pose& pose = robots_[i];
      const Motion& motion = robots[i];
      const float cos = std::cos(pose.heading);
      const float sin = std::sin(pose.heading);
      pose.x += (motion.forward * cos - motion.sideways * sin) * tick_;
      pose.y += (motion.forward * sin + motion.sideways * cos) * tick_;
      pose.heading += motion.turn * tick_;
    }
  }

  void poses(Span<Pose> robots, Span<Pose> objects) override {
    std::copy(robots_.begin(), robots_.end(), robots.begin());
    std::copy(objects_.begin(), objects_.end(), objects.begin());
  }

 private:
  float tick_ = 0;
  std::vector<Pose> robots_;
  std::vector<Pose> objects_;
};

}  // namespace

int main(int count, char** values) {
  swarmwright::PhysicsDescription floating;
  floating.title = "arena-floating";
  floating.determinism = swarmwright::Determinism::bitwise;
  floating.only_one = false;
  return swarmwright::serve_physics<Floating>(floating, count, values);
}
