#include "sdf_world.hpp"

#include "gazebo.hpp"
#include "library.hpp"

#include <algorithm>
#include <cctype>
#include <cmath>
#include <limits>
#include <locale>
#include <sstream>
#include <vector>

namespace swarmwright::gazebo {

namespace {

constexpr double gravity = 9.81;
constexpr double wall_thickness = 0.02;
constexpr double right_angle = 1.5707963267948966;
/// An e-puck of 35 mm radius has wheels of 20.5 mm; a TurtleBot3 has 33 mm, and larger robots have no larger ones.
constexpr double wheel_of_radius = 0.0205 / 0.035;
constexpr double largest_wheel = 0.033;
constexpr double default_step = 0.005;
/// Seconds: with longer steps, what is too heavy to be pushed slides all the same, and wheels of users' models wobble.
constexpr double finer_step = 0.0025;
constexpr double hull_friction = 0.1;
constexpr double ground_friction = 1;
/// In radii. Gazebo's wheels roll on their outer edge: wide ones would be further apart than the model's.
constexpr double wheel_width = 0.02;

/// What meets what: bits that two shapes have in common.
constexpr int hulls = 1;
constexpr int rolling = 2;

struct Text : std::ostringstream {
  Text() {
    imbue(std::locale::classic());
    precision(std::numeric_limits<double>::max_digits10);
  }
};

struct Corner {
  explicit Corner(const Point& point) : x(static_cast<double>(point.x)), y(static_cast<double>(point.y)) {}
  double x;
  double y;
};

std::string at(double x, double y, double z, double roll = 0, double yaw = 0) {
  Text text;
  text << x << ' ' << y << ' ' << z << ' ' << roll << " 0 " << yaw;
  return text.str();
}

std::string inertial(double mass, double xx, double yy, double zz, double z) {
  Text text;
  text << "<inertial><pose>" << at(0, 0, z) << "</pose><mass>" << mass << "</mass><inertia><ixx>" << xx << "</ixx><iyy>"
       << yy << "</iyy><izz>" << zz << "</izz><ixy>0</ixy><ixz>0</ixz><iyz>0</iyz></inertia></inertial>";
  return text.str();
}

std::string cylinder_inertial(double mass, double radius, double height, double z) {
  const double across = mass * (3 * radius * radius + height * height) / 12;
  return inertial(mass, across, across, mass * radius * radius / 2, z);
}

std::string cylinder(double radius, double length) {
  Text text;
  text << "<geometry><cylinder><radius>" << radius << "</radius><length>" << length
       << "</length></cylinder></geometry>";
  return text.str();
}

std::string sphere(double radius) {
  Text text;
  text << "<geometry><sphere><radius>" << radius << "</radius></sphere></geometry>";
  return text.str();
}

std::string box(double x, double y, double z) {
  Text text;
  text << "<geometry><box><size>" << x << ' ' << y << ' ' << z << "</size></box></geometry>";
  return text.str();
}

/// A shape that others meet and, where a colour is given, that is seen.
std::string shape(const std::string& name, const std::string& pose, const std::string& geometry, double friction,
                  const char* color, int meets = hulls) {
  Text text;
  text << "<collision name='" << name << "'><pose>" << pose << "</pose>" << geometry
       << "<surface><contact><collide_bitmask>" << meets << "</collide_bitmask></contact><friction><ode><mu>"
       << friction << "</mu><mu2>" << friction << "</mu2></ode></friction></surface></collision>";
  if (color != nullptr) {
    text << "<visual name='" << name << "_visual'><pose>" << pose << "</pose>" << geometry << "<material><ambient>"
         << color << " 1</ambient><diffuse>" << color << " 1</diffuse></material></visual>";
  }
  return text.str();
}

double lowest(const World& world) {
  double result = 0.08;
  for (const RobotModel& model : world.models) {
    result = std::min(result, static_cast<double>(model.height));
  }
  for (const Object& object : world.objects) {
    result = std::min(result, static_cast<double>(object.height));
  }
  return result;
}

/// A sensor with as many rays as the model has. They are aimed later: SDF has equal angles only.
std::string ray_sensor(const RobotModel& model, double z) {
  Text text;
  text << "<sensor name='" << eye << "' type='ray'><pose>" << at(0, 0, z)
       << "</pose><always_on>0</always_on><update_rate>0</update_rate><visualize>0</visualize><ray><scan><horizontal>"
       << "<samples>" << model.rays.size() << "</samples><resolution>1</resolution><min_angle>-1</min_angle>"
       << "<max_angle>1</max_angle></horizontal></scan><range><min>" << ray_origin(model) << "</min><max>"
       << static_cast<double>(model.ray_start) + static_cast<double>(model.ray_range)
       << "</max><resolution>0</resolution></range></ray></sensor>";
  return text.str();
}

bool has_ray_sensors(const RobotModel& model) {
  return traits.has_ray_sensors && settings().rays && !model.rays.empty();
}

/// One of two wheels: side is 1 for the left one, -1 for the right one.
std::string wheel(const RobotModel& model, int side) {
  const double radius = wheel_radius(model);
  const double mass = 0.05 * static_cast<double>(model.mass);
  const char* name = side > 0 ? "left" : "right";
  const double inertia = 0.4 * mass * radius * radius;
  Text text;
  text << "<link name='" << name << "'><pose>" << at(0, side * static_cast<double>(model.wheel_base) / 2, radius)
       << "</pose>" << inertial(mass, inertia, inertia, inertia, 0)
       << shape(name, at(0, 0, 0, right_angle), cylinder(radius, wheel_width * radius), ground_friction, "0.1 0.1 0.1",
                rolling)
       << "</link><joint name='" << (side > 0 ? left_joint : right_joint) << "' type='revolute'><parent>" << body
       << "</parent><child>" << name
       << "</child><axis><xyz>0 1 0</xyz><limit><lower>-1e16</lower><upper>1e16</upper></limit></axis></joint>";
  return text.str();
}

/// A cylinder on two driven wheels and two casters, or on four casters alone.
std::string robot(const World& world, std::size_t number, double x, double y) {
  const RobotModel& model = world.model(number);
  const double radius = model.radius;
  const bool wheels = has_wheels(model);
  const double caster = 0.4 * wheel_radius(model);
  const double clearance = std::min(0.5 * wheel_radius(model), 0.3 * lowest(world));
  const double hull = static_cast<double>(model.height) - clearance;
  Text text;
  text << "<model name='" << robot_name(number) << "'><pose>" << at(x, y, 0)
       << "</pose><allow_auto_disable>0</allow_auto_disable><link name='" << body << "'>"
       << cylinder_inertial(static_cast<double>(model.mass) * (wheels ? 0.9 : 1), radius, hull, wheel_radius(model))
       << shape("hull", at(0, 0, clearance + hull / 2), cylinder(radius, hull), hull_friction, "0.2 0.5 0.3");
  for (int i = 0; i < (wheels ? 2 : 4); ++i) {
    // A little above the ground where wheels carry the robot, so that these always have their share of its weight.
    const double angle = right_angle * (wheels ? 2 * i : i);
    text << shape("caster_" + std::to_string(i),
                  at(0.7 * radius * std::cos(angle), 0.7 * radius * std::sin(angle), caster + (wheels ? 2e-4 : 0)),
                  sphere(caster), 0, nullptr, rolling);
  }
  if (has_ray_sensors(model)) {
    text << ray_sensor(model, ray_height(world));
  }
  text << "</link>";
  if (wheels) {
    text << wheel(model, 1) << wheel(model, -1);
  }
  text << "</model>";
  return text.str();
}

double width(const Object& object) {
  return object.radius > 0 ? 2 * static_cast<double>(object.radius)
                           : std::hypot(static_cast<double>(object.width), static_cast<double>(object.depth));
}

std::string pushed(const Object& object, std::size_t number, double x, double y) {
  const double mass = object.mass;
  const double height = object.height;
  const double friction = object.friction;
  Text text;
  text << "<model name='" << object_name(number) << "'><pose>" << at(x, y, 0)
       << "</pose><allow_auto_disable>0</allow_auto_disable><link name='" << body << "'>";
  if (object.radius > 0) {
    const double radius = object.radius;
    text << cylinder_inertial(mass, radius, height, height / 2)
         << shape("hull", at(0, 0, height / 2), cylinder(radius, height), friction, "0.6 0.4 0.2");
  } else {
    const double along = object.width;
    const double across = object.depth;
    const auto about = [&](double a, double b) { return mass * (a * a + b * b) / 12; };
    text << inertial(mass, about(across, height), about(along, height), about(along, across), height / 2)
         << shape("hull", at(0, 0, height / 2), box(along, across, height), friction, "0.6 0.4 0.2");
  }
  text << "</link></model>";
  return text.str();
}

std::string still(const std::string& name, double x, double y, double yaw, double length, double depth, double height) {
  Text text;
  text << "<model name='" << name << "'><static>1</static><pose>" << at(x, y, height / 2, 0, yaw)
       << "</pose><link name='" << body << "'>"
       << shape("hull", at(0, 0, 0), box(length, depth, height), hull_friction, "0.8 0.8 0.8") << "</link></model>";
  return text.str();
}

/// Whether corners are those of a rectangle, within a tenth of a millimetre.
bool is_rectangle(const std::vector<Corner>& corners) {
  if (corners.size() != 4) {
    return false;
  }
  const double x = (corners[0].x + corners[2].x) / 2;
  const double y = (corners[0].y + corners[2].y) / 2;
  const auto half = [&](std::size_t i) { return std::hypot(corners[i].x - x, corners[i].y - y); };
  return std::hypot((corners[1].x + corners[3].x) / 2 - x, (corners[1].y + corners[3].y) / 2 - y) < 1e-4 &&
         std::abs(half(0) - half(1)) < 1e-4;
}

/// A wall as boxes: the sides of the outline stand outside of it, those of obstacles inside.
std::string wall(const std::vector<Point>& points, std::size_t number, double height) {
  const std::vector<Corner> corners(points.begin(), points.end());
  const std::string name = "wall_" + std::to_string(number);
  const std::size_t count = corners.size();
  const bool outline = number == 0;
  if (!outline && is_rectangle(corners)) {
    const double ux = corners[1].x - corners[0].x;
    const double uy = corners[1].y - corners[0].y;
    return still(name, (corners[0].x + corners[2].x) / 2, (corners[0].y + corners[2].y) / 2, std::atan2(uy, ux),
                 std::hypot(ux, uy), std::hypot(corners[2].x - corners[1].x, corners[2].y - corners[1].y), height);
  }
  // Corners come counter-clockwise: the outside is to the right of a side.
  const double right = outline ? 1 : -1;
  const auto longer = [&](std::size_t at_corner) {
    const Corner& before = corners[(at_corner + count - 1) % count];
    const Corner& corner = corners[at_corner];
    const Corner& after = corners[(at_corner + 1) % count];
    const double turn = (corner.x - before.x) * (after.y - corner.y) - (corner.y - before.y) * (after.x - corner.x);
    // Boxes beside each other leave a gap at the corner around which they stand.
    return turn * right > 0 ? wall_thickness : 0.0;
  };
  std::string text;
  for (std::size_t i = 0; i < count; ++i) {
    const Corner& from = corners[i];
    const Corner& to = corners[(i + 1) % count];
    const double length = std::hypot(to.x - from.x, to.y - from.y);
    if (length == 0) {
      continue;
    }
    const double ux = (to.x - from.x) / length;
    const double uy = (to.y - from.y) / length;
    const double begin = longer(i);
    const double end = longer((i + 1) % count);
    const double along = (length + end - begin) / 2;
    const double aside = right * wall_thickness / 2;
    text += still(name + "_" + std::to_string(i), from.x + ux * along + uy * aside, from.y + uy * along - ux * aside,
                  std::atan2(uy, ux), length + begin + end, wall_thickness, height);
  }
  return text;
}

/// Physics of Gazebo's own, light and the ground.
std::string empty_floor(double step) {
  Text text;
  text << "<gravity>0 0 " << -gravity << "</gravity><physics type='ode' name='physics' default='1'><max_step_size>"
       << step
       << "</max_step_size><real_time_factor>0</real_time_factor><real_time_update_rate>0</real_time_update_rate><ode>"
       << "<solver><type>quick</type><iters>50</iters></solver></ode></physics><scene><shadows>0</shadows></scene>"
       << "<light name='sun' type='directional'><pose>0 0 10 0 0 0</pose><diffuse>0.8 0.8 0.8 1</diffuse>"
       << "<direction>-0.5 0.2 -1</direction></light><model name='ground'><static>1</static><link name='" << body
       << "'>"
       << shape("plane", at(0, 0, 0), "<geometry><plane><normal>0 0 1</normal><size>100 100</size></plane></geometry>",
                ground_friction, "0.5 0.5 0.5", hulls | rolling)
       << "</link></model>";
  return text.str();
}

/// Where the row of robots and objects is, metres along x.
double beside(const World& world) {
  double result = 1;
  for (const Wall& wall : world.walls) {
    for (const Point& point : wall.points) {
      result = std::max(result, 1 + static_cast<double>(point.x));
    }
  }
  return result;
}

/// Walls, robots and objects.
std::string mission_models(const World& world) {
  double tallest = 0.1;
  for (const RobotModel& model : world.models) {
    tallest = std::max(tallest, 2 * static_cast<double>(model.height));
  }
  Text text;
  for (std::size_t i = 0; settings().walls && i < world.walls.size(); ++i) {
    text << wall(world.walls[i].points, i, std::max(tallest, static_cast<double>(world.walls[i].height)));
  }
  double row = 0;
  for (std::size_t i = 0; i < world.robots.size(); ++i) {
    row += 3 * static_cast<double>(world.model(i).radius);
    if (!settings().model) {
      text << robot(world, i, beside(world), row);
    }
  }
  for (std::size_t i = 0; i < world.objects.size(); ++i) {
    row += width(world.objects[i]);
    text << pushed(world.objects[i], i, beside(world), row);
    row += width(world.objects[i]);
  }
  return text.str();
}

/// The physics of a world that are in force: the default ones, else the first.
sdf::ElementPtr physics_of(const sdf::ElementPtr& world) {
  const sdf::ElementPtr first = world->GetElement("physics");
  for (sdf::ElementPtr element = first; element; element = element->GetNextElement("physics")) {
    if (element->Get<bool>("default")) {
      return element;
    }
  }
  return first;
}

/// What lies still falls asleep in ODE, at a moment that depends on the episodes before: it is kept awake.
void keep_awake(const sdf::ElementPtr& model) {
  model->GetElement("allow_auto_disable")->Set(false);
  for (sdf::ElementPtr part = model->HasElement("model") ? model->GetElement("model") : nullptr; part;
       part = part->GetNextElement("model")) {
    keep_awake(part);
  }
}

void insert(const sdf::ElementPtr& into, const sdf::ElementPtr& element) {
  element->SetParent(into);
  into->InsertElement(element);
}

/// A robot that is a model of the user, with the sensor of the mission's rays.
sdf::ElementPtr user_robot(const UserModel& user, const World& world, std::size_t number, double x, double y) {
  const sdf::ElementPtr robot = user.model();
  robot->GetAttribute("name")->Set(robot_name(number));
  robot->GetElement("pose")->Set(ignition::math::Pose3d(x, y, user.lift, 0, 0, 0));
  robot->GetElement("allow_auto_disable")->Set(false);
  const RobotModel& model = world.model(number);
  if (has_ray_sensors(model)) {
    const sdf::ElementPtr carrier = parsed_world("<sdf version='1.6'><world name='w'><model name='m'><link name='l'>" +
                                                 ray_sensor(model, 0) + "</link></model></world></sdf>")
                                        ->GetElement("model")
                                        ->GetElement("link");
    for (sdf::ElementPtr link = robot->GetElement("link"); link; link = link->GetNextElement("link")) {
      if (link->Get<std::string>("name") == user.link) {
        insert(link, carrier->GetElement("sensor"));
      }
    }
  }
  return robot;
}

/// The user's world with the models of the mission.
sdf::ElementPtr with_models(const UserWorld& user, const sdf::ElementPtr& mission, const std::string& name,
                            double step) {
  const sdf::ElementPtr world = user.world();
  world->GetAttribute("name")->Set(name);
  const sdf::ElementPtr physics = physics_of(world);
  physics->GetElement("max_step_size")->Set(step);
  physics->GetElement("real_time_update_rate")->Set(0.0);  // as fast as can be
  for (sdf::ElementPtr model = world->HasElement("model") ? world->GetElement("model") : nullptr; model;
       model = model->GetNextElement("model")) {
    keep_awake(model);
  }
  for (sdf::ElementPtr plugin = world->HasElement("plugin") ? world->GetElement("plugin") : nullptr; plugin;) {
    const sdf::ElementPtr next = plugin->GetNextElement("plugin");
    if (is_left_out(plugin->Get<std::string>("filename"))) {
      world->RemoveChild(plugin);
    }
    plugin = next;
  }
  for (const char* kind : {"plugin", "model"}) {
    while (mission->HasElement(kind)) {
      const sdf::ElementPtr part = mission->GetElement(kind);
      mission->RemoveChild(part);
      insert(world, part);
    }
  }
  return world;
}

}  // namespace

std::string robot_name(std::size_t robot) { return "robot_" + std::to_string(robot); }
std::string object_name(std::size_t object) { return "object_" + std::to_string(object); }

bool has_wheels(const RobotModel& model) { return settings().wheels && model.wheel_base > 0; }

double wheel_radius(const RobotModel& model) {
  return std::min(
      {wheel_of_radius * static_cast<double>(model.radius), largest_wheel, 0.4 * static_cast<double>(model.height)});
}

double motor_torque(const RobotModel& model) {
  return static_cast<double>(model.mass) * static_cast<double>(model.acceleration) / 2 * wheel_radius(model);
}

double ray_origin(const RobotModel& model) { return std::max(0.0, static_cast<double>(model.ray_start) - 0.01); }

double ray_height(const World& world) { return 0.6 * lowest(world); }

unsigned steps_in_tick(const World& world) {
  double longest = settings().step;
  if (longest == 0 && settings().world) {
    longest = physics_of(settings().world->world())->Get<double>("max_step_size");
  } else if (longest == 0) {
    longest = settings().model ? finer_step : default_step;
  }
  if (!world.objects.empty()) {
    longest = std::min(longest, finer_step);
  }
  return std::max(1U, static_cast<unsigned>(std::ceil(static_cast<double>(world.tick) / longest - 1e-6)));
}

bool is_of_mission(const std::string& name) {
  for (const char* kind : {"robot_", "object_", "wall_"}) {
    const std::size_t length = std::char_traits<char>::length(kind);
    if (name.size() > length && name.compare(0, length, kind) == 0 &&
        std::isdigit(static_cast<unsigned char>(name[length])) != 0) {
      return true;
    }
  }
  return false;
}

std::string mission_text(const World& world) {
  const double step = static_cast<double>(world.tick) / steps_in_tick(world);
  return (settings().world ? "" : empty_floor(step)) + mission_models(world);
}

sdf::ElementPtr world_element(const World& world, const std::string& name) {
  const sdf::ElementPtr mission = parsed_world("<?xml version='1.0'?><sdf version='1.6'><world name='" + name + "'>" +
                                               traits.world_parts + mission_text(world) + "</world></sdf>\n");
  if (settings().model) {
    double row = 0;
    for (std::size_t i = 0; i < world.robots.size(); ++i) {
      row += 3 * static_cast<double>(world.model(i).radius);
      insert(mission, user_robot(*settings().model, world, i, beside(world), row));
    }
  }
  const std::optional<UserWorld>& user = settings().world;
  return user ? with_models(*user, mission, name, static_cast<double>(world.tick) / steps_in_tick(world)) : mission;
}

}  // namespace swarmwright::gazebo
