#include "polygons.hpp"

#include <algorithm>
#include <cmath>
#include <cstddef>

namespace {

/// Twice the area of the triangle a, b, c; positive where it turns left.
double turn(const Corner& a, const Corner& b, const Corner& c) {
  return (b.x - a.x) * (c.y - a.y) - (b.y - a.y) * (c.x - a.x);
}

Convex counter_clockwise(const swarmwright::Wall& wall) {
  Convex corners;
  for (const swarmwright::Point& point : wall.points) {
    corners.push_back({static_cast<double>(point.x), static_cast<double>(point.y)});
  }
  double area = 0;
  for (std::size_t i = 0; i < corners.size(); ++i) {
    const Corner& next = corners[(i + 1) % corners.size()];
    area += corners[i].x * next.y - next.x * corners[i].y;
  }
  if (area < 0) {
    std::reverse(corners.begin(), corners.end());
  }
  return corners;
}

bool is_inside(const Corner& point, const Corner& a, const Corner& b, const Corner& c) {
  return turn(a, b, point) >= 0 && turn(b, c, point) >= 0 && turn(c, a, point) >= 0;
}

bool is_ear(const Convex& corners, std::size_t middle) {
  const std::size_t before = (middle + corners.size() - 1) % corners.size();
  const std::size_t after = (middle + 1) % corners.size();
  if (turn(corners[before], corners[middle], corners[after]) <= 0) {
    return false;
  }
  for (std::size_t i = 0; i < corners.size(); ++i) {
    if (i != before && i != middle && i != after &&
        is_inside(corners[i], corners[before], corners[middle], corners[after])) {
      return false;
    }
  }
  return true;
}

}  // namespace

std::vector<Convex> fence(const swarmwright::Wall& outline, double thickness) {
  const Convex corners = counter_clockwise(outline);
  const std::size_t count = corners.size();
  std::vector<Convex> boxes;
  for (std::size_t i = 0; i < count; ++i) {
    const Corner& a = corners[i];
    const Corner& b = corners[(i + 1) % count];
    const double length = std::hypot(b.x - a.x, b.y - a.y);
    if (length <= 0) {
      continue;
    }
    const Corner along = {(b.x - a.x) / length * thickness, (b.y - a.y) / length * thickness};
    const Corner out = {along.y, -along.x};
    // Where the outline turns outward, a longer box would reach into it.
    const bool longer_before = turn(corners[(i + count - 1) % count], a, b) > 0;
    const bool longer_after = turn(a, b, corners[(i + 2) % count]) > 0;
    const Corner first = longer_before ? Corner{a.x - along.x, a.y - along.y} : a;
    const Corner last = longer_after ? Corner{b.x + along.x, b.y + along.y} : b;
    boxes.push_back({first, {first.x + out.x, first.y + out.y}, {last.x + out.x, last.y + out.y}, last});
  }
  return boxes;
}

std::vector<Convex> filled(const swarmwright::Wall& obstacle) {
  Convex corners = counter_clockwise(obstacle);
  const auto is_convex = [&corners] {
    for (std::size_t i = 0; i < corners.size(); ++i) {
      if (turn(corners[i], corners[(i + 1) % corners.size()], corners[(i + 2) % corners.size()]) <= 0) {
        return false;
      }
    }
    return true;
  };
  std::vector<Convex> parts;
  while (corners.size() > 3 && !is_convex()) {
    std::size_t ear = 0;
    while (ear < corners.size() && !is_ear(corners, ear)) {
      ++ear;
    }
    // Corners in one line are not an ear; they add nothing.
    const std::size_t cut = ear < corners.size() ? ear : 0;
    const Convex part = {corners[(cut + corners.size() - 1) % corners.size()], corners[cut],
                         corners[(cut + 1) % corners.size()]};
    if (turn(part[0], part[1], part[2]) > 0) {
      parts.push_back(part);
    }
    corners.erase(corners.begin() + static_cast<std::ptrdiff_t>(cut));
  }
  if (corners.size() >= 3 && is_convex()) {
    parts.push_back(corners);
  }
  return parts;
}
