// @mark@; changes here are lost.
// The interface of the node to ROS 2.
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
  explicit Publisher(std::shared_ptr<rclcpp::Publisher<Message>> publisher) : made_(std::move(publisher)) {}
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

  // Returns the full, remapped name of a topic: /robot_1/scan. Throws std::exception for an invalid name.
  std::string resolve(const std::string& name) {
    const auto topics = node_->get_node_topics_interface();
    try {
      const std::string full = topics->resolve_topic_name(name);
      given_[full] = topics->resolve_topic_name(name, true);
      return full;
    } catch (const rclcpp::exceptions::RCLErrorBase& error) {
      throw std::invalid_argument(error.message);  // without the source line in ROS
    }
  }

  // Returns the types with which other nodes use a topic.
  std::vector<std::string> types(const std::string& topic) const {
    std::vector<std::string> types;
    for (const auto& ends :
         {node_->get_publishers_info_by_topic(given(topic)), node_->get_subscriptions_info_by_topic(given(topic))}) {
      for (const rclcpp::TopicEndpointInfo& end : ends) {
        const bool own = end.node_name() == node_->get_name() && end.node_namespace() == node_->get_namespace();
        if (!own) types.push_back(end.topic_type());
      }
    }
    return types;
  }

  // Reads the latest message only. Works with reliable and unreliable publishers.
  template <typename Message>
  void subscribe(const std::string& topic, std::function<void(const Message&)> read) {
    subscribe<Message>(topic, std::move(read), rclcpp::QoS(1).best_effort());
  }

  // Reads every message, even of a publisher that sends it as soon as it detects the subscription, such as
  // `ros2 topic pub --once`.
  template <typename Message>
  void receive_all(const std::string& topic, std::function<void(const Message&)> read) {
    subscribe<Message>(topic, std::move(read), rclcpp::QoS(10).reliable());
  }

  // Works with all subscriptions.
  template <typename Message>
  std::shared_ptr<Publisher<Message>> advertise(const std::string& topic, std::size_t depth) {
    return std::make_shared<Publisher<Message>>(
        node_->create_publisher<Message>(given(topic), rclcpp::QoS(depth).reliable()));
  }

  void stamp(messages::Header& header) const { header.stamp = node_->now(); }

  // Returns seconds of simulated time if used, otherwise of a monotonic clock.
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

  // Returns the name for rclcpp, which remaps names itself: otherwise a:=b b:=a would have no effect.
  const std::string& given(const std::string& topic) const {
    const auto entry = given_.find(topic);
    return entry == given_.end() ? topic : entry->second;
  }

  rclcpp::Node::SharedPtr node_;
  bool simulated_;
  std::map<std::string, std::string> given_;  // the name before remapping, by full name
  std::vector<rclcpp::SubscriptionBase::SharedPtr> subscriptions_;
};
