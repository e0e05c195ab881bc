// The proximity rays of a robot: where they are in it, and what a mission gets for what they meet.
#pragma once

#include <swarmwright/physics.hpp>

#include <ignition/math/Vector3.hh>

#include <cstddef>
#include <utility>
#include <vector>

namespace swarmwright::gazebo {

class RobotRays {
 public:
  using Vector = ignition::math::Vector3d;
  /// In the frame of the link that has them: `body`, or that of the user's model.
  struct Ray {
    Vector begin;
    Vector end;
  };

  RobotRays() = default;
  /// `height`: above the ground, metres.
  RobotRays(const RobotModel& model, double height);

  std::size_t size() const { return rays_.size(); }
  const Ray& operator[](std::size_t ray) const { return rays_[ray]; }
  /// The reading of a ray that ends `met` metres from the middle of the robot, or from where the user's sensor has it
  /// begin and ray_origin() of the model; infinite if it meets nothing.
  float reading(std::size_t ray, double met) const;

 private:
  RobotModel model_ = {};
  std::vector<Ray> rays_;
  /// Where they begin, and their directions, in the frame of the robot, if they are those of a sensor of the user.
  std::vector<std::pair<Vector, Vector>> seen_from_;
};

}  // namespace swarmwright::gazebo
