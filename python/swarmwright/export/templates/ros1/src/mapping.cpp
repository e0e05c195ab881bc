// @mark@; changes here are lost.
#include "mapping.hpp"

#include <algorithm>
#include <cmath>
#include <sstream>

using XmlRpc::XmlRpcValue;

std::string choice(const std::vector<std::string>& words) {
  std::string text;
  for (std::size_t i = 0; i < words.size(); ++i) {
    if (i > 0) text += i + 1 == words.size() ? " or " : ", ";
    text += words[i];
  }
  return text;
}

namespace {

std::string shown(const XmlRpcValue& value) {
  std::ostringstream text;
  value.write(text);
  return text.str();
}

// One block of the mapping: its keys are asked for, and those that nobody asked for are mistakes.
class Block {
 public:
  Block(std::string where, XmlRpcValue value) : where_(std::move(where)), value_(std::move(value)) {
    if (value_.getType() != XmlRpcValue::TypeStruct) fail("expected keys and values");
  }

  [[noreturn]] void fail(const std::string& reason) const { throw MappingError(where_ + ": " + reason); }

  void name(const std::string& name) { where_ += " (" + name + ")"; }
  const std::string& where() const { return where_; }

  bool has(const std::string& key) {
    if (std::find(known_.begin(), known_.end(), key) == known_.end()) known_.push_back(key);
    return value_.hasMember(key);
  }

  XmlRpcValue& get(const std::string& key) {
    if (!has(key)) fail(key + " is missing");
    return value_[key];
  }

  std::string text(const std::string& key) {
    XmlRpcValue& value = get(key);
    if (value.getType() != XmlRpcValue::TypeString) fail(key + ": " + shown(value) + " found, expected text");
    const std::string& text = value;
    if (text.empty()) fail(key + " is empty");
    return text;
  }

  double number(const std::string& key, double otherwise) { return has(key) ? finite(key, value_[key]) : otherwise; }

  double positive(const std::string& key, double otherwise) {
    const double value = number(key, otherwise);
    if (!(value > 0)) fail(key + ": " + shown(value_[key]) + " found, expected more than 0");
    return value;
  }

  bool flag(const std::string& key) {
    if (!has(key)) return false;
    XmlRpcValue& value = value_[key];
    if (value.getType() != XmlRpcValue::TypeBoolean) fail(key + ": " + shown(value) + " found, expected true or false");
    return value;
  }

  std::optional<Interval> interval(const std::string& key) {
    if (!has(key)) return std::nullopt;
    XmlRpcValue& value = value_[key];
    if (value.getType() != XmlRpcValue::TypeArray || value.size() != 2)
      fail(key + ": expected two numbers [low, high]");
    const Interval found{finite(key, value[0]), finite(key, value[1])};
    if (!(found.first < found.second)) fail(key + ": the first number must be below the second");
    return found;
  }

  void no_others() const {
    for (const auto& [key, value] : value_) {
      (void)value;
      if (std::find(known_.begin(), known_.end(), key) == known_.end()) {
        fail("unknown key '" + key + "'; expected " + choice(known_));
      }
    }
  }

 private:
  double finite(const std::string& key, XmlRpcValue& value) const {
    double number = NAN;
    if (value.getType() == XmlRpcValue::TypeInt) number = static_cast<int>(value);
    if (value.getType() == XmlRpcValue::TypeDouble) number = static_cast<double>(value);
    if (!std::isfinite(number)) fail(key + ": " + shown(value) + " found, expected a number");
    return number;
  }

  std::string where_;
  mutable XmlRpcValue value_;  // its members can be read only where it may be changed
  std::vector<std::string> known_;
};

Place place(Block& block) {
  // One after the other: the first that is missing is named.
  const std::string topic = block.text("topic");
  const std::string type = block.text("type");
  return {block.where(), topic, type, block.has("field") ? block.text("field") : ""};
}

SensorMapping sensor(Block& block, double timeout) {
  SensorMapping found;
  found.place = place(block);
  found.scale = block.number("scale", 1);
  found.offset = block.number("offset", 0);
  found.clip = block.interval("clip");
  found.timeout = block.positive("timeout", timeout);
  if (found.place.type == "sensor_msgs/LaserScan") {
    found.sector = block.interval("sector");
    const std::string reduce = block.has("reduce") ? block.text("reduce") : "min";
    found.mean = reduce == "mean";
    if (!found.mean && reduce != "min") block.fail("reduce: '" + reduce + "' found, expected min or mean");
  }
  if (found.place.type == "sensor_msgs/LaserScan" || found.place.type == "sensor_msgs/Range") {
    if (block.has("infinite")) found.infinite = block.number("infinite", 0);
  }
  return found;
}

ActuatorMapping actuator(Block& block) {
  ActuatorMapping found;
  found.place = place(block);
  found.scale = block.number("scale", 1);
  found.offset = block.number("offset", 0);
  found.limits = block.interval("limits");
  return found;
}

// Reads a list whose entries name the controller's sensors or actuators; the result is in the controller's order.
template <typename Entry, typename Read>
std::vector<Entry> entries(Block& mapping, const std::string& kind, const std::vector<std::string>& names, Read read) {
  XmlRpcValue& list = mapping.get(kind + "s");
  if (list.getType() != XmlRpcValue::TypeArray) mapping.fail(kind + "s: expected a list, each entry begun by '- '");
  std::vector<std::optional<Entry>> found(names.size());
  for (int i = 0; i < list.size(); ++i) {
    Block block(kind + "s[" + std::to_string(i) + "]", list[i]);
    const std::string name = block.text(kind);
    const auto at = std::find(names.begin(), names.end(), name);
    if (at == names.end()) block.fail("the controller has no " + kind + " '" + name + "'; it has " + choice(names));
    block.name(name);
    std::optional<Entry>& entry = found[at - names.begin()];
    if (entry) block.fail("is mapped twice");
    entry = read(block);
    block.no_others();
  }
  std::vector<Entry> result;
  for (std::size_t i = 0; i < names.size(); ++i) {
    if (!found[i]) throw MappingError(kind + "s: '" + names[i] + "' is missing; every " + kind + " needs an entry");
    result.push_back(*found[i]);
  }
  return result;
}

}  // namespace

Mapping read_mapping(const XmlRpcValue& value, const std::vector<std::string>& sensors,
                     const std::vector<std::string>& actuators) {
  Block block("mapping", value);
  Mapping mapping;
  block.get("rate");
  mapping.rate = block.positive("rate", 0);
  const double timeout = block.positive("timeout", 0.5);
  mapping.reset_after_silence = block.flag("reset_after_silence");
  mapping.sensors =
      entries<SensorMapping>(block, "sensor", sensors, [timeout](Block& entry) { return sensor(entry, timeout); });
  mapping.actuators = entries<ActuatorMapping>(block, "actuator", actuators, actuator);
  block.no_others();
  return mapping;
}
