// @mark@; changes here are lost.
// The interface of the node to ROS 1.
#pragma once

#include <functional>
#include <map>
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "geometry_msgs/PoseStamped.h"
#include "geometry_msgs/PoseWithCovarianceStamped.h"
#include "geometry_msgs/Twist.h"
#include "geometry_msgs/TwistStamped.h"
#include "nav_msgs/Odometry.h"
#include "ros/ros.h"
#include "sensor_msgs/LaserScan.h"
#include "sensor_msgs/Range.h"
#include "std_msgs/Empty.h"
#include "std_msgs/Float32.h"
#include "std_msgs/Float32MultiArray.h"
#include "std_msgs/Float64.h"

namespace messages {
using geometry_msgs::PoseStamped;
using geometry_msgs::PoseWithCovarianceStamped;
using geometry_msgs::Quaternion;
using geometry_msgs::Twist;
using geometry_msgs::TwistStamped;
using nav_msgs::Odometry;
using sensor_msgs::LaserScan;
using sensor_msgs::Range;
using std_msgs::Empty;
using std_msgs::Float32;
using std_msgs::Float32MultiArray;
using std_msgs::Float64;
using std_msgs::Header;
}  // namespace messages

template <typename Message>
class Publisher {
 public:
  explicit Publisher(ros::Publisher publisher) : made_(std::move(publisher)) {}
  void publish(const Message& message) const { made_.publish(message); }
  std::size_t listeners() const { return made_.getNumSubscribers(); }

 private:
  ros::Publisher made_;
};

class Graph {
 public:
  // Returns the full, remapped name of a topic: /robot_1/scan. Throws std::exception for an invalid name.
  std::string resolve(const std::string& name) {
    const std::string resolved = ros::names::resolve(name.rfind("~/", 0) == 0 ? "~" + name.substr(2) : name, false);
    const std::string full = ros::names::remap(resolved);
    given_[full] = resolved;
    return full;
  }

  // Returns the types with which nodes use a topic.
  std::vector<std::string> types(const std::string& topic) const {
    XmlRpc::XmlRpcValue arguments;
    XmlRpc::XmlRpcValue response;
    XmlRpc::XmlRpcValue topics;
    std::vector<std::string> types;
    arguments[0] = ros::this_node::getName();
    arguments[1] = "";
    // ros::master::getTopics waits for a lost master, and the robot would get no more commands.
    if (!ros::master::execute("getPublishedTopics", arguments, response, topics, false)) return types;
    for (int i = 0; i < topics.size(); ++i) {
      if (static_cast<std::string>(topics[i][0]) == topic) types.push_back(static_cast<std::string>(topics[i][1]));
    }
    return types;
  }

  // Reads the latest message only.
  template <typename Message>
  void subscribe(const std::string& topic, std::function<void(const Message&)> read) {
    subscribe<Message>(topic, std::move(read), 1);
  }

  // Reads every message.
  template <typename Message>
  void receive_all(const std::string& topic, std::function<void(const Message&)> read) {
    subscribe<Message>(topic, std::move(read), 10);
  }

  template <typename Message>
  std::shared_ptr<Publisher<Message>> advertise(const std::string& topic, unsigned depth) {
    return std::make_shared<Publisher<Message>>(node_.advertise<Message>(given(topic), depth));
  }

  void stamp(messages::Header& header) const { header.stamp = ros::Time::now(); }

  // Returns seconds of simulated time if used, otherwise of a monotonic clock.
  double seconds() const { return ros::Time::isSimTime() ? ros::Time::now().toSec() : ros::SteadyTime::now().toSec(); }

  void info(const std::string& text) const { ROS_INFO("%s", text.c_str()); }
  void warn(const std::string& text) const { ROS_WARN("%s", text.c_str()); }

 private:
  template <typename Message>
  void subscribe(const std::string& topic, std::function<void(const Message&)> read, unsigned depth) {
    const boost::function<void(const boost::shared_ptr<Message const>&)> received =
        [read = std::move(read)](const auto& message) { read(*message); };
    subscribers_.push_back(node_.subscribe<Message>(given(topic), depth, received));
  }

  // Returns the name for roscpp, which remaps names itself: otherwise a:=b b:=a would have no effect.
  const std::string& given(const std::string& topic) const {
    const auto entry = given_.find(topic);
    return entry == given_.end() ? topic : entry->second;
  }

  ros::NodeHandle node_;
  std::map<std::string, std::string> given_;  // the name before remapping, by full name
  std::vector<ros::Subscriber> subscribers_;
};
