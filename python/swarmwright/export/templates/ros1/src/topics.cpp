// @mark@; changes here are lost.
#include "topics.hpp"

#include <algorithm>
#include <cmath>
#include <map>

#include "geometry_msgs/Twist.h"
#include "nav_msgs/Odometry.h"
#include "sensor_msgs/LaserScan.h"
#include "sensor_msgs/Range.h"
#include "std_msgs/Float32.h"
#include "std_msgs/Float64.h"

namespace {

using Reading = std::optional<double>;  // none: the message says nothing about this sensor

template <typename Message>
using Reader = std::function<Reading(const Message&, const SensorMapping&)>;
template <typename Message>
using Readers = std::map<std::string, Reader<Message>>;  // by field
template <typename Message>
using Writers = std::map<std::string, std::function<void(Message&, double)>>;

constexpr double kDegree = 3.14159265358979323846 / 180;

// A range as REP 117 defines it: beyond the largest one nothing is seen, NaN is no measurement.
Reading range(double value, double smallest, double largest, const SensorMapping& sensor) {
  if (std::isnan(value)) return std::nullopt;
  if (value > largest || std::isinf(value)) {
    return value > 0 ? sensor.infinite.value_or(largest) : smallest;
  }
  return std::max(value, smallest);
}

// Whether an angle lies in a sector, both in degrees, whatever turns they count from. Ends belong to it, and so does
// what rounding moved beyond them.
bool within(double angle, const Interval& sector) {
  constexpr double tolerance = 1e-4;
  const double from = angle - sector.first + tolerance;
  return from - 360 * std::floor(from / 360) <= sector.second - sector.first + 2 * tolerance;
}

// The smallest range of a sector, or the mean of its ranges, summed in the order of the message.
Reading sector(const sensor_msgs::LaserScan& scan, const SensorMapping& sensor) {
  double sum = 0;
  double least = INFINITY;
  int count = 0;
  for (std::size_t i = 0; i < scan.ranges.size(); ++i) {
    const double angle = scan.angle_min + static_cast<double>(i) * scan.angle_increment;
    if (sensor.sector && !within(angle / kDegree, *sensor.sector)) continue;
    const Reading value = range(scan.ranges[i], scan.range_min, scan.range_max, sensor);
    if (!value) continue;
    sum += *value;
    least = std::min(least, *value);
    ++count;
  }
  if (count == 0) return std::nullopt;
  return sensor.mean ? sum / count : least;
}

double yaw(const geometry_msgs::Quaternion& q) {
  return std::atan2(2 * (q.w * q.z + q.x * q.y), 1 - 2 * (q.y * q.y + q.z * q.z));
}

// Every type of message has its fields here; `type` is its name in the mapping.
template <typename Message>
struct Type;

#define READ(Message, expression)                                \
  [](const Message& m, const SensorMapping& sensor) -> Reading { \
    (void)sensor, (void)m;                                       \
    return expression;                                           \
  }
#define WRITE(Message, member) [](Message& m, double value) { m.member = value; }

template <>
struct Type<sensor_msgs::LaserScan> {
  static constexpr const char* name = "sensor_msgs/LaserScan";
  static Readers<sensor_msgs::LaserScan> readers() { return {{"ranges", sector}}; }
};

template <>
struct Type<sensor_msgs::Range> {
  static constexpr const char* name = "sensor_msgs/Range";
  static Readers<sensor_msgs::Range> readers() {
    return {{"range", READ(sensor_msgs::Range, range(m.range, m.min_range, m.max_range, sensor))}};
  }
};

template <>
struct Type<nav_msgs::Odometry> {
  static constexpr const char* name = "nav_msgs/Odometry";
  static Readers<nav_msgs::Odometry> readers() {
    return {{"pose.pose.position.x", READ(nav_msgs::Odometry, m.pose.pose.position.x)},
            {"pose.pose.position.y", READ(nav_msgs::Odometry, m.pose.pose.position.y)},
            {"pose.pose.position.z", READ(nav_msgs::Odometry, m.pose.pose.position.z)},
            {"yaw", READ(nav_msgs::Odometry, yaw(m.pose.pose.orientation))},
            {"twist.twist.linear.x", READ(nav_msgs::Odometry, m.twist.twist.linear.x)},
            {"twist.twist.linear.y", READ(nav_msgs::Odometry, m.twist.twist.linear.y)},
            {"twist.twist.linear.z", READ(nav_msgs::Odometry, m.twist.twist.linear.z)},
            {"twist.twist.angular.x", READ(nav_msgs::Odometry, m.twist.twist.angular.x)},
            {"twist.twist.angular.y", READ(nav_msgs::Odometry, m.twist.twist.angular.y)},
            {"twist.twist.angular.z", READ(nav_msgs::Odometry, m.twist.twist.angular.z)}};
  }
};

template <>
struct Type<geometry_msgs::Twist> {
  static constexpr const char* name = "geometry_msgs/Twist";
  static Readers<geometry_msgs::Twist> readers() {
    return {
        {"linear.x", READ(geometry_msgs::Twist, m.linear.x)},   {"linear.y", READ(geometry_msgs::Twist, m.linear.y)},
        {"linear.z", READ(geometry_msgs::Twist, m.linear.z)},   {"angular.x", READ(geometry_msgs::Twist, m.angular.x)},
        {"angular.y", READ(geometry_msgs::Twist, m.angular.y)}, {"angular.z", READ(geometry_msgs::Twist, m.angular.z)}};
  }
  static Writers<geometry_msgs::Twist> writers() {
    return {
        {"linear.x", WRITE(geometry_msgs::Twist, linear.x)},   {"linear.y", WRITE(geometry_msgs::Twist, linear.y)},
        {"linear.z", WRITE(geometry_msgs::Twist, linear.z)},   {"angular.x", WRITE(geometry_msgs::Twist, angular.x)},
        {"angular.y", WRITE(geometry_msgs::Twist, angular.y)}, {"angular.z", WRITE(geometry_msgs::Twist, angular.z)}};
  }
};

template <typename Message>
struct Number {
  static Readers<Message> readers() { return {{"data", READ(Message, m.data)}}; }
  static Writers<Message> writers() { return {{"data", WRITE(Message, data)}}; }
};

template <>
struct Type<std_msgs::Float32> : Number<std_msgs::Float32> {
  static constexpr const char* name = "std_msgs/Float32";
};

template <>
struct Type<std_msgs::Float64> : Number<std_msgs::Float64> {
  static constexpr const char* name = "std_msgs/Float64";
};

// The name of a field, and how it is read or written; where a type has only one, the mapping need not name it.
template <typename Use>
std::pair<std::string, Use> field(const std::map<std::string, Use>& fields, const Place& place) {
  if (place.field.empty() && fields.size() == 1) return *fields.begin();
  const auto found = fields.find(place.field);
  if (found != fields.end()) return *found;
  std::vector<std::string> names;
  for (const auto& [name, use] : fields) names.push_back(name);
  const std::string what = place.field.empty() ? "is missing" : "'" + place.field + "' is not in " + place.type;
  throw MappingError(place.where + ": field " + what + "; expected " + choice(names));
}

// All entries of a topic have its type, and nobody else uses it with another one.
template <typename Entry>
std::string type_of(const std::string& topic, const std::vector<Entry>& entries) {
  const Place* first = nullptr;
  for (const Entry& entry : entries) {
    if (entry.place.topic != topic) continue;
    if (first == nullptr) first = &entry.place;
    if (entry.place.type != first->type) {
      throw MappingError(entry.place.where + ": " + topic + " has the type " + first->type + " at " + first->where +
                         " and " + entry.place.type + " here; a topic has one type");
    }
  }
  ros::master::V_TopicInfo known;
  ros::master::getTopics(known);
  for (const ros::master::TopicInfo& info : known) {
    if (info.name == topic && info.datatype != first->type && info.datatype != "*") {
      throw MappingError(first->where + ": " + topic + " has the type " + info.datatype + ", but the mapping says " +
                         first->type);
    }
  }
  return first->type;
}

template <typename Entry>
std::vector<std::string> topics_of(const std::vector<Entry>& entries) {
  std::vector<std::string> topics;
  for (const Entry& entry : entries) {
    const std::string& topic = entry.place.topic;
    if (std::find(topics.begin(), topics.end(), topic) == topics.end()) topics.push_back(topic);
  }
  return topics;
}

template <typename Entry>
[[noreturn]] void unknown_type(const std::string& topic, const std::vector<Entry>& entries,
                               const std::vector<std::string>& types) {
  const auto at =
      std::find_if(entries.begin(), entries.end(), [&](const Entry& entry) { return entry.place.topic == topic; });
  throw MappingError(at->place.where + ": the type '" + at->place.type + "' is not known here; expected " +
                     choice(types));
}

double clipped(double value, const std::optional<Interval>& interval) {
  return interval ? std::clamp(value, interval->first, interval->second) : value;
}

}  // namespace

void resolve(Place& place) {
  try {
    place.topic = ros::names::resolve(place.topic);
  } catch (const ros::InvalidNameException& error) {
    throw MappingError(place.where + ": topic '" + place.topic + "': " + error.what());
  }
}

double seconds() { return ros::Time::isSimTime() ? ros::Time::now().toSec() : ros::SteadyTime::now().toSec(); }

Inputs::Inputs(ros::NodeHandle& node, const std::vector<SensorMapping>& sensors)
    : sensors_(sensors), values_(sensors.size()), times_(sensors.size()) {
  for (const std::string& topic : topics_of(sensors_)) {
    const std::string type = type_of(topic, sensors_);
    if (subscribe<sensor_msgs::LaserScan>(node, topic, type) || subscribe<sensor_msgs::Range>(node, topic, type) ||
        subscribe<nav_msgs::Odometry>(node, topic, type) || subscribe<geometry_msgs::Twist>(node, topic, type) ||
        subscribe<std_msgs::Float32>(node, topic, type) || subscribe<std_msgs::Float64>(node, topic, type)) {
      continue;
    }
    unknown_type(topic, sensors_,
                 {"sensor_msgs/LaserScan", "sensor_msgs/Range", "nav_msgs/Odometry", "geometry_msgs/Twist",
                  "std_msgs/Float32", "std_msgs/Float64"});
  }
}

template <typename Message>
bool Inputs::subscribe(ros::NodeHandle& node, const std::string& topic, const std::string& type) {
  if (type != Type<Message>::name) return false;
  std::vector<std::pair<std::size_t, Reader<Message>>> readers;
  for (std::size_t i = 0; i < sensors_.size(); ++i) {
    if (sensors_[i].place.topic != topic) continue;
    readers.emplace_back(i, field(Type<Message>::readers(), sensors_[i].place).second);
  }
  const boost::function<void(const boost::shared_ptr<Message const>&)> read = [this, readers](const auto& message) {
    for (const auto& [i, reader] : readers) {
      const SensorMapping& sensor = sensors_[i];
      const Reading value = reader(*message, sensor);
      if (!value) continue;
      const auto sensed = static_cast<float>(clipped(*value * sensor.scale + sensor.offset, sensor.clip));
      // NaN and infinities are no measurements: the sensor is as silent as if they had not come.
      if (!std::isfinite(sensed)) continue;
      values_[i] = sensed;
      times_[i] = seconds();
    }
  };
  subscribers_.push_back(node.subscribe<Message>(topic, 1, read));
  return true;
}

std::vector<std::string> Inputs::silent() const {
  std::vector<std::string> topics;
  const double now = seconds();
  for (std::size_t i = 0; i < sensors_.size(); ++i) {
    if (times_[i] && now - *times_[i] <= sensors_[i].timeout) continue;
    const std::string& topic = sensors_[i].place.topic;
    if (std::find(topics.begin(), topics.end(), topic) == topics.end()) topics.push_back(topic);
  }
  return topics;
}

Outputs::Outputs(ros::NodeHandle& node, const std::vector<ActuatorMapping>& actuators) : actuators_(actuators) {
  for (const std::string& topic : topics_of(actuators_)) {
    const std::string type = type_of(topic, actuators_);
    if (advertise<geometry_msgs::Twist>(node, topic, type) || advertise<std_msgs::Float32>(node, topic, type) ||
        advertise<std_msgs::Float64>(node, topic, type)) {
      continue;
    }
    unknown_type(topic, actuators_, {"geometry_msgs/Twist", "std_msgs/Float32", "std_msgs/Float64"});
  }
}

template <typename Message>
bool Outputs::advertise(ros::NodeHandle& node, const std::string& topic, const std::string& type) {
  if (type != Type<Message>::name) return false;
  std::map<std::string, std::pair<std::size_t, std::function<void(Message&, double)>>> writers;
  for (std::size_t i = 0; i < actuators_.size(); ++i) {
    const Place& place = actuators_[i].place;
    if (place.topic != topic) continue;
    const auto [name, writer] = field(Type<Message>::writers(), place);
    const auto [other, added] = writers.try_emplace(name, i, writer);
    if (!added) {
      throw MappingError(place.where + ": writes the same field as " + actuators_[other->second.first].place.where);
    }
  }
  const ros::Publisher publisher = node.advertise<Message>(topic, 1);
  topics_.push_back([this, publisher, writers](const std::vector<float>* values) {
    Message message;
    for (const auto& [name, writer] : writers) {
      if (values == nullptr) continue;
      const ActuatorMapping& actuator = actuators_[writer.first];
      const double value = double{(*values)[writer.first]} * actuator.scale + actuator.offset;
      writer.second(message, clipped(value, actuator.limits));
    }
    publisher.publish(message);
  });
  return true;
}

void Outputs::publish(const std::vector<float>& actuators) {
  for (const auto& topic : topics_) topic(&actuators);
}

void Outputs::stop() {
  for (const auto& topic : topics_) topic(nullptr);
}
