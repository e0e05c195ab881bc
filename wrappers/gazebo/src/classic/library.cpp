#include "library.hpp"

#include <arpa/inet.h>
#include <sys/socket.h>
#include <unistd.h>

#include <gazebo/common/Console.hh>
#include <gazebo/common/Exception.hh>
#include <gazebo/common/SystemPaths.hh>
#include <gazebo/gazebo.hh>
#include <gazebo/util/LogRecord.hh>

#include <cerrno>
#include <cstdint>
#include <cstdlib>
#include <cstring>
#include <filesystem>
#include <list>
#include <string>
#include <system_error>
#include <vector>

namespace swarmwright::gazebo {

const Traits traits = {
    "swarmwright-gazebo",        "arena-gazebo", true, true, true, "GAZEBO_MODEL_PATH", " ode ",
    "ode, the only engine here", " ray ",        "",
};

bool is_left_out(const std::string& /*plugin_file*/) { return false; }

namespace {

/// Binds a port of the loopback interface for a moment; the number that it got. Throws GazeboError if it is taken.
int probe(int port) {
  const int socket = ::socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC, 0);
  if (socket < 0) {
    throw GazeboError(std::string("no socket for Gazebo's master: ") + std::strerror(errno));
  }
  const int on = 1;
  ::setsockopt(socket, SOL_SOCKET, SO_REUSEADDR, &on, sizeof(on));
  sockaddr_in address = {};
  address.sin_family = AF_INET;
  address.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
  address.sin_port = htons(static_cast<std::uint16_t>(port));
  socklen_t size = sizeof(address);
  auto* any = reinterpret_cast<sockaddr*>(&address);
  const bool bound = ::bind(socket, any, size) == 0 && ::getsockname(socket, any, &size) == 0;
  const int error = errno;
  ::close(socket);
  if (!bound) {
    throw GazeboError("--master-port " + std::to_string(port) + ": " + std::strerror(error) +
                      "; another Gazebo may use it: name another port, or none for any free one");
  }
  return ntohs(address.sin_port);
}

/// A folder for what Gazebo writes while it starts (logs below HOME); removed with this object.
class Scratch {
 public:
  Scratch() {
    std::string name = (std::filesystem::temp_directory_path() / "swarmwright-gazebo-XXXXXX").string();
    if (::mkdtemp(name.data()) == nullptr) {
      throw GazeboError("no temporary folder for Gazebo: " + name + ": " + std::strerror(errno));
    }
    path_ = name;
    if (const char* home = std::getenv("HOME")) {
      home_ = home;
    }
    ::setenv("HOME", path_.c_str(), 1);
  }
  ~Scratch() {
    if (home_.empty()) {
      ::unsetenv("HOME");
    } else {
      ::setenv("HOME", home_.c_str(), 1);
    }
    std::error_code ignored;
    std::filesystem::remove_all(path_, ignored);
  }
  Scratch(const Scratch&) = delete;
  Scratch& operator=(const Scratch&) = delete;

 private:
  std::string path_;
  std::string home_;
};

}  // namespace

void start_library() {
  const int free = probe(settings().port);
  // The loopback interface alone, no models from the network, no other instance's topics.
  const std::string port = std::to_string(free);
  ::setenv("GAZEBO_IP", "127.0.0.1", 1);
  ::setenv("GAZEBO_MASTER_URI", ("http://127.0.0.1:" + port).c_str(), 1);
  ::setenv("GAZEBO_MODEL_DATABASE_URI", "", 1);
  ::setenv("IGN_IP", "127.0.0.1", 1);
  ::setenv("IGN_PARTITION", ("swarmwright-" + port).c_str(), 1);
  ::setenv("ALSOFT_DRIVERS", "null", 1);  // no sound
  const Scratch scratch;
  ::gazebo::common::Console::SetQuiet(true);
  guarded("start Gazebo", [] {
    if (!::gazebo::setupServer(std::vector<std::string>())) {
      throw GazeboError("Gazebo did not start");
    }
    // It keeps a state of the world, for a log that it does not write, at each time not before the last one.
    ::gazebo::util::LogRecord::Instance()->SetPeriod(1e9);
  });
}

// Its own search would ask the network for models that it does not find.
std::string find_resource(const std::string& name) {
  auto* paths = ::gazebo::common::SystemPaths::Instance();
  const std::string model = "model://";
  const std::string package = "package://";  // in URDF
  const std::string uri = name.compare(0, package.size(), package) == 0 ? model + name.substr(package.size()) : name;
  if (uri.compare(0, model.size(), model) == 0) {
    for (const std::string& folder : paths->GetModelPaths()) {
      const std::filesystem::path path = std::filesystem::path(folder) / uri.substr(model.size());
      std::error_code ignored;
      if (std::filesystem::exists(path, ignored)) {
        return path.string();
      }
    }
    return "";
  }
  return uri.empty() || uri.find("http") == 0 ? "" : paths->FindFile(uri);
}

void search_beside(const std::string& path) {
  auto* paths = ::gazebo::common::SystemPaths::Instance();
  const std::filesystem::path folder = std::filesystem::absolute(path).parent_path();
  const std::list<std::string> own = paths->GetGazeboPaths();
  for (const std::filesystem::path& each : {folder, folder / "models"}) {
    paths->AddModelPaths(each.string());
    paths->AddGazeboPaths(each.string());
  }
  // Where GAZEBO_MODEL_PATH is set, it takes the place of the folder of Gazebo's own models.
  for (const std::string& each : own) {
    paths->AddModelPaths((std::filesystem::path(each) / "models").string());
  }
}

void guarded(const char* task, const std::function<void()>& call) {
  try {
    call();
  } catch (const ::gazebo::common::Exception& error) {
    throw GazeboError("Gazebo cannot " + std::string(task) + ": " + error.GetErrorStr());
  } catch (const boost::exception& error) {
    throw GazeboError("Gazebo cannot " + std::string(task) + ": an error of the library boost");
  }
}

}  // namespace swarmwright::gazebo
