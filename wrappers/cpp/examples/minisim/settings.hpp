// Parameters of Minisim, checked, with the positions at the start. The defaults are the example of D6.1.
#pragma once

#include "geometry.hpp"

#include <swarmwright/parameters.hpp>

#include <chrono>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <optional>
#include <string>
#include <vector>

namespace minisim {

/// A steering rule: towards the goal, and around the closest defender.
struct Rule {
  enum class Evasion { away, left, right };

  float avoidance = 1.0F;
  float radius = 2.0F;
  Evasion evasion = Evasion::away;

  /// The direction of an agent, of any length; `defender` is the closest one, null if there is none.
  Point way(const Point& from, const Point& goal, const Point* defender) const {
    const float d = distance(from, goal);
    Point way{0.0F, 0.0F};
    if (d > 0.0F) {
      way = {(goal[0] - from[0]) / d, (goal[1] - from[1]) / d};
    }
    const float r = defender == nullptr ? 0.0F : distance(from, *defender);
    if (r > 0.0F && r < radius) {
      const Point e{(*defender)[0] - from[0], (*defender)[1] - from[1]};
      const Point v = evasion == Evasion::away   ? Point{-e[0], -e[1]}
                      : evasion == Evasion::left ? Point{-e[1], e[0]}
                                                 : Point{e[1], -e[0]};
      const float s = avoidance * (1.0F - r / radius);
      way[0] = way[0] + s * (v[0] / r);
      way[1] = way[1] + s * (v[1] / r);
    }
    return way;
  }
};

/// The largest number of agents, and of defenders.
constexpr std::uint32_t most_bodies = 100000;

/// The settings of an episode.
class Settings {
 public:
  explicit Settings(const swarmwright::Parameters& read)
      : map{extent(read, "mapWidth", 13), extent(read, "mapHeight", 7)},
        speed_agents(not_negative(read, "speedAgents", 1.0F)),
        speed_defenders(not_negative(read, "speedDefenders", 0.33F)),
        goal(read.position("goal", map[0], map[1]).value_or(Point{map[0] - 0.5F, map[1] / 2.0F})),
        hello_message(read.text("helloMessage", "Welcome to minisim")),
        frame(read.integer("stepSize", 0, 3600000, 250)),
        max_steps(read.integer<std::uint32_t>("maxSteps", 1, 10000000, 15)),
        capture_radius(not_negative(read, "captureRadius", 0.5F)),
        goal_radius(not_negative(read, "goalRadius", 0.5F)),
        steers_itself(read.choice("steering", {"controller", "rule"}) == 1),
        rule{not_negative(read, "avoidance", 1.0F), not_negative(read, "avoidanceRadius", 2.0F),
             static_cast<Rule::Evasion>(read.choice("evasion", {"away", "left", "right"}))} {
    const std::uint64_t seed = read.seed("seed");
    const bool random = read.choice("placement", {"fixed", "random"}) == 1;
    agents = listed(read, "agents", "numAgents", 1);
    if (agents.empty()) {
      place(agents, read.integer<std::uint32_t>("numAgents", 1, most_bodies, 1), [&](std::uint32_t i, std::uint32_t n) {
        return random ? Point{uniform(seed, 0, 2 * i) * (map[0] / 3.0F), uniform(seed, 0, 2 * i + 1) * map[1]}
                      : Point{0.5F, spread(i, n)};
      });
    }
    defenders = listed(read, "defenders", "numDefenders", 0);
    if (defenders.empty() && !read.has("defenders")) {
      const float third = map[0] / 3.0F;
      place(defenders, read.integer<std::uint32_t>("numDefenders", 0, most_bodies, 1),
            [&](std::uint32_t i, std::uint32_t n) {
              return random ? Point{third + uniform(seed, 1, 2 * i) * third, uniform(seed, 1, 2 * i + 1) * map[1]}
                            : Point{map[0] * 8.0F / 13.0F, spread(i, n)};
            });
    }
  }

  /// Width and height, metres.
  Point map;
  float speed_agents;
  float speed_defenders;
  std::vector<Point> agents;
  std::vector<Point> defenders;
  Point goal;
  std::string hello_message;
  std::chrono::milliseconds frame;
  std::uint32_t max_steps;
  float capture_radius;
  float goal_radius;
  bool steers_itself;
  Rule rule;

 private:
  /// Far below 2^24, so that every whole number is a float.
  static float extent(const swarmwright::Parameters& read, const char* name, int absent) {
    return static_cast<float>(read.integer(name, 1, 1000000, absent));
  }

  static float not_negative(const swarmwright::Parameters& read, const char* name, float absent) {
    return read.single(name, 0.0F, std::numeric_limits<float>::infinity(), absent);
  }

  /// The positions in a list; empty if there is none.
  std::vector<Point> listed(const swarmwright::Parameters& read, const char* list, const char* number,
                            std::uint32_t least) const {
    const std::optional<std::vector<Point>> positions = read.positions(list, most_bodies, map[0], map[1]);
    if (!positions) {
      return {};
    }
    if (positions->size() < least) {
      throw swarmwright::ParameterError(list, "an empty list found, expected at least one position [x, y]");
    }
    const auto length = static_cast<std::uint32_t>(positions->size());
    const auto count = read.integer<std::uint32_t>(number, least, most_bodies, length);
    if (count != length) {
      throw swarmwright::ParameterError(list, std::to_string(length) + " positions found, but " + number + " is " +
                                                  std::to_string(count) + "; make them agree or leave one out");
    }
    return *positions;
  }

  template <class Start>
  static void place(std::vector<Point>& bodies, std::uint32_t count, Start&& start) {
    for (std::uint32_t i = 0; i < count; ++i) {
      bodies.push_back(start(i, count));
    }
  }

  /// Evenly from bottom to top.
  float spread(std::uint32_t i, std::uint32_t count) const {
    return static_cast<float>(i + 1) * map[1] / static_cast<float>(count + 1);
  }

  /// SplitMix64 (Steele, Lea and Flood 2014): the output for the state x.
  static std::uint64_t splitmix(std::uint64_t x) {
    std::uint64_t z = x + 0x9E3779B97F4A7C15U;
    z = (z ^ (z >> 30U)) * 0xBF58476D1CE4E5B9U;
    z = (z ^ (z >> 27U)) * 0x94D049BB133111EBU;
    return z ^ (z >> 31U);
  }

  /// A float in 0..1, a multiple of 2^-24, that depends on a counter alone.
  static float uniform(std::uint64_t seed, std::uint64_t stream, std::uint64_t index) {
    const std::uint64_t bits = splitmix(splitmix(splitmix(seed) ^ stream) ^ index);
    return static_cast<float>(bits >> 40U) / 16777216.0F;
  }
};

}  // namespace minisim
