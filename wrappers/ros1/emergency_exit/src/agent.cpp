// One agent of Emergency Exit: asks the world for its turn, steps the exported controller, and logs where it is.
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <iomanip>
#include <limits>
#include <stdexcept>
#include <string>

#include "emergency_exit/Turn.h"
#include "exported.h"
#include "ros/ros.h"

namespace {

constexpr int kSensors = 10;
constexpr int kActuators = 2;
constexpr double kPatience = 30.0;  // seconds until a world that does not answer is given up

template <typename Value>
Value parameter(const std::string& name) {
  Value value;
  if (!ros::param::get("~" + name, value)) {
    throw std::runtime_error("the parameter ~" + name + " is missing or of another type; agents.launch sets it");
  }
  return value;
}

// The log: a line for the start and for every step, written at once.
class Log {
 public:
  // Finds out whether it can be written. What an earlier episode has logged stays until `begin`.
  Log(const std::string& folder, int agent) : path_(folder + "/agent_" + std::to_string(agent) + ".csv") {
    std::error_code ignored;  // as many agents make the folder at once, what counts is whether the file can be written
    std::filesystem::create_directories(folder, ignored);
    file_.open(path_, std::ios::app);
    check();
  }

  void begin(const emergency_exit::Turn::Request& agent, const emergency_exit::Turn::Response& turn) {
    file_.close();
    file_.open(path_, std::ios::trunc);
    file_ << "# agent " << agent.agent << " of " << turn.agents << ", steps " << turn.steps << ", episode "
          << turn.episode << "\nstep,x,y,distance,out\n";
    // As many digits as it takes to read back the same number.
    file_ << std::setprecision(std::numeric_limits<double>::max_digits10);
  }

  void write(const emergency_exit::Turn::Response& turn) {
    file_ << turn.step << ',' << turn.x << ',' << turn.y << ',' << turn.distance << ',' << int{turn.out} << std::endl;
    check();
  }

 private:
  void check() const {
    if (!file_) throw std::runtime_error(path_ + ": cannot be written");
  }

  std::string path_;
  std::ofstream file_;
};

void exchange(ros::ServiceClient& world, emergency_exit::Turn& turn) {
  if (!world.call(turn)) throw std::runtime_error("the world refused a turn or has ended; it says why");
}

void act() {
  if (exported_sensors != kSensors || exported_actuators != kActuators) {
    throw std::runtime_error("the exported controller has " + std::to_string(exported_sensors) + " sensors and " +
                             std::to_string(exported_actuators) +
                             " actuators, but agents of Emergency Exit have 10 and 2: export one evolved in it");
  }
  emergency_exit::Turn turn;
  turn.request.agent = parameter<int>("agent");
  turn.request.step = -1;
  Log log(parameter<std::string>("logs"), turn.request.agent);

  const std::string name = "/world/turn";
  if (!ros::service::waitForService(name, ros::Duration(kPatience))) {
    throw std::runtime_error("no world offers " + name + " after 30 s");
  }
  // One connection for the whole episode.
  ros::ServiceClient world = ros::NodeHandle().serviceClient<emergency_exit::Turn>(name, true);
  exported_reset();
  exchange(world, turn);
  log.begin(turn.request, turn.response);
  log.write(turn.response);
  while (!turn.response.over) {
    turn.request.step = turn.response.step;
    turn.request.actuators.resize(kActuators);
    if (!exported_step(turn.response.sensors.data(), turn.request.actuators.data())) {
      throw std::runtime_error("a sensor is not a finite number");
    }
    exchange(world, turn);
    log.write(turn.response);
  }
  turn.request.step = turn.response.step;
  turn.request.actuators.clear();
  exchange(world, turn);  // the log is written
}

}  // namespace

int main(int argc, char** argv) {
  ros::init(argc, argv, "agent");
  const ros::NodeHandle node;  // without one nothing can be said any more
  try {
    act();
    return EXIT_SUCCESS;
  } catch (const std::exception& error) {
    ROS_FATAL("%s", error.what());
    return EXIT_FAILURE;
  }
}
