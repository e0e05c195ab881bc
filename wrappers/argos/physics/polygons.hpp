// Polygons as convex parts.
#pragma once

#include <swarmwright/physics.hpp>

#include <vector>

/// Corners x, y in double precision.
struct Corner {
  double x;
  double y;
};

/// A convex polygon, counter-clockwise.
using Convex = std::vector<Corner>;

/// The sides of a polygon as boxes outside it, so that what is inside stays there.
std::vector<Convex> fence(const swarmwright::Wall& outline, double thickness);

/// What is inside a polygon: itself where it is convex, else triangles.
std::vector<Convex> filled(const swarmwright::Wall& obstacle);
