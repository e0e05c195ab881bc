// Points of the map, in binary32.
#pragma once

#include <swarmwright/parameters.hpp>

#include <cmath>

namespace minisim {

using Point = swarmwright::Position;

inline float squared_distance(const Point& from, const Point& to) {
  const float dx = to[0] - from[0];
  const float dy = to[1] - from[1];
  return dx * dx + dy * dy;
}

inline float distance(const Point& from, const Point& to) { return std::sqrt(squared_distance(from, to)); }

/// Into 0..high.
inline float limit(float value, float high) {
  value = value < 0.0F ? 0.0F : value;
  return value > high ? high : value;
}

}  // namespace minisim
