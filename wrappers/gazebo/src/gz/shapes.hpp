// Rays to the shapes of a world, computed from where these are.
#pragma once

#include "names.hpp"

#include <sdf/Geometry.hh>

#include <array>
#include <cstddef>
#include <optional>
#include <string>
#include <vector>

namespace swarmwright::gazebo {

/// A shape that others meet, in the frame of its link.
class Shape {
 public:
  /// Nothing for a geometry whose surface is not known here, such as a height map.
  static std::optional<Shape> of(const sdf::Geometry& geometry, const Placement& in_link);

  void move(const Placement& link);
  /// Metres from `begin` along a vector of length 1 to the surface, 0 from inside; `length` or more if it is not met.
  double met(const Vector& begin, const Vector& along, double length) const;

 private:
  enum class Kind { box, cylinder, sphere, plane, mesh };

  double met_inside(const Vector& begin, const Vector& along) const;

  Kind kind_ = Kind::sphere;
  Vector half_;  // of a box; of a cylinder and a sphere: radius, radius, half of the length; of a plane: its normal
  double bound_ = 0;
  std::vector<std::array<Vector, 3>> triangles_;
  Placement in_link_;
  Placement at_;
};

}  // namespace swarmwright::gazebo
