// Measures models of the user as the library of SDF describes them.

#include "captured.hpp"
#include "library.hpp"
#include "names.hpp"

#include <sdf/Box.hh>
#include <sdf/Collision.hh>
#include <sdf/Cylinder.hh>
#include <sdf/Geometry.hh>
#include <sdf/Joint.hh>
#include <sdf/JointAxis.hh>
#include <sdf/Lidar.hh>
#include <sdf/Link.hh>
#include <sdf/Mesh.hh>
#include <sdf/Model.hh>
#include <sdf/Root.hh>
#include <sdf/Sensor.hh>
#include <sdf/Sphere.hh>

#include <ignition/common/Mesh.hh>
#include <ignition/common/MeshManager.hh>
#include <ignition/math/AxisAlignedBox.hh>

#include <algorithm>
#include <cmath>
#include <limits>
#include <sstream>

namespace swarmwright::gazebo {

namespace {

constexpr double none = std::numeric_limits<double>::infinity();

/// Where something is in its model.
template <typename Part>
Placement place_of(const Part& part) {
  Placement place;
  if (!part.SemanticPose().Resolve(place, "__model__").empty()) {
    place = part.RawPose();
  }
  return place;
}

/// The box around a shape, in its own frame.
ignition::math::AxisAlignedBox box_of(const sdf::Geometry& geometry) {
  Vector half;
  switch (geometry.Type()) {
    case sdf::GeometryType::BOX:
      half = geometry.BoxShape()->Size() / 2;
      break;
    case sdf::GeometryType::CYLINDER: {
      const double radius = geometry.CylinderShape()->Radius();
      half = Vector(radius, radius, geometry.CylinderShape()->Length() / 2);
      break;
    }
    case sdf::GeometryType::SPHERE: {
      const double radius = geometry.SphereShape()->Radius();
      half = Vector(radius, radius, radius);
      break;
    }
    case sdf::GeometryType::MESH: {
      const sdf::Mesh& mesh = *geometry.MeshShape();
      const auto* loaded = ignition::common::MeshManager::Instance()->Load(find_resource(mesh.Uri()));
      if (loaded != nullptr) {
        return {loaded->Min() * mesh.Scale(), loaded->Max() * mesh.Scale()};
      }
      return {};
    }
    default:
      return {};
  }
  return {-half, half};
}

/// Lowest and highest of a link's shapes above its model's origin.
std::pair<double, double> heights(const sdf::Link& link) {
  double lowest = none;
  double highest = -none;
  for (std::uint64_t i = 0; i < link.CollisionCount(); ++i) {
    const sdf::Collision& collision = *link.CollisionByIndex(i);
    const sdf::Geometry& geometry = *collision.Geom();
    const Placement at = place_of(collision);
    if (geometry.Type() == sdf::GeometryType::CYLINDER) {
      // A wheel may lie on its side and be turned by any angle: its edge is round.
      const Vector along = at.Rot().RotateVector(Vector::UnitZ);
      const double up = geometry.CylinderShape()->Radius() * std::sqrt(std::max(0.0, 1 - along.Z() * along.Z())) +
                        geometry.CylinderShape()->Length() / 2 * std::abs(along.Z());
      lowest = std::min(lowest, at.Pos().Z() - up);
      highest = std::max(highest, at.Pos().Z() + up);
      continue;
    }
    const double radius = geometry.Type() == sdf::GeometryType::SPHERE ? geometry.SphereShape()->Radius() : 0;
    const auto box = box_of(geometry);
    for (int corner = 0; corner < 8; ++corner) {
      const Vector in_box((corner & 1) != 0 ? box.Max().X() : box.Min().X(),
                          (corner & 2) != 0 ? box.Max().Y() : box.Min().Y(),
                          (corner & 4) != 0 ? box.Max().Z() : box.Min().Z());
      const double z =
          radius > 0 ? at.Pos().Z() + ((corner & 4) != 0 ? radius : -radius) : at.CoordPositionAdd(in_box).Z();
      if (std::isfinite(z)) {
        lowest = std::min(lowest, z);
        highest = std::max(highest, z);
      }
    }
  }
  return {lowest, highest};
}

class Measuring {
 public:
  explicit Measuring(const ModelChoice& choice) : choice_(choice) {}

  void measure(UserModel& user, const sdf::ElementPtr& element) const {
    element->GetAttribute("name")->Set(std::string("model"));
    sdf::Root root;
    const Captured said_before;
    const sdf::Errors errors =
        root.LoadSdfString("<sdf version='" + sdf::SDF::Version() + "'>" + element->ToString("") + "</sdf>");
    const sdf::Model* model = root.Model();
    if (!errors.empty() || model == nullptr) {
      fail(errors.empty() ? "Gazebo cannot read it" : errors.front().Message());
    }
    double lowest = none;
    for (std::uint64_t i = 0; i < model->LinkCount(); ++i) {
      const sdf::Link& link = *model->LinkByIndex(i);
      user.mass += link.Inertial().MassMatrix().Mass();
      lowest = std::min(lowest, heights(link).first);
    }
    user.lift = -lowest;
    user.left = wheel(*model, choice_.left);
    user.right = wheel(*model, choice_.right);
    const sdf::Link* carrier = model->LinkByName(model->JointByName(choice_.left)->ParentLinkName());
    if (carrier == nullptr) {
      fail("<joint name=" + in_quotes(choice_.left) + ">: its parent is the world; expected a link of the robot");
    }
    user.link = carrier->Name();
    user.link_at = place_of(*carrier);
    if (!user.sensor.empty()) {
      measure_sensor(user, *model);
    }
  }

 private:
  [[noreturn]] void fail(const std::string& problem) const { throw GazeboError(choice_.path + ": " + problem); }

  UserWheel wheel(const sdf::Model& model, const std::string& name) const {
    const std::string element = "<joint name=" + in_quotes(name) + ">";
    const sdf::Joint* joint = model.JointByName(name);
    const sdf::Link* link = joint == nullptr ? nullptr : model.LinkByName(joint->ChildLinkName());
    if (link == nullptr || link->CollisionCount() == 0) {
      fail(element + ": its child has no <collision>, so it is not a wheel");
    }
    UserWheel wheel;
    wheel.joint = name;
    const Vector at = place_of(*joint).Pos();
    const auto [lowest, highest] = heights(*link);
    wheel.left = at.Y();
    wheel.radius = (highest - lowest) / 2;
    if (!(std::abs(at.Z() - (lowest + highest) / 2) < 0.1 * wheel.radius)) {
      fail(element + ": it is not in the middle of the wheel, which is the link " + in_quotes(link->Name()));
    }
    Vector axis;
    if (!joint->Axis(0)->ResolveXyz(axis, "__model__").empty()) {
      fail(element + ": Gazebo cannot tell its axis");
    }
    if (std::abs(axis.Y()) < 0.99) {
      std::ostringstream text;
      text << element << ": its axis is " << axis << " in the frame of the model, expected 0 1 0 or 0 -1 0";
      fail(text.str());
    }
    wheel.forward = axis.Y() > 0 ? 1 : -1;
    const double speed = joint->Axis(0)->MaxVelocity();
    const double torque = joint->Axis(0)->Effort();
    wheel.top_speed = speed > 0 && speed < 1e15 ? speed * wheel.radius : none;
    wheel.torque = torque > 0 ? torque : none;
    return wheel;
  }

  void measure_sensor(UserModel& user, const sdf::Model& model) const {
    for (std::uint64_t i = 0; i < model.LinkCount(); ++i) {
      const sdf::Sensor* sensor = model.LinkByIndex(i)->SensorByName(user.sensor);
      if (sensor == nullptr) {
        continue;
      }
      const sdf::Lidar* lidar = sensor->LidarSensor();
      if (lidar == nullptr || lidar->HorizontalScanSamples() == 0) {
        fail("<sensor name=" + in_quotes(user.sensor) + ">: it has no rays");
      }
      const Placement at = place_of(*sensor);
      const unsigned samples = lidar->HorizontalScanSamples();
      const double first = lidar->HorizontalScanMinAngle().Radian();
      const double last = lidar->HorizontalScanMaxAngle().Radian();
      user.reach = lidar->RangeMax();
      for (unsigned ray = 0; ray < samples; ++ray) {
        const double angle = samples == 1 ? first : first + (last - first) * ray / (samples - 1);
        user.rays.push_back({at.Pos(), at.Rot().RotateVector(Vector(std::cos(angle), std::sin(angle), 0))});
      }
      if (std::abs(user.rays.front().along.Z()) > 0.1) {
        fail("<sensor name=" + in_quotes(user.sensor) + ">: it does not look along the ground");
      }
      return;
    }
    fail("<sensor name=" + in_quotes(user.sensor) + ">: Gazebo did not make it");
  }

  const ModelChoice& choice_;
};

}  // namespace

void measure(UserModel& user, const ModelChoice& choice, const sdf::ElementPtr& model) {
  Measuring(choice).measure(user, model);
}

}  // namespace swarmwright::gazebo
