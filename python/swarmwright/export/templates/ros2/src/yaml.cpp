// @mark@; changes here are lost.
#include "yaml.hpp"

#include <yaml-cpp/yaml.h>

#include <algorithm>
#include <cerrno>
#include <cmath>
#include <cstdlib>
#include <cstring>
#include <fstream>
#include <ios>
#include <iterator>
#include <regex>

#include "mapping.hpp"

namespace {

constexpr int kDeepest = 10;

bool any(const std::string& text, std::initializer_list<const char*> words) {
  return std::find(words.begin(), words.end(), text) != words.end();
}

// Returns the value of a word without quotes, as in YAML 1.1, where on, yes and true are equal.
Value plain(const std::string& text) {
  static const std::regex number("[-+]?(\\.[0-9]+|[0-9]+(\\.[0-9]*)?)([eE][-+]?[0-9]+)?");
  if (any(text, {"true", "True", "TRUE", "yes", "Yes", "YES", "on", "On", "ON"})) return Value::of(true);
  if (any(text, {"false", "False", "FALSE", "no", "No", "NO", "off", "Off", "OFF"})) return Value::of(false);
  if (std::regex_match(text, number)) return Value::of(std::strtod(text.c_str(), nullptr));
  if (any(text, {".inf", ".Inf", ".INF", "+.inf", "+.Inf", "+.INF"})) return Value::of(HUGE_VAL);
  if (any(text, {"-.inf", "-.Inf", "-.INF"})) return Value::of(-HUGE_VAL);
  if (any(text, {".nan", ".NaN", ".NAN"})) return Value::of(std::nan(""));
  return Value::of(text);
}

Value value_of(const YAML::Node& node, const std::string& file, int depth) {
  if (depth > kDeepest) {
    throw MappingError("mapping: " + file + ": is nested more than " + std::to_string(kDeepest) + " levels deep");
  }
  Value result;
  if (node.IsScalar()) {
    const bool quoted = node.Tag() == "!" || node.Tag() == "tag:yaml.org,2002:str";
    return quoted ? Value::of(node.Scalar()) : plain(node.Scalar());
  }
  if (node.IsSequence()) {
    result.kind = Value::Kind::list;
    for (const YAML::Node& item : node) result.list.push_back(value_of(item, file, depth + 1));
  }
  if (node.IsMap()) {
    result.kind = Value::Kind::map;
    for (const auto& item : node) {
      const std::string key = item.first.IsScalar() ? item.first.Scalar() : "?";
      const auto same = [&key](const auto& other) { return other.first == key; };
      result.map.erase(std::remove_if(result.map.begin(), result.map.end(), same), result.map.end());
      result.map.emplace_back(key, value_of(item.second, file, depth + 1));
    }
    std::sort(result.map.begin(), result.map.end(), [](const auto& a, const auto& b) { return a.first < b.first; });
  }
  return result;
}

}  // namespace

Value read_yaml(const std::string& file) {
  std::ifstream stream(file);
  std::string text;
  try {
    if (stream) text.assign(std::istreambuf_iterator<char>(stream), {});
  } catch (const std::ios_base::failure&) {  // for example, for a folder
    stream.setstate(std::ios_base::failbit);
  }
  if (!stream) throw MappingError("mapping: " + file + ": cannot be read: " + std::strerror(errno));
  try {
    return value_of(YAML::Load(text), file, 0);
  } catch (const YAML::Exception& error) {
    throw MappingError("mapping: " + file + ": is not YAML: line " + std::to_string(error.mark.line + 1) + ": " +
                       error.msg);
  }
}
