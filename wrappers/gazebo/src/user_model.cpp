#include "user_model.hpp"

#include "gazebo.hpp"
#include "library.hpp"
#include "sdf_world.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <sstream>

namespace swarmwright::gazebo {

namespace {

using Vector = ignition::math::Vector3d;

constexpr double pi = 3.141592653589793;
/// How much the wheels of the model may be nearer to each other, or further apart, than those of the mission's robot.
constexpr double wheel_base_tolerance = 0.1;
/// Radians by which a ray of the sensor may differ from that of the mission's robot, besides half the angle between
/// two.
constexpr double ray_tolerance = 0.01;

std::string joined(const std::vector<std::string>& names) {
  std::string text;
  for (const std::string& name : names) {
    text += (text.empty() ? "" : ", ") + name;
  }
  return text.empty() ? "none" : text;
}

std::vector<sdf::ElementPtr> children(const sdf::ElementPtr& element, const std::string& name = "") {
  std::vector<sdf::ElementPtr> elements;
  for (sdf::ElementPtr child = element->GetFirstElement(); child; child = child->GetNextElement()) {
    if (name.empty() || child->GetName() == name) {
      elements.push_back(child);
    }
  }
  return elements;
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
    measure(user, choice_, bare(model, choice_.sensor));
    if (!(user.left.left > user.right.left)) {
      fail("<joint name=" + in_quotes(choice_.left) + "> is to the right of " + in_quotes(choice_.right) +
           " for a robot that looks along x; name them the other way round, or turn the model");
    }
    return user;
  }

 private:
  [[noreturn]] void fail(const std::string& problem) const { throw GazeboError(choice_.path + ": " + problem); }

  void check_joints(const sdf::ElementPtr& model) const {
    std::vector<std::string> names;
    for (const sdf::ElementPtr& joint : children(model, "joint")) {
      names.push_back(joint->Get<std::string>("name"));
    }
    for (const std::string& required : {choice_.left, choice_.right}) {
      if (std::find(names.begin(), names.end(), required) == names.end()) {
        fail("no joint " + in_quotes(required) + ", which --joints names; the model has " + joined(names));
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
        if (names.back() == choice_.sensor &&
            std::string(traits.ray_sensors).find(" " + type + " ") == std::string::npos) {
          fail("<sensor name=" + in_quotes(choice_.sensor) + ">: type " + type + " found, expected" +
               traits.ray_sensors);
        }
      }
    }
    if (std::find(names.begin(), names.end(), choice_.sensor) == names.end()) {
      fail("no sensor " + in_quotes(choice_.sensor) + ", which --sensor names; the model has " + joined(names));
    }
  }

  const ModelChoice& choice_;
};

double direction(const UserRay& ray) { return std::atan2(ray.along.Y(), ray.along.X()); }

double apart(double first, double other) { return std::abs(std::remainder(first - other, 2 * pi)); }

/// The ray of the sensor that looks most nearly in a direction.
const UserRay& nearest(const UserModel& user, double angle) {
  return *std::min_element(user.rays.begin(), user.rays.end(), [&](const UserRay& left, const UserRay& other) {
    return apart(direction(left), angle) < apart(direction(other), angle);
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

[[noreturn]] void contradiction(const UserModel& user, const std::string& element, const std::string& problem) {
  throw ParameterError("robot", user.path + ": " + element + ": " + problem);
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

std::string in_quotes(const std::string& text) { return "\"" + text + "\""; }

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
