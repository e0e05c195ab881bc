// Measures models of the user in Gazebo, which has them at the origin of an empty world.

#include "library.hpp"
#include "robots.hpp"

#include <gazebo/physics/physics.hh>
#include <gazebo/sensors/sensors.hh>

#include <algorithm>
#include <cmath>
#include <limits>
#include <sstream>

namespace swarmwright::gazebo {

namespace {

using ::gazebo::physics::JointPtr;
using ::gazebo::physics::LinkPtr;
using ::gazebo::physics::ModelPtr;
using Vector = ignition::math::Vector3d;

class Measuring {
 public:
  explicit Measuring(const ModelChoice& choice) : choice_(choice) {}

  void measure(UserModel& user, const sdf::ElementPtr& model) const {
    static unsigned made = 0;
    const std::string name = "measured_" + std::to_string(made++);
    const sdf::ElementPtr description =
        parsed_world("<?xml version='1.0'?><sdf version='1.6'><world name='" + name + "'></world></sdf>");
    model->GetAttribute("name")->Set(std::string("model"));
    model->SetParent(description);
    description->InsertElement(model);
    const auto world = load(description, name);
    const ModelPtr placed = found(world, "model");
    if (!user.sensor.empty()) {
      ::gazebo::sensors::run_once(true);
    }
    double lowest = std::numeric_limits<double>::infinity();
    for (const LinkPtr& link : placed->GetLinks()) {
      user.mass += link->GetInertial()->Mass();
      for (const auto& collision : link->GetCollisions()) {
        lowest = std::min(lowest, collision->BoundingBox().Min().Z());
      }
    }
    user.lift = -lowest;
    user.left = wheel(placed, choice_.left);
    user.right = wheel(placed, choice_.right);
    const LinkPtr carrier = placed->GetJoint(choice_.left)->GetParent();
    if (!carrier) {
      fail("<joint name=" + in_quotes(choice_.left) + ">: its parent is the world; expected a link of the robot");
    }
    user.link = carrier->GetName();
    user.link_at = carrier->WorldPose();
    if (!user.sensor.empty()) {
      measure_sensor(user, placed, name);
    }
    world->Fini();
  }

 private:
  [[noreturn]] void fail(const std::string& problem) const { throw GazeboError(choice_.path + ": " + problem); }

  UserWheel wheel(const ModelPtr& placed, const std::string& name) const {
    const std::string element = "<joint name=" + in_quotes(name) + ">";
    const JointPtr joint = placed->GetJoint(name);
    const LinkPtr link = joint ? joint->GetChild() : nullptr;
    if (!link || link->GetCollisions().empty()) {
      fail(element + ": its child has no <collision>, so it is not a wheel");
    }
    UserWheel wheel;
    wheel.joint = name;
    ignition::math::AxisAlignedBox box;
    for (const auto& collision : link->GetCollisions()) {
      box.Merge(collision->BoundingBox());
    }
    const Vector at = joint->WorldPose().Pos();
    wheel.left = at.Y();
    wheel.radius = (box.Max().Z() - box.Min().Z()) / 2;
    if (!(std::abs(at.Z() - box.Center().Z()) < 0.1 * wheel.radius)) {
      fail(element + ": it is not in the middle of the wheel, which is the link " + in_quotes(link->GetName()));
    }
    const Vector axis = joint->GlobalAxis(0);
    if (std::abs(axis.Y()) < 0.99) {
      std::ostringstream text;
      text << element << ": its axis is " << axis << " in the frame of the model, expected 0 1 0 or 0 -1 0";
      fail(text.str());
    }
    wheel.forward = axis.Y() > 0 ? 1 : -1;
    const double speed = joint->GetVelocityLimit(0);
    const double torque = joint->GetEffortLimit(0);
    constexpr double none = std::numeric_limits<double>::infinity();
    wheel.top_speed = speed > 0 ? speed * wheel.radius : none;
    wheel.torque = torque > 0 ? torque : none;
    return wheel;
  }

  void measure_sensor(UserModel& user, const ModelPtr& placed, const std::string& world) const {
    for (const LinkPtr& link : placed->GetLinks()) {
      const std::string name = world + "::model::" + link->GetName() + "::" + user.sensor;
      const auto sensor = std::dynamic_pointer_cast<::gazebo::sensors::RaySensor>(::gazebo::sensors::get_sensor(name));
      if (!sensor) {
        continue;
      }
      const auto shape = sensor->LaserShape();
      user.reach = sensor->RangeMax();
      for (int i = 0; i < sensor->RayCount(); ++i) {
        Vector from;
        Vector to;
        shape->Ray(static_cast<unsigned>(i))->GlobalPoints(from, to);
        const Vector along = (to - from).Normalized();
        // Gazebo's rays begin at the smallest range.
        user.rays.push_back({from - along * sensor->RangeMin(), along});
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
