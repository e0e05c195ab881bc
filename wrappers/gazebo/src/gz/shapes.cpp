#include "shapes.hpp"

#include "library.hpp"

#include <ignition/common/Mesh.hh>
#include <ignition/common/MeshManager.hh>
#include <ignition/common/SubMesh.hh>

#include <sdf/Box.hh>
#include <sdf/Capsule.hh>
#include <sdf/Cylinder.hh>
#include <sdf/Ellipsoid.hh>
#include <sdf/Mesh.hh>
#include <sdf/Plane.hh>
#include <sdf/Sphere.hh>

#include <algorithm>
#include <cmath>
#include <limits>

namespace swarmwright::gazebo {

namespace {

constexpr double nothing = std::numeric_limits<double>::infinity();

/// Where a line is between two planes: `from` and `to`, which are narrowed.
bool between(double begin, double along, double half, double& from, double& to) {
  if (along == 0) {
    return std::abs(begin) <= half;
  }
  const double first = (-half - begin) / along;
  const double other = (half - begin) / along;
  from = std::max(from, std::min(first, other));
  to = std::min(to, std::max(first, other));
  return from <= to;
}

/// Where a line is in a circle or a sphere: the roots of a t^2 + 2 b t + c.
bool roots(double a, double b, double c, double& from, double& to) {
  if (a == 0) {
    return c <= 0;
  }
  const double square = b * b - a * c;
  if (square < 0) {
    return false;
  }
  const double root = std::sqrt(square);
  from = std::max(from, (-b - root) / a);
  to = std::min(to, (-b + root) / a);
  return from <= to;
}

double met_triangle(const std::array<Vector, 3>& corners, const Vector& begin, const Vector& along) {
  const Vector edge = corners[1] - corners[0];
  const Vector other = corners[2] - corners[0];
  const Vector cross = along.Cross(other);
  const double determinant = edge.Dot(cross);
  if (determinant == 0) {
    return nothing;
  }
  const Vector from = begin - corners[0];
  const double u = from.Dot(cross) / determinant;
  const Vector second = from.Cross(edge);
  const double v = along.Dot(second) / determinant;
  const double distance = other.Dot(second) / determinant;
  return u >= 0 && v >= 0 && u + v <= 1 && distance >= 0 ? distance : nothing;
}

std::vector<std::array<Vector, 3>> triangles_of(const sdf::Mesh& mesh) {
  const std::string file = find_resource(mesh.Uri());
  const auto* loaded = file.empty() ? nullptr : ignition::common::MeshManager::Instance()->Load(file);
  std::vector<std::array<Vector, 3>> triangles;
  for (unsigned part = 0; loaded != nullptr && part < loaded->SubMeshCount(); ++part) {
    const auto submesh = loaded->SubMeshByIndex(part).lock();
    if (!submesh || (!mesh.Submesh().empty() && submesh->Name() != mesh.Submesh())) {
      continue;
    }
    for (unsigned i = 0; i + 2 < submesh->IndexCount(); i += 3) {
      const auto corner = [&](unsigned at) {
        return submesh->Vertex(static_cast<unsigned>(submesh->Index(at))) * mesh.Scale();
      };
      triangles.push_back({corner(i), corner(i + 1), corner(i + 2)});
    }
  }
  return triangles;
}

}  // namespace

std::optional<Shape> Shape::of(const sdf::Geometry& geometry, const Placement& in_link) {
  Shape shape;
  shape.in_link_ = in_link;
  switch (geometry.Type()) {
    case sdf::GeometryType::BOX:
      shape.kind_ = Kind::box;
      shape.half_ = geometry.BoxShape()->Size() / 2;
      shape.bound_ = shape.half_.Length();
      return shape;
    case sdf::GeometryType::CYLINDER: {
      shape.kind_ = Kind::cylinder;
      const double radius = geometry.CylinderShape()->Radius();
      shape.half_ = Vector(radius, radius, geometry.CylinderShape()->Length() / 2);
      shape.bound_ = std::hypot(radius, shape.half_.Z());
      return shape;
    }
    case sdf::GeometryType::SPHERE:
      shape.kind_ = Kind::sphere;
      shape.bound_ = geometry.SphereShape()->Radius();
      shape.half_ = Vector(shape.bound_, shape.bound_, shape.bound_);
      return shape;
    case sdf::GeometryType::PLANE:
      shape.kind_ = Kind::plane;
      shape.half_ = geometry.PlaneShape()->Normal();
      shape.bound_ = nothing;
      return shape;
    case sdf::GeometryType::MESH:
      shape.kind_ = Kind::mesh;
      shape.triangles_ = triangles_of(*geometry.MeshShape());
      for (const auto& corners : shape.triangles_) {
        for (const Vector& corner : corners) {
          shape.bound_ = std::max(shape.bound_, corner.Length());
        }
      }
      return shape;
    default:
      return std::nullopt;
  }
}

void Shape::move(const Placement& link) { at_ = link * in_link_; }

double Shape::met(const Vector& begin, const Vector& along, double length) const {
  const Vector from = begin - at_.Pos();
  if (std::isfinite(bound_)) {
    // Further from the line than it is large.
    const double nearest = std::clamp(-from.Dot(along), 0.0, length);
    if ((from + along * nearest).SquaredLength() > bound_ * bound_) {
      return nothing;
    }
  }
  return met_inside(at_.Rot().RotateVectorReverse(from), at_.Rot().RotateVectorReverse(along));
}

double Shape::met_inside(const Vector& begin, const Vector& along) const {
  double from = 0;
  double to = nothing;
  switch (kind_) {
    case Kind::box:
      for (std::size_t i = 0; i < 3; ++i) {
        if (!between(begin[i], along[i], half_[i], from, to)) {
          return nothing;
        }
      }
      return from;
    case Kind::cylinder:
      return roots(along.X() * along.X() + along.Y() * along.Y(), begin.X() * along.X() + begin.Y() * along.Y(),
                   begin.X() * begin.X() + begin.Y() * begin.Y() - half_.X() * half_.X(), from, to) &&
                     between(begin.Z(), along.Z(), half_.Z(), from, to)
                 ? from
                 : nothing;
    case Kind::sphere:
      return roots(1, begin.Dot(along), begin.SquaredLength() - bound_ * bound_, from, to) ? from : nothing;
    case Kind::plane: {
      const double height = begin.Dot(half_);
      const double sinking = -along.Dot(half_);
      return height < 0 ? 0 : sinking > 0 ? height / sinking : nothing;
    }
    case Kind::mesh:
      for (const auto& corners : triangles_) {
        to = std::min(to, met_triangle(corners, begin, along));
      }
      return to;
  }
  return nothing;
}

}  // namespace swarmwright::gazebo
