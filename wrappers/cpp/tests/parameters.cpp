// Parameters are read with type and range, and errors say what is wrong.

#include "check.hpp"

#include <swarmwright/swarmwright.hpp>

#include <cstdint>
#include <limits>
#include <string>
#include <vector>

using swarmwright::ParameterError;
using swarmwright::Parameters;

namespace {

constexpr double infinity = std::numeric_limits<double>::infinity();

void what_is_there_is_read() {
  const Parameters read(R"({"n": 13.0, "x": 0.1, "on": true, "name": "M\u00f6we\u0000!", "kind": "b", "seed": -1,
    "list": [1, 2.5], "at": [1, 2], "all": [[1, 2], [0, 7]], "none": [], "deep": {"a": [1]}})");
  CHECK_EQUAL(read.integer("n", 1, 20, 5), 13);
  CHECK_EQUAL(read.integer<std::uint32_t>("n", 1, 4294967295U, 5), 13U);
  CHECK_EQUAL(read.number("x", 0, infinity, 5), 0.1);
  CHECK_EQUAL(read.single("x", 0, 1, 5), 0.1F);
  CHECK_EQUAL(read.flag("on", false), true);
  CHECK_EQUAL(read.text("name", ""), std::string("M\xc3\xb6we\0!", 7));
  CHECK_EQUAL(read.choice("kind", {"a", "b"}), 1U);
  CHECK_EQUAL(read.seed("seed"), std::numeric_limits<std::uint64_t>::max());
  CHECK_EQUAL(read.numbers("list", 0, 2)->at(1), 2.5);
  CHECK_EQUAL(read.numbers("none", 0, 2)->size(), 0U);
  CHECK_EQUAL(read.position("at", 13, 7)->at(1), 2.0F);
  CHECK_EQUAL(read.positions("all", 2, 13, 7)->at(1)[1], 7.0F);
  CHECK_EQUAL(read.positions("none", 2, 13, 7)->size(), 0U);
  CHECK_EQUAL(read.has("deep"), true);
  CHECK_EQUAL(Parameters(R"({"deep": {"a": [1]}})").json(), R"({"deep":{"a":[1]}})");
}

void what_is_absent_has_its_default() {
  const Parameters read("{}");
  CHECK_EQUAL(read.integer("n", 1, 20, 5), 5);
  CHECK_EQUAL(read.number("x", 0, infinity, 5), 5.0);
  CHECK_EQUAL(read.single("x", 0, 1, 0.5F), 0.5F);
  CHECK_EQUAL(read.flag("on", true), true);
  CHECK_EQUAL(read.text("name", "nobody"), "nobody");
  CHECK_EQUAL(read.choice("kind", {"a", "b"}), 0U);
  CHECK_EQUAL(read.seed("seed"), 0U);
  CHECK_EQUAL(read.numbers("list", 0, 2).has_value(), false);
  CHECK_EQUAL(read.position("at", 13, 7).has_value(), false);
  CHECK_EQUAL(read.positions("all", 2, 13, 7).has_value(), false);
  CHECK_EQUAL(read.has("n"), false);
}

void what_does_not_fit_is_named() {
  const Parameters read(
      R"({"n": "13", "x": -1, "big": 1e39, "on": 1, "name": 3, "kind": "c", "list": [1, "a"], "at": [14, 1],
    "all": [[1, 2], [3]], "seed": 1.5})");
  CHECK_THROWS(ParameterError, "parameter n: \"13\" (a string) found, expected a whole number from 1 to 20",
               read.integer("n", 1, 20, 5));
  CHECK_THROWS(ParameterError, "parameter x: -1 found, expected a finite number of at least 0",
               read.number("x", 0, infinity, 5));
  CHECK_THROWS(ParameterError, "parameter x: -1 found, expected a number from 0 to 0.5", read.number("x", 0, 0.5, 5));
  CHECK_THROWS(ParameterError, "parameter x: -1 found, expected a finite number of at most -2",
               read.number("x", -infinity, -2, 5));
  CHECK_THROWS(ParameterError, "parameter n: \"13\" (a string) found, expected a finite number",
               read.number("n", -infinity, infinity, 5));
  CHECK_THROWS(ParameterError, "parameter big: 1e+39 found, expected a finite number of at least 0",
               read.single("big", 0, std::numeric_limits<float>::infinity(), 5));
  CHECK_THROWS(ParameterError, "parameter on: 1 found, expected true or false", read.flag("on", false));
  CHECK_THROWS(ParameterError, "parameter name: 3 found, expected a string", read.text("name", ""));
  CHECK_THROWS(ParameterError, "parameter kind: \"c\" (a string) found, expected one of \"a\", \"b\"",
               read.choice("kind", {"a", "b"}));
  CHECK_THROWS(ParameterError, "parameter list[1]: \"a\" (a string) found, expected a finite number",
               read.numbers("list", 0, 2));
  CHECK_THROWS(ParameterError, "parameter list: 2 numbers found, expected 3", read.numbers("list", 3, 3));
  CHECK_THROWS(ParameterError, "parameter list: 2 numbers found, expected at most 1", read.numbers("list", 0, 1));
  CHECK_THROWS(ParameterError, "parameter x: -1 found, expected a list of numbers", read.numbers("x", 0, 1));
  CHECK_THROWS(ParameterError, "parameter at: [14,1] found, expected a position inside the map, [0, 0] to [13, 7]",
               read.position("at", 13, 7));
  CHECK_THROWS(ParameterError, "parameter all[1]: [3] found, expected a position [x, y] of two numbers",
               read.positions("all", 2, 13, 7));
  CHECK_THROWS(ParameterError, "parameter all: 2 positions found, at most 1 are possible",
               read.positions("all", 1, 13, 7));
  CHECK_THROWS(ParameterError, "parameter seed: 1.5 found, expected a whole number of at most 64 bits",
               read.seed("seed"));
  try {
    read.flag("on", false);
  } catch (const ParameterError& error) {
    CHECK_EQUAL(error.name(), "on");
    CHECK_EQUAL(error.reason(), "1 found, expected true or false");
  }
  CHECK_EQUAL(
      check::thrown<std::invalid_argument>([] { Parameters("[1]"); }).rfind("the parameters are not a JSON object", 0),
      0U);
}

}  // namespace

int main() {
  what_is_there_is_read();
  what_is_absent_has_its_default();
  what_does_not_fit_is_named();
  return check::status();
}
