// Missions' worlds in a real Gazebo: motion, walls, rays, objects; and that episodes repeat, in flat memory.
//
//   test_physics wheels|body
//   test_physics FILE: in the world of a user
//   test_physics e_puck|turtlebot3 FILE LEFT_JOINT RIGHT_JOINT [SENSOR]: with a user's model that is as large

#include "check.hpp"
#include "library.hpp"
#include "sdf_world.hpp"

#include <swarmwright/gazebo_physics.hpp>

#include <cmath>
#include <cstdint>
#include <cstdlib>
#include <cstring>
#include <fstream>
#include <iostream>
#include <random>
#include <string>
#include <vector>

namespace {

using swarmwright::Motion;
using swarmwright::Object;
using swarmwright::Point;
using swarmwright::Pose;
using swarmwright::RobotModel;
using swarmwright::World;
using swarmwright::gazebo::GazeboPhysics;

constexpr float pi = 3.14159265F;
constexpr float radius = 0.035F;

RobotModel e_puck() {
  RobotModel model = {};
  model.radius = radius;
  model.height = 0.086F;
  model.mass = 0.4F;
  model.wheel_base = 0.053F;
  model.top_speed = 0.12F;
  model.acceleration = 3.75F;
  model.ray_start = radius;
  model.ray_range = 0.1F;
  for (const float degrees : {-17.F, -49.F, -90.F, -150.F, 150.F, 90.F, 49.F, 17.F, 0.F}) {
    model.rays.push_back(degrees * pi / 180);
  }
  return model;
}

/// A square arena of `half` metres to each side, with a box of 0.4 x 0.05 m above its middle.
World square_arena(std::size_t robots, float half) {
  World world = {};
  world.tick = 0.1F;
  world.walls.push_back({{{-half, -half}, {half, -half}, {half, half}, {-half, half}}, 0.08F});
  world.walls.push_back({{{-0.2F, 0.3F}, {0.2F, 0.3F}, {0.2F, 0.35F}, {-0.2F, 0.35F}}, 0.08F});
  world.models.push_back(e_puck());
  world.robots.assign(robots, 0);
  return world;
}

/// The poses of the robots, then of the objects, after some ticks with the same motion for all.
std::vector<Pose> driven(GazeboPhysics& physics, const World& world, const std::vector<Pose>& robots,
                         const std::vector<Pose>& objects, Motion motion, int ticks) {
  physics.start(world, true, robots, objects, 1);
  const std::vector<Motion> motions(robots.size(), motion);
  for (int tick = 0; tick < ticks; ++tick) {
    physics.step(motions);
  }
  std::vector<Pose> at(robots);
  std::vector<Pose> pushed(objects);
  physics.poses(at, pushed);
  at.insert(at.end(), pushed.begin(), pushed.end());
  return at;
}

/// Checks that a number is near another one.
void near(float actual, float expected, float tolerance, int line) {
  if (!(std::abs(actual - expected) <= tolerance)) {
    check::equal(actual, expected, __FILE__, line);
  }
}
#define NEAR(found, expected, tolerance) near((found), (expected), (tolerance), __LINE__)

void robots_go_as_their_drives_are_told() {
  GazeboPhysics physics;
  const World world = square_arena(1, 1);
  const Pose ahead = driven(physics, world, {{-0.5F, -0.3F, 0}}, {}, {0.1F, 0, 0}, 50)[0];
  NEAR(ahead.x, 0, 0.01F);
  NEAR(ahead.y, -0.3F, 0.01F);
  const Pose turned = driven(physics, world, {{-0.5F, -0.3F, 1}}, {}, {0, 0, 1}, 10)[0];
  NEAR(turned.heading, 2, 0.05F);
  NEAR(turned.x, -0.5F, 0.003F);
  const Pose left = driven(physics, world, {{0, -0.3F, pi / 2}}, {}, {0.1F, 0, 0.5F}, 20)[0];  // an arc of 0.2 m radius
  NEAR(left.x, -0.2F * (1 - std::cos(1.F)), 0.02F);
  NEAR(left.y, -0.3F + 0.2F * std::sin(1.F), 0.02F);
}

void robots_without_wheels_go_in_any_direction() {
  GazeboPhysics physics;
  World world = square_arena(1, 1);
  world.models[0].wheel_base = 0;
  const Pose pose = driven(physics, world, {{0, 0, pi / 2}}, {}, {0, 0.1F, 0}, 30)[0];
  NEAR(pose.x, -0.3F, 0.01F);
  NEAR(pose.y, 0, 0.01F);
  NEAR(pose.heading, pi / 2, 0.03F);
}

void walls_hold_robots() {
  GazeboPhysics physics;
  const World world = square_arena(1, 0.5F);
  NEAR(driven(physics, world, {{0.3F, 0, 0}}, {}, {0.12F, 0, 0}, 60)[0].x, 0.5F - radius, 0.003F);
  NEAR(driven(physics, world, {{0, -0.3F, -pi / 2}}, {}, {0.12F, 0, 0}, 60)[0].y, radius - 0.5F, 0.003F);
  NEAR(driven(physics, world, {{0, 0.1F, pi / 2}}, {}, {0.12F, 0, 0}, 60)[0].y, 0.3F - radius, 0.003F);
}

void sides_of_any_polygon_hold_robots() {
  GazeboPhysics physics;
  World world = square_arena(1, 1);
  world.walls.resize(1);
  // An L, whose inner corner is at (0, 0), and a triangle.
  world.walls[0].points = {{-1, -1}, {1, -1}, {1, 0}, {0, 0}, {0, 1}, {-1, 1}};
  world.walls.push_back({{{-0.8F, 0.2F}, {-0.4F, 0.2F}, {-0.6F, 0.5F}}, 0.08F});
  NEAR(driven(physics, world, {{0.5F, -0.3F, pi / 2}}, {}, {0.12F, 0, 0}, 60)[0].y, -radius, 0.003F);
  NEAR(driven(physics, world, {{-0.3F, 0.6F, 0}}, {}, {0.12F, 0, 0}, 60)[0].x, -radius, 0.003F);
  NEAR(driven(physics, world, {{-0.6F, -0.1F, pi / 2}}, {}, {0.12F, 0, 0}, 60)[0].y, 0.2F - radius, 0.003F);
  // Past the inner corner, where no wall is.
  NEAR(driven(physics, world, {{-0.5F, -0.05F, 0}}, {}, {0.12F, 0, 0}, 60)[0].x, 0.22F, 0.015F);
}

void rays_measure_distances() {
  GazeboPhysics physics;
  const World world = square_arena(2, 0.5F);
  // The first looks at the wall to the right, 0.05 m from its rim; the second is 0.02 m behind it.
  const float x = 0.5F - radius - 0.05F;
  driven(physics, world, {{x, 0, 0}, {x - 2 * radius - 0.02F, 0, 0}}, {}, {0, 0, 0}, 3);
  std::vector<float> seen(9);
  physics.rays(0, seen);
  NEAR(seen[8], 0.05F, 0.002F);
  NEAR(seen[0], (0.05F + radius) / std::cos(17 * pi / 180) - radius, 0.002F);
  NEAR(seen[1], (0.05F + radius) / std::cos(49 * pi / 180) - radius, 0.002F);
  NEAR(seen[2], 0.1F, 0);
  NEAR(seen[5], 0.1F, 0);
  physics.rays(1, seen);
  NEAR(seen[8], 0.02F, 0.002F);
  NEAR(seen[4], 0.1F, 0);
  // Where two touch, the distance is 0.
  driven(physics, world, {{0, 0, 0}, {2 * radius, 0, pi}}, {}, {0.05F, 0, 0}, 5);
  physics.rays(0, seen);
  NEAR(seen[8], 0, 0.002F);
}

void robots_push_what_is_light_enough() {
  GazeboPhysics physics;
  World world = square_arena(1, 1);
  Object disc = {};
  disc.radius = 0.1F;
  disc.height = 0.08F;
  disc.mass = 0.3F;
  disc.friction = 0.2F;
  world.objects.push_back(disc);
  Object box = disc;
  box.radius = 0;
  box.width = box.depth = 0.1F;
  world.objects.push_back(box);
  const std::vector<Pose> objects{{-0.2F, -0.3F, 0}, {0.5F, 0.6F, 1}};
  const std::vector<Pose> after = driven(physics, world, {{-0.5F, -0.3F, 0}}, objects, {0.1F, 0, 0}, 60);
  // 0.165 m until they touch, then together.
  NEAR(after[1].x - after[0].x, 0.1F + radius, 0.01F);
  NEAR(after[0].x, 0.09F, 0.03F);
  NEAR(after[2].x, 0.5F, 0.001F);
  NEAR(after[2].heading, 1, 0.01F);
  if (!swarmwright::gazebo::settings().wheels) {
    return;  // what has the velocity of its drive pushes everything
  }
  world.objects[0].mass = 4;  // friction of 7.8 N, the drive has 1.5 N
  NEAR(driven(physics, world, {{-0.5F, -0.3F, 0}}, objects, {0.1F, 0, 0}, 40)[1].x, -0.2F, 0.02F);
}

std::uint64_t mixed(std::uint64_t hash, float value) {
  std::uint32_t bits = 0;
  std::memcpy(&bits, &value, sizeof(bits));
  return (hash ^ bits) * 1099511628211U;
}

/// An episode of robots that drive about and collide, tick by tick.
class Episode {
 public:
  Episode(GazeboPhysics& physics, const World& world, bool changed, unsigned seed)
      : physics_(physics), random_(seed), robots_(world.robots.size()), motions_(world.robots.size()) {
    const auto side = static_cast<std::size_t>(std::ceil(std::sqrt(static_cast<double>(robots_.size()))));
    const float half = -world.walls[0].points[0].x;
    for (std::size_t i = 0; i < robots_.size(); ++i) {
      const auto place = [&](std::size_t at) {
        return half * (2 * static_cast<float>(at) + 1) / static_cast<float>(side) - half;
      };
      robots_[i] = {place(i % side), place(i / side), number(-pi, pi)};
    }
    physics_.start(world, changed, robots_, {}, seed);
  }

  void tick() {
    for (Motion& motion : motions_) {
      motion = {number(0, 0.12F), 0, number(-2, 2)};
    }
    physics_.step(motions_);
    physics_.poses(robots_, {});
    std::vector<float> seen(9);
    for (std::size_t i = 0; i < robots_.size(); ++i) {
      hash_ = mixed(mixed(mixed(hash_, robots_[i].x), robots_[i].y), robots_[i].heading);
      physics_.rays(static_cast<std::uint32_t>(i), seen);
      for (const float distance : seen) {
        hash_ = mixed(hash_, distance);
      }
    }
  }

  std::uint64_t after(int ticks) {
    for (int i = 0; i < ticks; ++i) {
      tick();
    }
    return hash_;
  }

 private:
  float number(float low, float high) { return low + (high - low) * static_cast<float>(random_() >> 8) / 16777216.F; }

  GazeboPhysics& physics_;
  std::mt19937 random_;
  std::vector<Pose> robots_;
  std::vector<Motion> motions_;
  std::uint64_t hash_ = 14695981039346656037U;
};

void episodes_repeat_to_the_bit(const World& world) {
  GazeboPhysics physics;
  const std::uint64_t expected = Episode(physics, world, true, 1).after(60);
  const std::uint64_t other = Episode(physics, world, false, 2).after(45);
  CHECK_EQUAL(expected == other, false);
  CHECK_EQUAL(Episode(physics, world, false, 1).after(60), expected);
  // Another world, then the first again.
  Episode(physics, square_arena(3, 0.5F), true, 1).after(5);
  CHECK_EQUAL(Episode(physics, world, true, 1).after(60), expected);
  if (!swarmwright::gazebo::traits.bitwise) {
    return;
  }
  // Beside another one, tick by tick.
  GazeboPhysics second;
  Episode here(physics, world, false, 1);
  Episode there(second, world, true, 2);
  for (int i = 0; i < 45; ++i) {
    here.tick();
    there.tick();
  }
  CHECK_EQUAL(here.after(15), expected);
  CHECK_EQUAL(there.after(0), other);
}

long resident_kilobytes() {
  std::ifstream file("/proc/self/statm");
  long all = 0;
  long resident = 0;
  file >> all >> resident;
  return resident * 4;
}

void memory_is_flat_in_episodes(unsigned episodes) {
  if (!swarmwright::gazebo::traits.has_master) {
    return;  // not measured yet with Gazebo Fortress
  }
  const World world = square_arena(9, 0.5F);  // no other test has run it: Gazebo records what is later than ever before
  const World other = square_arena(4, 0.5F);
  GazeboPhysics physics;
  long before = 0;
  for (unsigned i = 0; i < episodes; ++i) {
    // Every hundredth is of another mission, and the first one comes back.
    Episode(physics, i % 100 == 99 ? other : world, i % 100 == 0 || i % 100 == 99, i % 7).after(3);
    if (i == episodes / 2) {
      before = resident_kilobytes();
    }
  }
  const long grown = resident_kilobytes() - before;
  std::cerr << episodes << " episodes: " << grown << " kB more" << std::endl;
  CHECK_EQUAL(grown < 2000, true);
}

// The yard: a column of 0.1 m radius at (0, -0.5), a crate at (0.5, 0.5), a gate from (-0.5, 0.5) to (-0.5, 0.78).

void the_users_world_is_met_and_seen() {
  GazeboPhysics physics;
  const World world = square_arena(1, 1);
  CHECK_EQUAL(swarmwright::gazebo::steps_in_tick(world), 20U);
  // The wall of the mission, and the column.
  NEAR(driven(physics, world, {{0.7F, 0, 0}}, {}, {0.12F, 0, 0}, 40)[0].x, 1 - radius, 0.003F);
  NEAR(driven(physics, world, {{-0.3F, -0.5F, 0}}, {}, {0.12F, 0, 0}, 40)[0].x, -0.1F - radius, 0.003F);
  driven(physics, world, {{-0.1F - radius - 0.05F, -0.5F, 0}}, {}, {0, 0, 0}, 3);
  std::vector<float> seen(9);
  physics.rays(0, seen);
  NEAR(seen[8], 0.05F, 0.002F);
  NEAR(seen[2], 0.1F, 0);
  // A crate of 0.3 N friction is pushed away and is back in the next episode.
  const float crate = 0.5F - 0.05F * (std::cos(0.3F) + std::sin(0.3F));
  NEAR(driven(physics, world, {{0.2F, 0.5F, 0}}, {}, {0.12F, 0, 0}, 50)[0].x, 0.8F, 0.05F);
  driven(physics, world, {{crate - radius - 0.05F, 0.5F, 0}}, {}, {0, 0, 0}, 3);
  physics.rays(0, seen);
  CHECK_EQUAL(seen[8] > 0.045F && seen[8] < 0.075F, true);
}

void what_fell_asleep_is_awake_in_the_next_episode() {
  GazeboPhysics physics;
  const World world = square_arena(1, 1);
  const auto pushed = [&] { return driven(physics, world, {{0.38F, 0.48F, 0}}, {}, {0.12F, 0, 0.1F}, 30)[0]; };
  const Pose first = pushed();
  driven(physics, world, {{-0.7F, -0.7F, 0}}, {}, {0, 0, 0}, 60);
  const Pose second = pushed();
  CHECK_EQUAL(first.x == second.x && first.y == second.y && first.heading == second.heading, true);
}

void the_walls_of_missions_can_be_left_out() {
  swarmwright::gazebo::settings().walls = false;
  GazeboPhysics physics;
  const World world = square_arena(1, 1);
  NEAR(driven(physics, world, {{0.7F, 0, 0}}, {}, {0.12F, 0, 0}, 40)[0].x, 1.18F, 0.01F);
  swarmwright::gazebo::settings().walls = true;
}

void robots_do_not_begin_in_the_users_world() {
  GazeboPhysics physics;
  const World world = square_arena(2, 1);
  std::string text;
  try {
    driven(physics, world, {{0.5F, -0.5F, 0}, {0.05F, -0.5F, 0}}, {}, {0, 0, 0}, 1);
  } catch (const swarmwright::ParameterError& error) {
    text = error.what();
  }
  CHECK_EQUAL(text.find("robot 1 begins at x = 0.05, y = -0.5 in the model \"column\" of ") != std::string::npos, true);
  // The next episode is as good as any.
  NEAR(driven(physics, world, {{0.5F, -0.5F, 0}, {0.7F, -0.5F, 0}}, {}, {0.1F, 0, 0}, 1)[1].x, 0.71F, 0.003F);
}

RobotModel turtlebot3() {
  RobotModel model = {};
  model.radius = 0.105F;
  model.height = 0.192F;
  model.mass = 1;
  model.wheel_base = 0.16F;
  model.top_speed = 0.22F;
  model.acceleration = 2.5F;
  model.ray_start = 0.105F;
  model.ray_range = 3.5F;
  for (int degrees = -170; degrees <= 180; degrees += 10) {
    model.rays.push_back(static_cast<float>(degrees) * pi / 180);
  }
  return model;
}

void larger_robots_go_as_their_drives_are_told() {
  GazeboPhysics physics;
  World world = square_arena(1, 2);
  world.models[0] = turtlebot3();
  const Pose ahead = driven(physics, world, {{-1, -1, 0}}, {}, {0.2F, 0, 0}, 50)[0];
  NEAR(ahead.x, 0, 0.02F);
  NEAR(ahead.y, -1, 0.01F);
  const Pose turned = driven(physics, world, {{-1, -1, 1}}, {}, {0, 0, 1}, 10)[0];
  NEAR(turned.heading, 2, 0.05F);
  NEAR(turned.x, -1, 0.01F);
  const Pose left = driven(physics, world, {{0, -1, pi / 2}}, {}, {0.2F, 0, 0.5F}, 20)[0];  // an arc of 0.4 m radius
  NEAR(left.x, -0.4F * (1 - std::cos(1.F)), 0.03F);
  NEAR(left.y, -1 + 0.4F * std::sin(1.F), 0.03F);
}

void larger_robots_measure_distances() {
  GazeboPhysics physics;
  World world = square_arena(2, 2);
  world.walls.resize(1);
  world.models[0] = turtlebot3();
  driven(physics, world, {{1, 0.5F, 0}, {1, -0.5F, pi / 2}}, {}, {0, 0, 0}, 3);
  std::vector<float> seen(36);
  physics.rays(0, seen);
  NEAR(seen[17], 1 - 0.105F, 0.01F);     // ahead: the wall
  NEAR(seen[26], 1.5F - 0.105F, 0.01F);  // to the left: the other wall
  NEAR(seen[35], 3 - 0.105F, 0.01F);     // behind
  NEAR(seen[20], 1 / std::cos(30 * pi / 180) - 0.105F, 0.03F);
  CHECK_EQUAL(seen[8] > 0.75F && seen[8] < 0.95F, true);  // to the right: the other robot, which is 1 m away
}

}  // namespace

int main(int count, char** values) {
  const std::string option = count < 2 ? "wheels" : values[1];
  if (count > 4) {
    swarmwright::gazebo::settings().model =
        swarmwright::gazebo::user_model({values[2], values[3], values[4], count > 5 ? values[5] : ""});
    if (option == "e_puck") {
      robots_go_as_their_drives_are_told();
      walls_hold_robots();
      sides_of_any_polygon_hold_robots();
      rays_measure_distances();
      robots_push_what_is_light_enough();
      episodes_repeat_to_the_bit(square_arena(10, 0.5F));
      memory_is_flat_in_episodes(250);
    } else {
      larger_robots_go_as_their_drives_are_told();
      larger_robots_measure_distances();
    }
    std::_Exit(check::status());
  }
  if (option != "wheels" && option != "body") {
    swarmwright::gazebo::settings().world = swarmwright::gazebo::user_world(option);
    the_users_world_is_met_and_seen();
    what_fell_asleep_is_awake_in_the_next_episode();
    the_walls_of_missions_can_be_left_out();
    robots_do_not_begin_in_the_users_world();
    episodes_repeat_to_the_bit(square_arena(16, 0.8F));
    memory_is_flat_in_episodes(1000);
    std::_Exit(check::status());
  }
  swarmwright::gazebo::settings().wheels = option != "body";
  robots_go_as_their_drives_are_told();
  robots_without_wheels_go_in_any_direction();
  walls_hold_robots();
  sides_of_any_polygon_hold_robots();
  rays_measure_distances();
  robots_push_what_is_light_enough();
  episodes_repeat_to_the_bit(square_arena(10, 0.5F));
  memory_is_flat_in_episodes(1000);
  std::_Exit(check::status());
}
