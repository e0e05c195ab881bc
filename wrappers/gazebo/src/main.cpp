// A simulation server: missions of the arena in Gazebo.
//
//   swarmwright-gazebo --broker mqtt://localhost:1883 --id 6

#include <swarmwright/gazebo_physics.hpp>

#include "library.hpp"

#include <algorithm>
#include <array>
#include <cstdlib>
#include <exception>
#include <fstream>
#include <iostream>
#include <stdexcept>
#include <string>
#include <string_view>
#include <vector>

namespace {

namespace gz = swarmwright::gazebo;

constexpr const char* usage =
    "  --world         file in SDF in which missions take place: robots and objects are put there\n"
    "  --walls         mission: the walls of missions stand in that world, too, the default; world: only its own\n"
    "  --model         file in SDF or URDF with the model that all robots are\n"
    "  --joints        LEFT,RIGHT: the joints of its wheels\n"
    "  --sensor        its ray sensor whose rays are those of missions; by default they are as missions have them\n"
    "  --title         name in experiments, arena-NAME; arena-gazebo by default, arena-gz with Gazebo Fortress\n"
    "  --step          longest step of Gazebo, seconds; by default that of the world's file, else 0.005,\n"
    "                  or 0.0025 with --model\n"
    "  --drive         wheels: motors turn the wheels of differential drives, the default; body: the body gets the\n"
    "                  velocity, as that of robots with other drives always does\n"
    "  --rays          gazebo: proximity rays are those of Gazebo's ray sensors, the default; engine: computed from "
    "poses\n"
    "  --master-port   of Gazebo 11's master on 127.0.0.1, for gzclient; any free one by default\n"
    "  --save-world    file that gets the world of the mission as SDF\n";

/// One of two words. Throws std::invalid_argument.
bool first(const std::string& name, const std::string& value, const std::string& yes, const std::string& no) {
  if (value != yes && value != no) {
    throw std::invalid_argument(name + ": \"" + value + "\" found, expected " + yes + " or " + no);
  }
  return value == yes;
}

constexpr std::array options = {"--world", "--walls", "--model", "--joints",      "--sensor",    "--title",
                                "--step",  "--drive", "--rays",  "--master-port", "--save-world"};

/// What the user asks for besides the settings.
struct Choices {
  std::string world = {};
  gz::ModelChoice model = {};
  std::string title = gz::traits.title;
};

/// Sets an option of this program.
void set(const std::string& name, const std::string& value, Choices& choices) {
  gz::Settings& settings = gz::settings();
  if (name == "--world") {
    choices.world = value;
  } else if (name == "--model") {
    choices.model.path = value;
  } else if (name == "--sensor") {
    choices.model.sensor = value;
  } else if (name == "--joints") {
    const std::size_t comma = value.find(',');
    if (comma == std::string::npos || comma == 0 || comma + 1 == value.size()) {
      throw std::invalid_argument("--joints: \"" + value + "\" found, expected LEFT,RIGHT");
    }
    choices.model.left = value.substr(0, comma);
    choices.model.right = value.substr(comma + 1);
  } else if (name == "--title") {
    if (value.compare(0, 6, "arena-") != 0 || value.size() == 6) {
      throw std::invalid_argument("--title: \"" + value + "\" found, expected arena-NAME");
    }
    choices.title = value;
  } else if (name == "--step") {
    settings.step = swarmwright::detail::number<double>(name, value);
    if (!(settings.step >= 1e-4 && settings.step <= 0.1)) {
      throw std::invalid_argument("--step: " + value + " found, expected seconds from 0.0001 to 0.1");
    }
  } else if (name == "--walls") {
    settings.walls = first(name, value, "mission", "world");
  } else if (name == "--drive") {
    settings.wheels = first(name, value, "wheels", "body");
  } else if (name == "--rays") {
    settings.rays = first(name, value, "gazebo", "engine");
  } else if (name == "--master-port") {
    settings.port = swarmwright::detail::number<int>(name, value);
    if (settings.port < 0 || settings.port > 65535) {
      throw std::invalid_argument("--master-port: " + value + " found, expected a port from 0 to 65535");
    }
  } else if (name == "--save-world") {
    settings.save_world = value;
    if (!std::ofstream(value)) {
      throw std::invalid_argument("--save-world: " + value + " cannot be written");
    }
  }
}

/// Reads the options of this program; the arguments that are left are those of all servers.
std::vector<char*> rest(int count, char** values, Choices& choices) {
  std::vector<char*> others{values[0]};
  for (int i = 1; i < count; ++i) {
    std::string name = values[i];
    const std::size_t equals = name.find('=');
    std::string value;
    if (equals != std::string::npos) {
      value = name.substr(equals + 1);
      name.resize(equals);
    } else if (i + 1 < count) {
      value = values[i + 1];
    }
    const bool is_known = std::find(options.begin(), options.end(), name) != options.end();
    if (!is_known || (name == "--master-port" && !gz::traits.has_master)) {
      others.push_back(values[i]);
      continue;
    }
    if (equals == std::string::npos && ++i == count) {
      throw std::invalid_argument(name + ": expected a value after it");
    }
    set(name, value, choices);
  }
  if (!gz::settings().walls && choices.world.empty()) {
    throw std::invalid_argument("--walls world: expected --world FILE, too");
  }
  if (choices.model.path.empty() != choices.model.left.empty()) {
    throw std::invalid_argument("--model FILE and --joints LEFT,RIGHT: expected both or none");
  }
  if (choices.model.path.empty() && !choices.model.sensor.empty()) {
    throw std::invalid_argument("--sensor: expected --model FILE, too");
  }
  if (!choices.model.path.empty() && !gz::settings().wheels) {
    throw std::invalid_argument("--drive body: a --model drives by its wheels");
  }
  return others;
}

void warn(const std::string& path, const std::vector<std::string>& warnings) {
  for (const std::string& warning : warnings) {
    std::cerr << "warning: " << path << ": " << warning << std::endl;
  }
}

int run(int count, char** values) {
  for (int i = 1; i < count; ++i) {
    if (std::string_view(values[i]) == "--help") {
      std::cout << swarmwright::usage << usage;
      return 0;
    }
  }
  std::vector<char*> others;
  Choices choices;
  try {
    others = rest(count, values, choices);
    static_cast<void>(swarmwright::arguments(static_cast<int>(others.size()), others.data()));
  } catch (const std::invalid_argument& error) {
    std::cerr << "error: " << error.what() << std::endl;
    return 2;
  }
  try {
    const gz::Access started;
    if (!choices.world.empty()) {
      gz::settings().world = gz::user_world(choices.world);
      warn(gz::settings().world->path, gz::settings().world->warnings);
    }
    if (!choices.model.path.empty()) {
      gz::settings().model = gz::user_model(choices.model);
      warn(choices.model.path, gz::settings().model->file.warnings);
    }
  } catch (const std::exception& error) {
    std::cerr << "error: " << error.what() << std::endl;
    return 1;
  }
  swarmwright::PhysicsDescription description;
  description.title = choices.title;
  // Plug-ins of the user's world do what they like.
  const bool repeatable = gz::traits.bitwise && (!gz::settings().world || gz::settings().world->repeatable);
  description.determinism = repeatable ? swarmwright::Determinism::bitwise : swarmwright::Determinism::undeclared;
  description.only_one = true;  // a world more takes Gazebo a quarter of a second and tens of megabytes
  return swarmwright::serve_physics<gz::GazeboPhysics>(description, static_cast<int>(others.size()), others.data());
}

}  // namespace

int main(int count, char** values) {
  const int status = run(count, values);
  std::cout.flush();
  std::cerr.flush();
  // The destructors of Gazebo's libraries depend on each other's order. Nothing of this process outlives it.
  std::_Exit(status);
}
