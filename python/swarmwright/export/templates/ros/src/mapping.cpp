// @mark@; changes here are lost.
#include "mapping.hpp"

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <limits>
#include <regex>
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

// Returns a value for a message.
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
      return "'" + value.text + "'";
    case Value::Kind::list:
      for (const Value& element : value.list) {
        text << between << shown(element);
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

// A block of the mapping; keys that were not read are mistakes.
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

  // Returns a number that fits into binary32, the type of sensors and actuators.
  double single(const std::string& key) {
    const double value = finite(key, get(key));
    if (std::abs(value) > double{std::numeric_limits<float>::max()}) {
      fail(key + ": " + shown(Value::of(value)) + " found, expected at most 3.4e38");
    }
    return value;
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

  // Period of a direction, a full turn; 0 for other numbers.
  std::optional<Interval> interval(const std::string& key, double turn = 0) {
    const Value* value = find(key);
    if (value == nullptr) return std::nullopt;
    if (value->kind != Value::Kind::list || value->list.size() != 2) fail(key + ": expected two numbers [low, high]");
    const double low = finite(key, value->list[0]);  // in order, so that the error names the first mistake
    const Interval interval{low, finite(key, value->list[1])};
    if (!(low < interval.second)) {
      std::ostringstream remedy;
      if (interval.second < low && low < interval.second + turn) {
        remedy << "; write [" << low - turn << ", " << interval.second << "] or [" << low << ", "
               << interval.second + turn << "]";
      }
      fail(key + ": the first number must be below the second" + remedy.str());
    }
    return interval;
  }

  // Names and numbers: {left wheel: 0.5, right wheel: 0.5}.
  std::vector<std::pair<std::string, double>> weights(const std::string& key) {
    const Value& value = get(key);
    if (value.kind != Value::Kind::map || value.map.empty()) {
      fail(key + ": " + shown(value) + " found, expected weights by name, such as {left: 0.5, right: 0.5}");
    }
    std::vector<std::pair<std::string, double>> entries;
    for (const auto& [name, weight] : value.map) entries.emplace_back(name, finite(key + "." + name, weight));
    return entries;
  }

  std::optional<std::uint64_t> seed(const std::string& key) {
    if (!has(key)) return std::nullopt;
    const double value = number(key, 0);
    if (!(value >= 0 && value < 9007199254740992.0 && value == std::floor(value))) {
      fail(key + ": " + shown(get(key)) + " found, expected a whole number from 0 to 2^53 - 1");
    }
    return static_cast<std::uint64_t>(value);
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
    // In YAML 1.1, which ROS 1 uses, a number such as 1e-3 is a text.
    static const std::regex exponent("[-+]?(\\.[0-9]+|[0-9]+(\\.[0-9]*)?)[eE][-+]?[0-9]+");
    double number = NAN;
    const char* problem = "found";
    if (value.kind == Value::Kind::number) number = value.number;
    if (value.kind == Value::Kind::text && std::regex_match(value.text, exponent)) {
      number = std::strtod(value.text.c_str(), nullptr);
    } else if (value.kind == Value::Kind::text) {
      problem = "is text";
    }
    if (!std::isfinite(number)) fail(key + ": " + shown(value) + " " + problem + ", expected a number");
    return number;
  }

  std::string where_;
  const Value& value_;
  std::vector<std::string> known_;
};

Place place(Block& block) {
  // In order, so that the error names the first missing key.
  const std::string topic = block.text("topic");
  const std::string type = short_type(block.text("type"));
  return {block.where(), topic, type, block.has("field") ? block.text("field") : ""};
}

SensorMapping sensor(Block& block, double timeout) {
  SensorMapping sensor;
  if (block.has("source")) {
    const std::string source = block.text("source");
    sensor.place.where = block.where();
    if (source == "constant") {
      sensor.constant = block.single("value");
      return sensor;
    }
    if (source != "random") block.fail("source: '" + source + "' found, expected random or constant");
    sensor.random = true;
    sensor.seed = block.seed("seed");
    return sensor;
  }
  sensor.place = place(block);
  sensor.scale = block.number("scale", 1);
  sensor.offset = block.number("offset", 0);
  sensor.clip = block.interval("clip");
  sensor.timeout = block.positive("timeout", timeout);
  if (sensor.place.type == "sensor_msgs/LaserScan") {
    sensor.sector = block.interval("sector", 360);
    const std::string reduce = block.has("reduce") ? block.text("reduce") : "min";
    sensor.mean = reduce == "mean";
    if (!sensor.mean && reduce != "min") block.fail("reduce: '" + reduce + "' found, expected min or mean");
  }
  if (sensor.place.type == "sensor_msgs/LaserScan" || sensor.place.type == "sensor_msgs/Range") {
    if (block.has("infinite")) sensor.infinite = block.number("infinite", 0);
  }
  return sensor;
}

ActuatorMapping actuator(Block& block) {
  ActuatorMapping actuator;
  actuator.place = place(block);
  actuator.scale = block.number("scale", 1);
  actuator.offset = block.number("offset", 0);
  actuator.limits = block.interval("limits");
  return actuator;
}

std::string joined(const std::vector<std::string>& words) {
  std::string text;
  for (const std::string& word : words) text += (text.empty() ? "" : ", ") + word;
  return text;
}

const Value& listed(Block& mapping, const std::string& kind) {
  const Value& list = mapping.get(kind + "s");
  if (list.kind != Value::Kind::list) mapping.fail(kind + "s: expected a list, each entry begun by '- '");
  return list;
}

std::size_t index_of(const Block& block, const std::string& kind, const std::vector<std::string>& names,
                     const std::string& name) {
  const auto at = std::find(names.begin(), names.end(), name);
  if (at == names.end()) block.fail("the controller has no " + kind + " '" + name + "'; it has " + choice(names));
  return static_cast<std::size_t>(at - names.begin());
}

[[noreturn]] void missing(const std::string& kind, const std::string& name) {
  throw MappingError(kind + "s: '" + name + "' is missing; every " + kind + " needs an entry");
}

// Reads a list whose entries name the controller's sensors; the result is in the controller's order.
std::vector<SensorMapping> sensors_of(Block& mapping, const std::vector<std::string>& names, double timeout) {
  const Value& list = listed(mapping, "sensor");
  std::vector<std::optional<SensorMapping>> found(names.size());
  for (std::size_t i = 0; i < list.list.size(); ++i) {
    Block block("sensors[" + std::to_string(i) + "]", list.list[i]);
    const std::string name = block.text("sensor");
    std::optional<SensorMapping>& entry = found[index_of(block, "sensor", names, name)];
    block.name(name);
    if (entry) block.fail("is mapped twice");
    entry = sensor(block, timeout);
    block.no_others();
  }
  std::vector<SensorMapping> result;
  for (std::size_t i = 0; i < names.size(); ++i) {
    if (!found[i]) missing("sensor", names[i]);
    result.push_back(*found[i]);
  }
  return result;
}

// Reads a list whose entries name one of the controller's actuators, or several with their weights.
std::vector<ActuatorMapping> actuators_of(Block& mapping, const std::vector<std::string>& names) {
  const Value& list = listed(mapping, "actuator");
  std::vector<ActuatorMapping> result;
  std::vector<bool> used(names.size());
  std::vector<bool> alone(names.size());
  for (std::size_t i = 0; i < list.list.size(); ++i) {
    Block block("actuators[" + std::to_string(i) + "]", list.list[i]);
    std::vector<std::pair<std::size_t, double>> terms;
    const bool sum = block.has("actuators");
    if (sum) {
      for (const auto& [name, weight] : block.weights("actuators")) {
        terms.emplace_back(index_of(block, "actuator", names, name), weight);
      }
      std::sort(terms.begin(), terms.end());
    } else {
      terms.emplace_back(index_of(block, "actuator", names, block.text("actuator")), 1);
    }
    std::vector<std::string> called;
    for (const auto& term : terms) {
      called.push_back(names[term.first]);
      used[term.first] = true;
    }
    block.name(joined(called));
    if (!sum && alone[terms[0].first]) block.fail("is mapped twice");
    if (!sum) alone[terms[0].first] = true;
    result.push_back(actuator(block));
    result.back().terms = terms;
    block.no_others();
  }
  for (std::size_t i = 0; i < names.size(); ++i) {
    if (!used[i]) missing("actuator", names[i]);
  }
  std::stable_sort(result.begin(), result.end(), [](const ActuatorMapping& a, const ActuatorMapping& b) {
    return a.terms[0].first < b.terms[0].first;
  });
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
  mapping.sensors = sensors_of(block, sensors, timeout);
  mapping.actuators = actuators_of(block, actuators);
  block.no_others();
  return mapping;
}
