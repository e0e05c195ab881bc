// @mark@; changes here are lost.
#include "topics.hpp"

#include <algorithm>
#include <cmath>
#include <map>
#include <random>
#include <sstream>

namespace {

using Reading = std::optional<double>;  // none: the message has no value for this sensor

template <typename Message>
using Reader = std::function<Reading(const Message&, const SensorMapping&)>;
template <typename Message>
using Readers = std::map<std::string, Reader<Message>>;  // by field
template <typename Message>
using Writers = std::map<std::string, std::function<void(Message&, double)>>;

constexpr double kDegree = 3.14159265358979323846 / 180;

// A range as in REP 117: above the largest range, nothing was detected; minus infinity is too close for a measurement;
// NaN and other numbers below the smallest range are no measurements. A largest range of 0 is unknown.
Reading range(double value, double smallest, double largest, const SensorMapping& sensor) {
  const bool limited = largest > 0 && std::isfinite(largest);
  if (value == -INFINITY) return smallest;
  if (value == INFINITY || (limited && value > largest)) {
    if (sensor.infinite) return sensor.infinite;
    return limited ? Reading(largest) : std::nullopt;
  }
  if (std::isnan(value) || value < smallest) return std::nullopt;
  return value;
}

// Returns whether an angle is in a sector, both in degrees, in any turn. Both ends belong to it, with a tolerance for
// rounding.
bool within(double angle, const Interval& sector) {
  constexpr double tolerance = 1e-4;
  const double from = angle - sector.first + tolerance;
  return from - 360 * std::floor(from / 360) <= sector.second - sector.first + 2 * tolerance;
}

// Returns the smallest range of a sector, or the mean of its ranges, summed in the order of the message.
Reading sector(const messages::LaserScan& scan, const SensorMapping& sensor) {
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

double yaw(const messages::Quaternion& q) {
  return std::atan2(2 * (q.w * q.z + q.x * q.y), 1 - 2 * (q.y * q.y + q.z * q.z));
}

// The fields of each type of message; `type` is its name in the mapping.
template <typename Message>
struct Type;

#define READ(expression)                                      \
  [](const auto& m, const SensorMapping& sensor) -> Reading { \
    (void)sensor, (void)m;                                    \
    return expression;                                        \
  }
#define READ_VECTOR(path) \
  {#path ".x", READ(m.path.x)}, {#path ".y", READ(m.path.y)}, { #path ".z", READ(m.path.z) }
#define WRITE(member) [](auto& m, double value) { m.member = static_cast<decltype(m.member)>(value); }
#define WRITE_VECTOR(path) \
  {#path ".x", WRITE(path.x)}, {#path ".y", WRITE(path.y)}, { #path ".z", WRITE(path.z) }

template <>
struct Type<messages::LaserScan> {
  static constexpr const char* name = "sensor_msgs/LaserScan";
  static Readers<messages::LaserScan> readers() { return {{"ranges", sector}}; }
};

template <>
struct Type<messages::Range> {
  static constexpr const char* name = "sensor_msgs/Range";
  static Readers<messages::Range> readers() {
    return {{"range", READ(range(m.range, m.min_range, m.max_range, sensor))}};
  }
};

template <>
struct Type<messages::Odometry> {
  static constexpr const char* name = "nav_msgs/Odometry";
  static Readers<messages::Odometry> readers() {
    return {READ_VECTOR(pose.pose.position),
            {"yaw", READ(yaw(m.pose.pose.orientation))},
            READ_VECTOR(twist.twist.linear),
            READ_VECTOR(twist.twist.angular)};
  }
};

template <>
struct Type<messages::Twist> {
  static constexpr const char* name = "geometry_msgs/Twist";
  static Readers<messages::Twist> readers() { return {READ_VECTOR(linear), READ_VECTOR(angular)}; }
  static Writers<messages::Twist> writers() { return {WRITE_VECTOR(linear), WRITE_VECTOR(angular)}; }
};

template <>
struct Type<messages::TwistStamped> {
  static constexpr const char* name = "geometry_msgs/TwistStamped";
  static Readers<messages::TwistStamped> readers() { return {READ_VECTOR(twist.linear), READ_VECTOR(twist.angular)}; }
  static Writers<messages::TwistStamped> writers() { return {WRITE_VECTOR(twist.linear), WRITE_VECTOR(twist.angular)}; }
};

template <>
struct Type<messages::PoseStamped> {
  static constexpr const char* name = "geometry_msgs/PoseStamped";
  static Readers<messages::PoseStamped> readers() {
    return {READ_VECTOR(pose.position), {"yaw", READ(yaw(m.pose.orientation))}};
  }
};

template <>
struct Type<messages::PoseWithCovarianceStamped> {
  static constexpr const char* name = "geometry_msgs/PoseWithCovarianceStamped";
  static Readers<messages::PoseWithCovarianceStamped> readers() {
    return {READ_VECTOR(pose.pose.position), {"yaw", READ(yaw(m.pose.pose.orientation))}};
  }
};

template <typename Message>
struct Number {
  static Readers<Message> readers() { return {{"data", READ(m.data)}}; }
  static Writers<Message> writers() { return {{"data", WRITE(data)}}; }
};

template <>
struct Type<messages::Float32> : Number<messages::Float32> {
  static constexpr const char* name = "std_msgs/Float32";
};

template <>
struct Type<messages::Float64> : Number<messages::Float64> {
  static constexpr const char* name = "std_msgs/Float64";
};

// Messages with a header contain the time.
void stamp(const Graph& graph, messages::TwistStamped& message) { graph.stamp(message.header); }
template <typename Message>
void stamp(const Graph&, Message&) {}

template <typename... Messages>
struct Types {};
using Sensed = Types<messages::LaserScan, messages::Range, messages::Odometry, messages::Twist, messages::TwistStamped,
                     messages::PoseStamped, messages::PoseWithCovarianceStamped, messages::Float32, messages::Float64>;
using Commanded = Types<messages::Twist, messages::TwistStamped, messages::Float32, messages::Float64>;

template <typename Message>
struct Tag {
  using type = Message;
};

// Calls a function with a tag for each type.
template <typename... Messages, typename Function>
auto each(Types<Messages...>, const Function& function) {
  return function(Tag<Messages>{}...);
}

template <typename... Messages>
std::vector<std::string> names(Types<Messages...>) {
  return {Type<Messages>::name...};
}

// The name of a field and its function to read or write; optional in the mapping if a type has a single field.
template <typename Use>
std::pair<std::string, Use> field(const std::map<std::string, Use>& fields, const Place& place) {
  if (place.field.empty() && fields.size() == 1) return *fields.begin();
  const auto entry = fields.find(place.field);
  if (entry != fields.end()) return *entry;
  std::vector<std::string> names;
  for (const auto& [name, use] : fields) names.push_back(name);
  const std::string problem = place.field.empty() ? "is missing" : "'" + place.field + "' is not in " + place.type;
  throw MappingError(place.where + ": field " + problem + "; expected " + choice(names));
}

// Checks that all entries of a topic, and other nodes, use the same type.
template <typename Entry>
std::string type_of(const Graph& graph, const std::string& topic, const std::vector<Entry>& entries) {
  const Place* first = nullptr;
  for (const Entry& entry : entries) {
    if (entry.place.topic != topic) continue;
    if (first == nullptr) first = &entry.place;
    if (entry.place.type != first->type) {
      throw MappingError(entry.place.where + ": " + topic + " has the type " + first->type + " at " + first->where +
                         " and " + entry.place.type + " here; a topic has one type");
    }
  }
  for (const std::string& full_type : graph.types(topic)) {
    const std::string type = short_type(full_type);
    if (type != first->type && type != "*") {
      throw MappingError(first->where + ": " + topic + " has the type " + type + ", but the mapping says " +
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
    if (!topic.empty() && std::find(topics.begin(), topics.end(), topic) == topics.end()) topics.push_back(topic);
  }
  return topics;
}

template <typename Entry>
[[noreturn]] void unknown_type(const std::string& topic, const std::vector<Entry>& entries,
                               const std::vector<std::string>& types) {
  const auto at =
      std::find_if(entries.begin(), entries.end(), [&](const Entry& entry) { return entry.place.topic == topic; });
  throw MappingError(at->place.where + ": the type '" + at->place.type + "' is unknown; expected " + choice(types));
}

double total(const std::vector<float>& actuators, const ActuatorMapping& actuator) {
  double sum = 0;
  for (const auto& [index, weight] : actuator.terms) sum += weight * double{actuators[index]};
  return sum;
}

double clipped(double value, const std::optional<Interval>& interval) {
  return interval ? std::clamp(value, interval->first, interval->second) : value;
}

void add(std::vector<std::string>& texts, const std::string& text) {
  if (std::find(texts.begin(), texts.end(), text) == texts.end()) texts.push_back(text);
}

std::string unusable(const SensorMapping& sensor) {
  std::ostringstream text;
  text << sensor.place.topic << ": messages come, but none has a usable value";
  if (sensor.sector) text << " within [" << sensor.sector->first << ", " << sensor.sector->second << "] degrees";
  return text.str();
}

std::string joined(const std::vector<std::string>& texts, const std::string& between) {
  std::string all;
  for (const std::string& text : texts) all += (all.empty() ? "" : between) + text;
  return all;
}

}  // namespace

std::string Missing::text(const std::string& word, const std::string& of_silent) const {
  if (silent.empty()) return word + ": " + joined(unusable, "; ");
  return word + of_silent + joined(silent, ", ") + (unusable.empty() ? "" : "; ") + joined(unusable, "; ");
}

Generator::Generator(std::optional<std::uint64_t> seed) {
  std::random_device device;  // differs from robot to robot
  state_ = seed ? *seed : std::uint64_t{device()} << 32 | device();
}

float Generator::next() {
  state_ += 0x9e3779b97f4a7c15u;
  std::uint64_t z = state_;
  z = (z ^ (z >> 30)) * 0xbf58476d1ce4e5b9u;
  z = (z ^ (z >> 27)) * 0x94d049bb133111ebu;
  return static_cast<float>((z ^ (z >> 31)) >> 40) * (1.0f / 16777216.0f);
}

Inputs::Inputs(Graph& graph, const std::vector<SensorMapping>& sensors)
    : graph_(graph), sensors_(sensors), values_(sensors.size()), times_(sensors.size()), heard_(sensors.size()) {
  for (std::size_t i = 0; i < sensors_.size(); ++i) {
    if (sensors_[i].random) generators_.emplace_back(i, Generator(sensors_[i].seed));
    if (sensors_[i].constant) values_[i] = static_cast<float>(*sensors_[i].constant);
  }
  for (const std::string& topic : topics_of(sensors_)) {
    const std::string type = type_of(graph_, topic, sensors_);
    const auto any = [&](auto... message) { return (subscribe<typename decltype(message)::type>(topic, type) || ...); };
    if (!each(Sensed{}, any)) unknown_type(topic, sensors_, names(Sensed{}));
  }
}

template <typename Message>
bool Inputs::subscribe(const std::string& topic, const std::string& type) {
  if (type != Type<Message>::name) return false;
  std::vector<std::pair<std::size_t, Reader<Message>>> readers;
  for (std::size_t i = 0; i < sensors_.size(); ++i) {
    if (sensors_[i].place.topic != topic) continue;
    readers.emplace_back(i, field(Type<Message>::readers(), sensors_[i].place).second);
  }
  graph_.subscribe<Message>(topic, [this, readers](const Message& message) {
    for (const auto& [i, reader] : readers) {
      const SensorMapping& sensor = sensors_[i];
      const Reading value = reader(message, sensor);
      heard_[i] = graph_.seconds();
      if (!value) continue;
      const auto sensed = static_cast<float>(clipped(*value * sensor.scale + sensor.offset, sensor.clip));
      // NaN and infinities are no measurements, and are ignored.
      if (!std::isfinite(sensed)) continue;
      values_[i] = sensed;
      times_[i] = graph_.seconds();
    }
  });
  return true;
}

Missing Inputs::missing() const {
  Missing missing;
  const double now = graph_.seconds();
  for (std::size_t i = 0; i < sensors_.size(); ++i) {
    const SensorMapping& sensor = sensors_[i];
    // Messages from the future are from before a restart of the simulation.
    const auto recent = [&](const std::optional<double>& time) {
      return time && now >= *time && now - *time <= sensor.timeout;
    };
    if (sensor.place.topic.empty() || recent(times_[i])) continue;
    if (recent(heard_[i])) {
      add(missing.unusable, unusable(sensor));
    } else {
      add(missing.silent, sensor.place.topic);
    }
  }
  return missing;
}

void Inputs::draw() {
  for (auto& [i, generator] : generators_) values_[i] = generator.next();
}

void Inputs::check_types() const {
  for (const std::string& topic : topics_of(sensors_)) type_of(graph_, topic, sensors_);
}

Outputs::Outputs(Graph& graph, const std::vector<ActuatorMapping>& actuators) : graph_(graph), actuators_(actuators) {
  for (const std::string& topic : topics_of(actuators_)) {
    const std::string type = type_of(graph_, topic, actuators_);
    const auto any = [&](auto... message) { return (advertise<typename decltype(message)::type>(topic, type) || ...); };
    if (!each(Commanded{}, any)) unknown_type(topic, actuators_, names(Commanded{}));
  }
}

template <typename Message>
bool Outputs::advertise(const std::string& topic, const std::string& type) {
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
  const auto publisher = graph_.advertise<Message>(topic, 1);
  topics_.push_back([this, publisher, writers](const std::vector<float>* values) {
    Message message;
    stamp(graph_, message);
    for (const auto& [name, writer] : writers) {
      if (values == nullptr) continue;
      const ActuatorMapping& actuator = actuators_[writer.first];
      const double value = total(*values, actuator) * actuator.scale + actuator.offset;
      writer.second(message, clipped(value, actuator.limits));
    }
    publisher->publish(message);
  });
  return true;
}

void Outputs::publish(const std::vector<float>& actuators) {
  for (const auto& topic : topics_) topic(&actuators);
}

void Outputs::stop() {
  for (const auto& topic : topics_) topic(nullptr);
}

void Outputs::check_types() const {
  for (const std::string& topic : topics_of(actuators_)) type_of(graph_, topic, actuators_);
}
