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
    Value result{Kind::boolean};
    result.boolean = value;
    return result;
  }
  static Value of(double value) {
    Value result{Kind::number};
    result.number = value;
    return result;
  }
  static Value of(std::string value) {
    Value result{Kind::text};
    result.text = std::move(value);
    return result;
  }

  Value() = default;
  explicit Value(Kind initial) : kind(initial) {}

  const Value* find(const std::string& key) const {
    for (const auto& [name, value] : map) {
      if (name == key) return &value;
    }
    return nullptr;
  }
};
