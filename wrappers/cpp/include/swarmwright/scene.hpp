// What an episode looks like, for tools that show it elsewhere.
#pragma once

#include <swarmwright/error.hpp>
#include <swarmwright/span.hpp>

#include <swarmwright/swarmwright.h>

#include <cstddef>
#include <cstdint>
#include <limits>
#include <string>

namespace swarmwright {

/// One thing in a scene. It is sent with numbers of single precision.
struct Body {
  /// agent, defender, goal, exit, obstacle, or any other word.
  std::string kind;
  double x = 0;
  double y = 0;
  /// free, arrived, caught, crashed, out, or any other word.
  std::string state = {};
  /// 0 for a point.
  double radius = 0;
  /// Where it looks, from the x axis; NaN for nowhere. Bodies with a heading are drawn in their true size.
  double heading = std::numeric_limits<double>::quiet_NaN();
  /// A number that gives it a colour, see Scene::scale; NaN for none.
  double value = std::numeric_limits<double>::quiet_NaN();
  /// Which agent it is; -1: bodies of the kind agent are the agents in their order.
  std::int64_t agent = -1;
  /// A short text beside it.
  std::string label = {};
};

/// The world from above. Lengths are metres or cells, (0, 0) is at the bottom left, angles are radians,
/// counter-clockwise. All methods throw std::invalid_argument for what cannot be.
class Scene {
 public:
  explicit Scene(swarmwright_scene* scene) noexcept : scene_(scene) {}

  /// The extent of the world, first of all; `grid`: its unit is a cell; `message`: a line to show above.
  void world(float width, float height, bool grid = false, const std::string& message = {}) {
    detail::check(swarmwright_scene_world(scene_, width, height, grid, message.c_str()));
  }

  /// Where the bottom left corner is in the simulation's own coordinates: numbers beside pictures are those. Positions
  /// of the scene stay distances from that corner.
  void origin(float x, float y) { detail::check(swarmwright_scene_origin(scene_, x, y)); }

  /// Adds a body above those that are there; its number from 0.
  std::uint32_t body(const Body& source) {
    const swarmwright_body plain = {sizeof(swarmwright_body),
                                    source.kind.c_str(),
                                    source.state.c_str(),
                                    static_cast<float>(source.x),
                                    static_cast<float>(source.y),
                                    static_cast<float>(source.radius),
                                    static_cast<float>(source.heading),
                                    static_cast<float>(source.value),
                                    source.agent,
                                    source.label.c_str()};
    std::uint32_t index = 0;
    detail::check(swarmwright_scene_body(scene_, &plain, &index));
    return index;
  }

  /// Adds what a sensor looks along: `angle` from the heading of the body, `start` from its middle; reading: 0 to 1.
  void ray(std::uint32_t body, float angle, float start, float length,
           float reading = std::numeric_limits<float>::quiet_NaN()) {
    detail::check(swarmwright_scene_ray(scene_, body, angle, start, length, reading));
  }

  /// Adds a line between two bodies, of which the second hears the first.
  void link(std::uint32_t from, std::uint32_t to) { detail::check(swarmwright_scene_link(scene_, from, to)); }

  /// The colour of the whole floor, 0 black to 1 white.
  void floor(float grey) { detail::check(swarmwright_scene_patch(scene_, grey, 0, nullptr, 0, nullptr)); }

  /// Adds a circle on the floor.
  void circle(float x, float y, float radius, float grey, const std::string& name = {}) {
    const float middle[] = {x, y};
    detail::check(swarmwright_scene_patch(scene_, grey, radius, middle, 1, name.c_str()));
  }

  /// Adds a polygon on the floor; corners x, y, x, y, ... in order.
  void polygon(Span<const float> corners, float grey, const std::string& name = {}) {
    detail::check(swarmwright_scene_patch(scene_, grey, 0, corners.data(), corners.size() / 2, name.c_str()));
  }

  /// Adds a wall along points x, y, x, y, ..., or with `solid` an obstacle with these corners.
  void wall(Span<const float> points, bool solid = false) {
    detail::check(swarmwright_scene_wall(scene_, points.data(), points.size() / 2, solid));
  }

  /// Adds a lamp; intensity 0 is off.
  void light(float x, float y, float intensity = 1) { detail::check(swarmwright_scene_light(scene_, x, y, intensity)); }

  /// Chooses the look of bodies of a kind and state: #rrggbb, and circle, cross, triangle, star, square, diamond,
  /// pentagon or hexagon; empty for the default.
  void style(const std::string& kind, const std::string& state, const std::string& color, const std::string& shape) {
    detail::check(swarmwright_scene_style(scene_, kind.c_str(), state.c_str(), color.c_str(), shape.c_str()));
  }

  /// Says what the values of bodies are, and which have the first and the last colour.
  void scale(const std::string& name, float low, float high) {
    detail::check(swarmwright_scene_scale(scene_, name.c_str(), low, high));
  }

 private:
  swarmwright_scene* scene_;
};

}  // namespace swarmwright
