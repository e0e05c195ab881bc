#include "library.hpp"

#include <unistd.h>

#include <ignition/common/Console.hh>

#include <cerrno>
#include <cstdlib>
#include <cstring>
#include <filesystem>
#include <sstream>
#include <string>
#include <system_error>
#include <vector>

namespace swarmwright::gazebo {

const Traits traits = {
    "swarmwright-gz",
    "arena-gz",
    false,
    false,
    false,
    "IGN_GAZEBO_RESOURCE_PATH",
    " ode dart ignored ",
    "dart, ode or ignored: the engine is DART whichever it is",
    " ray gpu_ray lidar gpu_lidar ",
    "<plugin filename='ignition-gazebo-physics-system' name='ignition::gazebo::systems::Physics'/>",
};

namespace {

std::vector<std::string>& folders() {
  static std::vector<std::string> shared;
  return shared;
}

/// The folders of an environment variable.
void add_folders(const char* variable) {
  const char* value = std::getenv(variable);
  std::istringstream text(value == nullptr ? "" : value);
  for (std::string folder; std::getline(text, folder, ':');) {
    if (!folder.empty()) {
      folders().push_back(folder);
    }
  }
}

}  // namespace

bool is_left_out(const std::string& plugin_file) {
  // Physics are this wrapper's; the others serve a window, or sensors that missions do not have.
  for (const char* name : {"physics", "user-commands", "scene-broadcaster", "sensors", "contact", "imu", "log"}) {
    const std::string system = "-" + std::string(name) + "-system";
    if (plugin_file.find("gazebo" + system) != std::string::npos ||
        plugin_file.find("gz-sim" + system) != std::string::npos) {
      return true;
    }
  }
  return false;
}

void start_library() {
  // The loopback interface alone, and no other instance's topics.
  ::setenv("IGN_IP", "127.0.0.1", 1);
  ::setenv("IGN_PARTITION", ("swarmwright-" + std::to_string(::getpid())).c_str(), 1);
  ignition::common::Console::SetVerbosity(0);
  // Its log would be in the folder HOME.
  std::string name = (std::filesystem::temp_directory_path() / "swarmwright-gz-XXXXXX").string();
  if (::mkdtemp(name.data()) == nullptr) {
    throw GazeboError("no temporary folder for Gazebo: " + name + ": " + std::strerror(errno));
  }
  ignLogInit(name, "log");
  std::error_code ignored;
  std::filesystem::remove_all(name, ignored);
  add_folders("IGN_GAZEBO_RESOURCE_PATH");
  add_folders("GZ_SIM_RESOURCE_PATH");
  add_folders("SDF_PATH");
  sdf::setFindCallback(find_resource);
}

std::string find_resource(const std::string& name) {
  std::string relative = name;
  for (const char* scheme : {"model://", "package://", "file://"}) {
    const std::size_t length = std::strlen(scheme);
    if (name.compare(0, length, scheme) == 0) {
      relative = name.substr(length);
    }
  }
  if (relative.empty() || relative.compare(0, 4, "http") == 0) {
    return "";
  }
  std::error_code ignored;
  for (const std::string& folder : folders()) {
    const std::filesystem::path path = std::filesystem::path(folder) / relative;
    if (std::filesystem::exists(path, ignored)) {
      return path.string();
    }
  }
  return "";
}

void search_beside(const std::string& path) {
  const std::filesystem::path folder = std::filesystem::absolute(path).parent_path();
  folders().push_back(folder.string());
  folders().push_back((folder / "models").string());
}

void guarded(const char* /*task*/, const std::function<void()>& call) { call(); }

}  // namespace swarmwright::gazebo
