// Minisim is bit-identical to protocol/vectors/minisim.json.

#include "../examples/minisim/minisim.hpp"

#include "check.hpp"

#include <nlohmann/json.hpp>

#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <fstream>
#include <string>
#include <vector>

using minisim::Minisim;
using nlohmann::json;
using swarmwright::Parameters;

namespace {

std::string bits(float value) {
  std::uint32_t number = 0;
  std::memcpy(&number, &value, sizeof number);
  char text[9];
  std::snprintf(text, sizeof text, "%08x", static_cast<unsigned>(number));
  return text;
}

float single(const json& text) {
  const auto number = static_cast<std::uint32_t>(std::stoul(text.get<std::string>(), nullptr, 16));
  float value = 0;
  std::memcpy(&value, &number, sizeof value);
  return value;
}

void check_end(const json& end, Minisim& world) {
  CHECK_EQUAL(world.fitness(), std::strtod(end.at("fitness_hex").get<std::string>().c_str(), nullptr));
  double arrived = 0;
  double caught = 0;
  for (const json& state : end.at("states")) {
    arrived += state == "arrived" ? 1 : 0;
    caught += state == "caught" ? 1 : 0;
  }
  const std::vector<double> metrics = world.metrics();
  CHECK_EQUAL(metrics.at(0), arrived);
  CHECK_EQUAL(metrics.at(1), caught);
  CHECK_EQUAL(metrics.at(2), end.at("steps").get<double>());
}

void episodes_give_the_bits_of_the_vectors(const json& vectors) {
  Minisim world;
  for (const json& episode : vectors.at("episodes")) {
    world.reset(Parameters(episode.at("parameters").dump()), 0);
    for (const json& step : episode.at("steps")) {
      CHECK_EQUAL(json(world.acting()), step.at("acting"));
      std::vector<float> sensors(4);
      for (std::size_t i = 0; i < world.acting().size(); ++i) {
        world.sense(world.acting()[i], sensors);
        for (std::size_t k = 0; k < sensors.size(); ++k) {
          CHECK_EQUAL(bits(sensors[k]), step.at("sensor_bits").at(i).at(k).get<std::string>());
        }
      }
      std::vector<float> actuators;
      for (const json& text : step.at("actuator_bits")) {
        actuators.push_back(single(text));
      }
      world.step(actuators);
    }
    CHECK_EQUAL(world.done(), true);
    check_end(episode.at("end"), world);
  }
  CHECK_EQUAL(vectors.at("episodes").size() > 5, true);
}

void function_gives_the_bits(const json& points, float (*function)(float)) {
  CHECK_EQUAL(points.size() > 50, true);
  for (const json& point : points) {
    CHECK_EQUAL(bits(function(single(point.at(1)))), point.at(3).get<std::string>());
  }
}

void parameters_that_cannot_be_used_are_named() {
  const auto refused = [](const char* parameters) {
    return check::thrown<swarmwright::ParameterError>([&] { Minisim().reset(Parameters(parameters), 0); });
  };
  CHECK_EQUAL(refused(R"({"mapWidth": 0})"), "parameter mapWidth: 0 found, expected a whole number from 1 to 1000000");
  CHECK_EQUAL(refused(R"({"agents": []})"),
              "parameter agents: an empty list found, expected at least one position [x, y]");
  CHECK_EQUAL(refused(R"({"agents": [[1, 1]], "numAgents": 2})"),
              "parameter agents: 1 positions found, but numAgents is 2; make them agree or leave one out");
  CHECK_EQUAL(refused(R"({"speedAgents": -1})"),
              "parameter speedAgents: -1 found, expected a finite number of at least 0");
}

void the_picture_shows_who_is_where() {
  Minisim world;
  world.reset(Parameters("{}"), 0);
  CHECK_EQUAL(world.picture(),
              "Welcome to minisim, step 0\n.............\n.............\n.............\nA.......D...X\n"
              ".............\n.............\n.............");
}

}  // namespace

int main(int, char** values) {
  const std::string folder = values[1];
  episodes_give_the_bits_of_the_vectors(json::parse(std::ifstream(folder + "/minisim.json")));
  const json functions = json::parse(std::ifstream(folder + "/controllers.json")).at("functions");
  function_gives_the_bits(functions.at("sin_pi"), minisim::sin_pi);
  function_gives_the_bits(functions.at("cos_pi"), minisim::cos_pi);
  parameters_that_cannot_be_used_are_named();
  the_picture_shows_who_is_where();
  return check::status();
}
