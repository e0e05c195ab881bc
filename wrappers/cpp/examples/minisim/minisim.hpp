// Minisim: agents try to reach a goal before slower defenders catch them (D6.1, section 7.2.1).
//
// The results are bit-identical to those of Swarmwright's built-in Minisim: every operation is one of IEEE 754 binary32
// in the order written, until the fitness, which is summed in binary64. Sensors of an agent: the way to the goal and to
// the closest defender, each by the size of the map. Its actuator: the heading, as an angle by pi. Fitness: minus the
// mean distance to the goal at the end, 0 for those that arrived.
#pragma once

#include "functions.hpp"
#include "geometry.hpp"
#include "settings.hpp"

#include <swarmwright/swarmwright.hpp>

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <iostream>
#include <string>
#include <vector>

namespace minisim {

class Minisim final : public swarmwright::Simulation {
 public:
  swarmwright::Description description() const override {
    swarmwright::Description says;
    says.title = "minisim";
    says.sensors = 4;
    says.actuators = 1;
    says.max_agents = most_bodies;
    says.metrics = {{"arrived", "agents"}, {"caught", "agents"}, {"steps", "steps"}, {"distance", "metres"}};
    says.scenes = true;
    says.determinism = swarmwright::Determinism::bitwise;
    return says;
  }

  void reset(const swarmwright::Parameters& parameters, std::uint64_t /*seed: among the parameters*/) override {
    settings_ = Settings(parameters);
    agents_ = settings_.agents;
    defenders_ = settings_.defenders;
    states_.assign(agents_.size(), State::free);
    free_.resize(agents_.size());
    for (std::size_t i = 0; i < free_.size(); ++i) {
      free_[i] = static_cast<std::uint32_t>(i);
    }
    step_ = 0;
  }

  const std::vector<std::uint32_t>& acting() override { return settings_.steers_itself ? no_agents_ : free_; }

  bool done() override { return free_.empty(); }

  void sense(std::uint32_t agent, swarmwright::Span<float> sensors) override {
    const auto [x, y] = agents_[agent];
    const auto [width, height] = settings_.map;
    sensors[0] = (settings_.goal[0] - x) / width;
    sensors[1] = (settings_.goal[1] - y) / height;
    const Point* defender = closest_defender(agents_[agent]);
    sensors[2] = defender == nullptr ? 0.0F : ((*defender)[0] - x) / width;
    sensors[3] = defender == nullptr ? 0.0F : ((*defender)[1] - y) / height;
  }

  void step(swarmwright::Span<const float> actuators) override {
    if (free_.empty()) {
      return;
    }
    for (std::size_t i = 0; i < free_.size(); ++i) {
      Point& agent = agents_[free_[i]];
      if (settings_.steers_itself) {
        move_by_rule(agent);
      } else {
        move(agent, cos_pi(actuators[i]), sin_pi(actuators[i]));
      }
    }
    for (Point& defender : defenders_) {
      pursue(defender);
    }
    for (const std::uint32_t agent : free_) {
      judge(agent);
    }
    ++step_;
    const auto is_out = [this](std::uint32_t agent) {
      return step_ >= settings_.max_steps || states_[agent] != State::free;
    };
    free_.erase(std::remove_if(free_.begin(), free_.end(), is_out), free_.end());
  }

  double fitness() override {
    double sum = 0.0;
    for (std::size_t i = 0; i < agents_.size(); ++i) {
      if (states_[i] != State::arrived) {
        sum += static_cast<double>(distance(agents_[i], settings_.goal));
      }
    }
    return 0.0 - sum / static_cast<double>(agents_.size());
  }

  std::vector<double> metrics() override {
    return {count(State::arrived), count(State::caught), static_cast<double>(step_), 0.0 - fitness()};
  }

  std::chrono::milliseconds scene(swarmwright::Scene& scene) override {
    scene.world(settings_.map[0], settings_.map[1], false, settings_.hello_message);
    const auto add = [&scene](const char* kind, const Point& at, const char* state, float radius) {
      swarmwright::Body body;
      body.kind = kind;
      body.x = at[0];
      body.y = at[1];
      body.state = state;
      body.radius = radius;
      scene.body(body);
    };
    add("goal", settings_.goal, "", settings_.goal_radius);
    for (const Point& defender : defenders_) {
      add("defender", defender, "", settings_.capture_radius);
    }
    for (std::size_t i = 0; i < agents_.size(); ++i) {
      const State state = states_[i];
      add("agent", agents_[i], state == State::free ? "free" : state == State::arrived ? "arrived" : "caught", 0);
    }
    return settings_.frame;
  }

  std::chrono::milliseconds show() override {
    std::cout << picture() << std::endl;
    return settings_.frame;
  }

  /// The map as text: a character for each square metre, A agents, D defenders, X the goal; the origin is at the bottom
  /// left.
  std::string picture() const {
    const float scale = std::max(1.0F, std::max(settings_.map[0], settings_.map[1]) / 120.0F);
    const auto cells = [scale](float extent) { return static_cast<std::size_t>(std::ceil(extent / scale)); };
    std::vector<std::string> rows(cells(settings_.map[1]), std::string(cells(settings_.map[0]), '.'));
    const auto put = [&](const Point& at, char sign) {
      const auto cell = [scale](float value) { return static_cast<std::size_t>(value / scale); };
      const std::size_t row = rows.size() - 1 - std::min(rows.size() - 1, cell(at[1]));
      rows[row][std::min(rows[row].size() - 1, cell(at[0]))] = sign;
    };
    put(settings_.goal, 'X');
    for (const Point& defender : defenders_) {
      put(defender, 'D');
    }
    for (const Point& agent : agents_) {
      put(agent, 'A');
    }
    std::string text = settings_.hello_message + ", step " + std::to_string(step_);
    for (const std::string& row : rows) {
      text += '\n' + row;
    }
    return text;
  }

 private:
  enum class State { free, arrived, caught };

  double count(State target) const { return static_cast<double>(std::count(states_.begin(), states_.end(), target)); }

  void move(Point& agent, float x, float y) const {
    agent[0] = limit(agent[0] + settings_.speed_agents * x, settings_.map[0]);
    agent[1] = limit(agent[1] + settings_.speed_agents * y, settings_.map[1]);
  }

  void move_by_rule(Point& agent) const {
    const Point way = settings_.rule.way(agent, settings_.goal, closest_defender(agent));
    const float n = std::sqrt(way[0] * way[0] + way[1] * way[1]);
    if (n > 0.0F) {
      move(agent, way[0] / n, way[1] / n);
    }
  }

  /// A defender goes towards the closest free agent, the first of several.
  void pursue(Point& defender) const {
    const Point* target = nullptr;
    float least = 0.0F;
    for (const std::uint32_t agent : free_) {
      const float q = squared_distance(defender, agents_[agent]);
      if (target == nullptr || q < least) {
        target = &agents_[agent];
        least = q;
      }
    }
    const float d = std::sqrt(least);
    if (d <= settings_.speed_defenders) {
      defender = *target;
    } else {
      const float f = settings_.speed_defenders / d;
      const float dx = (*target)[0] - defender[0];
      const float dy = (*target)[1] - defender[1];
      defender = {defender[0] + dx * f, defender[1] + dy * f};
    }
  }

  void judge(std::uint32_t agent) {
    const Point* defender = closest_defender(agents_[agent]);
    if (distance(agents_[agent], settings_.goal) <= settings_.goal_radius) {
      states_[agent] = State::arrived;
    } else if (defender != nullptr && distance(agents_[agent], *defender) <= settings_.capture_radius) {
      states_[agent] = State::caught;
    }
  }

  const Point* closest_defender(const Point& agent) const {
    const Point* closest = nullptr;
    float least = 0.0F;
    for (const Point& defender : defenders_) {
      const float q = squared_distance(agent, defender);
      if (closest == nullptr || q < least) {
        closest = &defender;
        least = q;
      }
    }
    return closest;
  }

  Settings settings_{swarmwright::Parameters("{}")};
  std::vector<Point> agents_;
  std::vector<Point> defenders_;
  std::vector<State> states_;
  std::vector<std::uint32_t> free_;
  std::vector<std::uint32_t> no_agents_;
  std::uint32_t step_ = 0;
};

}  // namespace minisim
