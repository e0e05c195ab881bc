#include "user_model.hpp"

#include "gazebo.hpp"
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

constexpr double pi = 3.141592653589793;
/// How much the wheels of the model may be nearer to each other, or further apart, than those of the mission's robot.
constexpr double wheel_base_tolerance = 0.1;
/// Radians by which a ray of the sensor may differ from that of the mission's robot, besides half the angle between
/// two.
constexpr double ray_tolerance = 0.01;

std::string in_quotes(const std::string& text) { return "\"" + text + "\""; }

std::string joined(const std::vector<std::string>& names) {
  std::string text;
  for (const std::string& name : names) {
    text += (text.empty() ? "" : ", ") + name;
  }
  return text.empty() ? "none" : text;
}

std::vector<sdf::ElementPtr> children(const sdf::ElementPtr& element, const std::string& name = "") {
  std::vector<sdf::ElementPtr> found;
  for (sdf::ElementPtr child = element->GetFirstElement(); child; child = child->GetNextElement()) {
    if (name.empty() || child->GetName() == name) {
      found.push_back(child);
    }
  }
  return found;
}

/// Removes plug-ins, which would steer the robot, the noise of sensors, which missions have, and all sensors except
/// one.
void strip(const sdf::ElementPtr& element, const std::string& sensor) {
  for (const sdf::ElementPtr& child : children(element)) {
    const std::string& name = child->GetName();
    if (name == "plugin" || name == "noise" || (name == "sensor" && child->Get<std::string>("name") != sensor)) {
      element->RemoveChild(child);
    } else {
      strip(child, sensor);
    }
  }
}

/// A model at the origin without what it does not need.
sdf::ElementPtr bare(const sdf::ElementPtr& model, const std::string& sensor) {
  strip(model, sensor);
  model->GetElement("pose")->Set(ignition::math::Pose3d());
  return model;
}

class Reading {
 public:
  explicit Reading(const ModelChoice& choice) : choice_(choice) {}

  UserModel read() {
    UserModel user;
    user.path = choice_.path;
    user.file = user_file(choice_.path);
    user.sensor = choice_.sensor;
    const sdf::ElementPtr model = user.file.model();
    if (model->Get<bool>("static")) {
      fail("<static>: the model cannot move; remove it");
    }
    check_joints(model);
    check_sensor(model);
    measure(user, bare(model, choice_.sensor));
    return user;
  }

 private:
  [[noreturn]] void fail(const std::string& what) const { throw GazeboError(choice_.path + ": " + what); }

  void check_joints(const sdf::ElementPtr& model) const {
    std::vector<std::string> names;
    for (const sdf::ElementPtr& joint : children(model, "joint")) {
      names.push_back(joint->Get<std::string>("name"));
    }
    for (const std::string& wanted : {choice_.left, choice_.right}) {
      if (std::find(names.begin(), names.end(), wanted) == names.end()) {
        fail("no joint " + in_quotes(wanted) + ", which --joints names; the model has " + joined(names));
      }
    }
    for (const sdf::ElementPtr& joint : children(model, "joint")) {
      const auto name = joint->Get<std::string>("name");
      const auto type = joint->Get<std::string>("type");
      if ((name == choice_.left || name == choice_.right) && type != "revolute" && type != "continuous") {
        fail("<joint name=" + in_quotes(name) + ">: type " + type + " found, expected revolute (in URDF continuous)");
      }
    }
  }

  void check_sensor(const sdf::ElementPtr& model) const {
    if (choice_.sensor.empty()) {
      return;
    }
    std::vector<std::string> names;
    for (const sdf::ElementPtr& link : children(model, "link")) {
      for (const sdf::ElementPtr& sensor : children(link, "sensor")) {
        names.push_back(sensor->Get<std::string>("name"));
        const auto type = sensor->Get<std::string>("type");
        if (names.back() == choice_.sensor && type != "ray") {
          fail("<sensor name=" + in_quotes(choice_.sensor) + ">: type " + type + " found, expected ray");
        }
      }
    }
    if (std::find(names.begin(), names.end(), choice_.sensor) == names.end()) {
      fail("no sensor " + in_quotes(choice_.sensor) + ", which --sensor names; the model has " + joined(names));
    }
  }

  /// Has Gazebo make the model, at the origin of an empty world.
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
    if (!(user.left.left > user.right.left)) {
      fail("<joint name=" + in_quotes(choice_.left) + "> is to the right of " + in_quotes(choice_.right) +
           " for a robot that looks along x; name them the other way round, or turn the model");
    }
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

  UserWheel wheel(const ModelPtr& placed, const std::string& name) const {
    const std::string element = "<joint name=" + in_quotes(name) + ">";
    const JointPtr joint = placed->GetJoint(name);
    const LinkPtr link = joint ? joint->GetChild() : nullptr;
    if (!link || link->GetCollisions().empty()) {
      fail(element + ": its child has no <collision>, so that it is no wheel");
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

double direction(const UserRay& ray) { return std::atan2(ray.along.Y(), ray.along.X()); }

double apart(double one, double other) { return std::abs(std::remainder(one - other, 2 * pi)); }

/// The ray of the sensor that looks most nearly in a direction.
const UserRay& nearest(const UserModel& user, double angle) {
  return *std::min_element(user.rays.begin(), user.rays.end(), [&](const UserRay& one, const UserRay& other) {
    return apart(direction(one), angle) < apart(direction(other), angle);
  });
}

/// Metres from where a ray begins to a circle around the middle of the robot.
double length_to(const UserRay& ray, double radius) {
  const double ahead = ray.origin.X() * ray.along.X() + ray.origin.Y() * ray.along.Y();
  const double square = ray.origin.X() * ray.origin.X() + ray.origin.Y() * ray.origin.Y();
  return std::sqrt(std::max(0.0, radius * radius - square + ahead * ahead)) - ahead;
}

double end_of(const RobotModel& model) {
  return static_cast<double>(model.ray_start) + static_cast<double>(model.ray_range);
}

[[noreturn]] void contradiction(const UserModel& user, const std::string& element, const std::string& what) {
  throw ParameterError("robot", user.path + ": " + element + ": " + what);
}

void check_rays(const UserModel& user, const RobotModel& model) {
  const std::string element = "<sensor name=" + in_quotes(user.sensor) + ">";
  const double gap = user.rays.size() > 1 ? apart(direction(user.rays[0]), direction(user.rays[1])) : 0;
  for (const float angle : model.rays) {
    const UserRay& ray = nearest(user, static_cast<double>(angle));
    std::ostringstream text;
    if (apart(direction(ray), static_cast<double>(angle)) > gap / 2 + ray_tolerance) {
      text << "it has no ray at " << std::round(static_cast<double>(angle) * 180 / pi)
           << " degrees, where the mission's robot has one; widen <horizontal>, or choose a robot with other sensors";
    } else if (length_to(ray, end_of(model)) > user.reach * 1.001) {
      text << "it reaches " << user.reach << " m, the rays of the mission's robot " << end_of(model)
           << " m from its middle; enlarge <range><max>, or choose a robot with other sensors";
    } else {
      continue;
    }
    contradiction(user, element, text.str());
  }
}

}  // namespace

sdf::ElementPtr UserModel::model() const { return bare(file.model(), ""); }

UserModel user_model(const ModelChoice& choice) {
  const Access access;
  UserModel user;
  guarded("make the model", [&] { user = Reading(choice).read(); });
  return user;
}

void check_model(const UserModel& user, const RobotModel& model) {
  const std::string joints =
      "<joint name=" + in_quotes(user.left.joint) + ">, <joint name=" + in_quotes(user.right.joint) + ">";
  if (model.wheel_base <= 0) {
    contradiction(user, joints, "the mission's robot has no differential drive; choose another robot");
  }
  const double base = user.left.left - user.right.left;
  const double expected = model.wheel_base;
  std::ostringstream text;
  if (std::abs(base - expected) > wheel_base_tolerance * expected) {
    text << "these wheels are " << base << " m apart, those of the mission's robot " << expected
         << " m; choose another model or another robot";
    contradiction(user, joints, text.str());
  }
  for (const UserWheel* wheel : {&user.left, &user.right}) {
    if (wheel->top_speed < static_cast<double>(model.top_speed) * 0.999) {
      text << "<limit><velocity> allows " << wheel->top_speed << " m/s, the mission's robot drives "
           << static_cast<double>(model.top_speed) << " m/s; raise it, or choose another robot";
      contradiction(user, "<joint name=" + in_quotes(wheel->joint) + ">", text.str());
    }
  }
  if (!user.sensor.empty()) {
    check_rays(user, model);
  }
}

std::vector<std::pair<Vector, Vector>> aims_of(const UserModel& user, const RobotModel& model, double height) {
  std::vector<std::pair<Vector, Vector>> aims;
  const auto in_link = [&](const Vector& point) {
    return user.link_at.Rot().RotateVectorReverse(point - user.link_at.Pos());
  };
  for (const float degrees : model.rays) {
    const auto angle = static_cast<double>(degrees);
    UserRay ray;
    double length = 0;
    if (user.sensor.empty()) {
      ray.along = Vector(std::cos(angle), std::sin(angle), 0);
      ray.origin = ray.along * ray_origin(model) + Vector(0, 0, height - user.lift);
      length = end_of(model) - ray_origin(model);
    } else {
      ray = nearest(user, angle);
      length = length_to(ray, end_of(model));
    }
    aims.emplace_back(in_link(ray.origin), in_link(ray.origin + ray.along * length));
  }
  return aims;
}

}  // namespace swarmwright::gazebo
