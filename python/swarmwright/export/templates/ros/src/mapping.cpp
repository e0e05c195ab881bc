// @mark@; changes here are lost.
#include "mapping.hpp"

#include <algorithm>
#include <cmath>
#include <sstream>

std::string choice(const std::vector<std::string>& words) {
  std::string text;
  for (std::size_t i = 0; i < words.size(); ++i) {
    if (i > 0) text += i + 1 == words.size() ? " or " : ", ";
    text += words[i];
  }
  return text;
}

std::string short_type(const std::string& name) {
  const std::size_t first = name.find('/');
  const std::size_t last = name.rfind('/');
  if (first == std::string::npos || last == first) return name;
  const std::string group = name.substr(first + 1, last - first - 1);
  return group == "msg" || group == "srv" ? name.substr(0, first) + name.substr(last) : name;
}

namespace {

// A value as messages repeat it.
std::string shown(const Value& value) {
  std::ostringstream text;
  const char* between = "";
  switch (value.kind) {
    case Value::Kind::nothing:
      return "nothing";
    case Value::Kind::boolean:
      return value.boolean ? "true" : "false";
    case Value::Kind::number:
      text << value.number;
      return text.str();
    case Value::Kind::text:
      return value.text;
    case Value::Kind::list:
      for (const Value& one : value.list) {
        text << between << shown(one);
        between = ", ";
      }
      return "[" + text.str() + "]";
    case Value::Kind::map:
      for (const auto& [key, one] : value.map) {
        text << between << key << ": " << shown(one);
        between = ", ";
      }
      return "{" + text.str() + "}";
  }
  return "";
}

// One block of the mapping: its keys are asked for, and those that nobody asked for are mistakes.
class Block {
 public:
  Block(std::string where, const Value& value) : where_(std::move(where)), value_(value) {
    if (value_.kind != Value::Kind::map) fail("expected keys and values");
  }

  [[noreturn]] void fail(const std::string& reason) const { throw MappingError(where_ + ": " + reason); }

  void name(const std::string& name) { where_ += " (" + name + ")"; }
  const std::string& where() const { return where_; }

  bool has(const std::string& key) { return find(key) != nullptr; }

  const Value& get(const std::string& key) {
    const Value* value = find(key);
    if (value == nullptr) fail(key + " is missing");
    return *value;
  }

  std::string text(const std::string& key) {
    const Value& value = get(key);
    if (value.kind != Value::Kind::text) fail(key + ": " + shown(value) + " found, expected text");
    if (value.text.empty()) fail(key + " is empty");
    return value.text;
  }

  double number(const std::string& key, double otherwise) {
    const Value* value = find(key);
    return value == nullptr ? otherwise : finite(key, *value);
  }

  double positive(const std::string& key, double otherwise) {
    const double value = number(key, otherwise);
    if (!(value > 0)) fail(key + ": " + shown(Value::of(value)) + " found, expected more than 0");
    return value;
  }

  bool flag(const std::string& key) {
    const Value* value = find(key);
    if (value == nullptr) return false;
    if (value->kind != Value::Kind::boolean) fail(key + ": " + shown(*value) + " found, expected true or false");
    return value->boolean;
  }

  std::optional<Interval> interval(const std::string& key) {
    const Value* value = find(key);
    if (value == nullptr) return std::nullopt;
    if (value->kind != Value::Kind::list || value->list.size() != 2) fail(key + ": expected two numbers [low, high]");
    const double low = finite(key, value->list[0]);  // one after the other: the first that is none is named
    const Interval found{low, finite(key, value->list[1])};
    if (!(found.first < found.second)) fail(key + ": the first number must be below the second");
    return found;
  }

  void no_others() const {
    for (const auto& [key, value] : value_.map) {
      (void)value;
      if (std::find(known_.begin(), known_.end(), key) == known_.end()) {
        fail("unknown key '" + key + "'; expected " + choice(known_));
      }
    }
  }

 private:
  const Value* find(const std::string& key) {
    if (std::find(known_.begin(), known_.end(), key) == known_.end()) known_.push_back(key);
    return value_.find(key);
  }

  double finite(const std::string& key, const Value& value) const {
    if (value.kind != Value::Kind::number || !std::isfinite(value.number)) {
      fail(key + ": " + shown(value) + " found, expected a number");
    }
    return value.number;
  }

  std::string where_;
  const Value& value_;
  std::vector<std::string> known_;
};

Place place(Block& block) {
  // One after the other: the first that is missing is named.
  const std::string topic = block.text("topic");
  const std::string type = short_type(block.text("type"));
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
  const Value& list = mapping.get(kind + "s");
  if (list.kind != Value::Kind::list) mapping.fail(kind + "s: expected a list, each entry begun by '- '");
  std::vector<std::optional<Entry>> found(names.size());
  for (std::size_t i = 0; i < list.list.size(); ++i) {
    Block block(kind + "s[" + std::to_string(i) + "]", list.list[i]);
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

Mapping read_mapping(const Value& value, const std::vector<std::string>& sensors,
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
