// @mark@; changes here are lost.
// A plain value, as YAML and ROS have them.
#pragma once

#include <string>
#include <utility>
#include <vector>

struct Value {
  enum class Kind { nothing, boolean, number, text, list, map };

  Kind kind = Kind::nothing;
  bool boolean = false;
  double number = 0;
  std::string text;
  std::vector<Value> list;
  std::vector<std::pair<std::string, Value>> map;  // sorted by key, each once

  static Value of(bool value) {
    Value made{Kind::boolean};
    made.boolean = value;
    return made;
  }
  static Value of(double value) {
    Value made{Kind::number};
    made.number = value;
    return made;
  }
  static Value of(std::string value) {
    Value made{Kind::text};
    made.text = std::move(value);
    return made;
  }

  Value() = default;
  explicit Value(Kind given) : kind(given) {}

  const Value* find(const std::string& key) const {
    for (const auto& [name, value] : map) {
      if (name == key) return &value;
    }
    return nullptr;
  }
};
