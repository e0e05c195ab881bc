// @mark@; changes here are lost.
// What the node asks of ROS 2.
#pragma once

#include <chrono>
#include <cstddef>
#include <functional>
#include <map>
#include <memory>
#include <stdexcept>
#include <string>
#include <utility>
#include <vector>

#include "geometry_msgs/msg/pose_stamped.hpp"
#include "geometry_msgs/msg/pose_with_covariance_stamped.hpp"
#include "geometry_msgs/msg/twist.hpp"
#include "geometry_msgs/msg/twist_stamped.hpp"
#include "nav_msgs/msg/odometry.hpp"
#include "rclcpp/rclcpp.hpp"
#include "sensor_msgs/msg/laser_scan.hpp"
#include "sensor_msgs/msg/range.hpp"
#include "std_msgs/msg/empty.hpp"
#include "std_msgs/msg/float32.hpp"
#include "std_msgs/msg/float32_multi_array.hpp"
#include "std_msgs/msg/float64.hpp"
#include "std_msgs/msg/header.hpp"

namespace messages {
using geometry_msgs::msg::PoseStamped;
using geometry_msgs::msg::PoseWithCovarianceStamped;
using geometry_msgs::msg::Quaternion;
using geometry_msgs::msg::Twist;
using geometry_msgs::msg::TwistStamped;
using nav_msgs::msg::Odometry;
using sensor_msgs::msg::LaserScan;
using sensor_msgs::msg::Range;
using std_msgs::msg::Empty;
using std_msgs::msg::Float32;
using std_msgs::msg::Float32MultiArray;
using std_msgs::msg::Float64;
using std_msgs::msg::Header;
}  // namespace messages

template <typename Message>
class Publisher {
 public:
  explicit Publisher(std::shared_ptr<rclcpp::Publisher<Message>> made) : made_(std::move(made)) {}
  void publish(const Message& message) const { made_->publish(message); }
  std::size_t listeners() const { return made_->get_subscription_count(); }

 private:
  std::shared_ptr<rclcpp::Publisher<Message>> made_;
};

class Graph {
 public:
  explicit Graph(rclcpp::Node::SharedPtr node)
      : node_(std::move(node)), simulated_(node_->get_parameter("use_sim_time").as_bool()) {}

  bool simulated() const { return simulated_; }

  // The full name of a topic, remapped: /robot_1/scan. Throws std::exception for what is no name.
  std::string resolve(const std::string& name) {
    const auto topics = node_->get_node_topics_interface();
    try {
      const std::string full = topics->resolve_topic_name(name);
      given_[full] = topics->resolve_topic_name(name, true);
      return full;
    } catch (const rclcpp::exceptions::RCLErrorBase& error) {
      throw std::invalid_argument(error.message);  // without the line of ROS's own source that noticed it
    }
  }

  // The types with which others use a topic.
  std::vector<std::string> types(const std::string& topic) const {
    std::vector<std::string> found;
    for (const auto& ends :
         {node_->get_publishers_info_by_topic(given(topic)), node_->get_subscriptions_info_by_topic(given(topic))}) {
      for (const rclcpp::TopicEndpointInfo& end : ends) {
        const bool own = end.node_name() == node_->get_name() && end.node_namespace() == node_->get_namespace();
        if (!own) found.push_back(end.topic_type());
      }
    }
    return found;
  }

  // Of the messages that have come, the latest is read. Every publisher can serve it: reliable or not.
  template <typename Message>
  void subscribe(const std::string& topic, std::function<void(const Message&)> read) {
    subscribe<Message>(topic, std::move(read), rclcpp::QoS(1).best_effort());
  }

  // Every message is read, also that of a publisher which sends it as soon as it knows of the subscription, as
  // `ros2 topic pub --once` does.
  template <typename Message>
  void receive_all(const std::string& topic, std::function<void(const Message&)> read) {
    subscribe<Message>(topic, std::move(read), rclcpp::QoS(10).reliable());
  }

  // Every subscription can be served.
  template <typename Message>
  std::shared_ptr<Publisher<Message>> advertise(const std::string& topic, std::size_t depth) {
    return std::make_shared<Publisher<Message>>(
        node_->create_publisher<Message>(given(topic), rclcpp::QoS(depth).reliable()));
  }

  void stamp(messages::Header& header) const { header.stamp = node_->now(); }

  // Seconds, of simulated time where that is used, else of a clock that never jumps.
  double seconds() const {
    if (simulated_) return node_->now().seconds();
    return std::chrono::duration<double>(std::chrono::steady_clock::now().time_since_epoch()).count();
  }

  void info(const std::string& text) const { RCLCPP_INFO(node_->get_logger(), "%s", text.c_str()); }
  void warn(const std::string& text) const { RCLCPP_WARN(node_->get_logger(), "%s", text.c_str()); }

 private:
  template <typename Message>
  void subscribe(const std::string& topic, std::function<void(const Message&)> read, const rclcpp::QoS& qos) {
    subscriptions_.push_back(node_->create_subscription<Message>(
        given(topic), qos, [read = std::move(read)](const Message& message) { read(message); }));
  }

  // What rclcpp, which remaps names itself, is to be given for a full name: a:=b b:=a would else have no effect.
  const std::string& given(const std::string& topic) const {
    const auto found = given_.find(topic);
    return found == given_.end() ? topic : found->second;
  }

  rclcpp::Node::SharedPtr node_;
  bool simulated_;
  std::map<std::string, std::string> given_;  // by full name: the name before it was remapped
  std::vector<rclcpp::SubscriptionBase::SharedPtr> subscriptions_;
};
