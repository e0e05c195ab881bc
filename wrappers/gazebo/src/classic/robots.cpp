#include "robots.hpp"

#include "gazebo.hpp"
#include "library.hpp"

#include <gazebo/physics/ode/ODECollision.hh>
#include <gazebo/physics/physics.hh>
#include <gazebo/sensors/sensors.hh>

#include <algorithm>
#include <cmath>
#include <limits>

namespace swarmwright::gazebo {

namespace {

using ::gazebo::physics::ModelPtr;
using ::gazebo::physics::WorldPtr;
using Vector = ignition::math::Vector3d;
using Placement = ignition::math::Pose3d;

}  // namespace

WorldPtr load(const sdf::ElementPtr& description, const std::string& name) {
  ignition::math::Rand::Seed(1);  // of what is drawn while a world is made, as populations of models are
  const WorldPtr world = ::gazebo::physics::create_world(name);
  ::gazebo::physics::load_world(world, description);
  ::gazebo::physics::init_world(world, [](const std::string&, const ::gazebo::msgs::PosesStamped&) {});
  return world;
}

ModelPtr found(const WorldPtr& world, const std::string& name) {
  ModelPtr model = world->ModelByName(name);
  if (!model) {
    throw GazeboError("Gazebo did not make the model " + name);
  }
  return model;
}

void put(const ModelPtr& model, const Pose& pose, double lift) {
  model->SetWorldPose(Placement(static_cast<double>(pose.x), static_cast<double>(pose.y), lift, 0, 0,
                                static_cast<double>(pose.heading)));
  model->ResetPhysicsStates();
}

Pose flat(const ModelPtr& model, double lift) {
  const Placement pose = model->WorldPose();
  return on_the_ground(model->GetName(), pose.Pos().X(), pose.Pos().Y(), pose.Pos().Z(), pose.Rot().Yaw(), lift);
}

Robot::Robot(const WorldPtr& world, const World& plan, std::size_t number)
    : model_(plan.model(number)), placed_(found(world, robot_name(number))) {
  const std::optional<UserModel>& user = settings().model;
  const std::string link = user ? user->link : body;
  body_ = placed_->GetLink(link);
  if (user) {
    const double force = user->mass * static_cast<double>(model_.acceleration) / 2;
    lift_ = user->lift;
    wheel_base_ = user->left.left - user->right.left;
    left_ = {nullptr, user->left.forward, user->left.radius};
    right_ = {nullptr, user->right.forward, user->right.radius};
    add_motor(left_, user->left.joint, std::min(force * left_.radius, user->left.torque));
    add_motor(right_, user->right.joint, std::min(force * right_.radius, user->right.torque));
  } else if (has_wheels(model_)) {
    wheel_base_ = static_cast<double>(model_.wheel_base);
    left_.radius = right_.radius = wheel_radius(model_);
    add_motor(left_, left_joint, motor_torque(model_));
    add_motor(right_, right_joint, motor_torque(model_));
  }
  if (settings().rays && !model_.rays.empty()) {
    add_eye(world->Name() + "::" + robot_name(number) + "::" + link + "::" + eye, plan);
  }
}

void Robot::add_motor(Wheel& wheel, const std::string& joint, double torque) const {
  wheel.joint = placed_->GetJoint(joint);
  wheel.joint->SetParam("fmax", 0, torque);
}

void Robot::add_eye(const std::string& name, const World& plan) {
  eye_ = std::dynamic_pointer_cast<::gazebo::sensors::RaySensor>(::gazebo::sensors::get_sensor(name));
  if (!eye_ || eye_->LaserShape()->RayCount() != model_.rays.size()) {
    throw GazeboError("Gazebo did not make the sensor " + name);
  }
  rays_ = RobotRays(model_, ray_height(plan));
  for (const auto& link : placed_->GetLinks()) {
    for (const auto& collision : link->GetCollisions()) {
      const auto part = boost::dynamic_pointer_cast<::gazebo::physics::ODECollision>(collision);
      const dGeomID geometry = part->GetCollisionId();
      parts_.push_back({geometry, dGeomGetCategoryBits(geometry), dGeomGetCollideBits(geometry)});
    }
  }
}

void Robot::drive(const Motion& motion) const {
  const double forward = motion.forward;
  const double turn = motion.turn;
  if (left_.joint) {
    const double difference = turn * wheel_base_ / 2;
    left_.joint->SetParam("vel", 0, left_.forward * (forward - difference) / left_.radius);
    right_.joint->SetParam("vel", 0, right_.forward * (forward + difference) / right_.radius);
    return;
  }
  const double heading = body_->WorldPose().Rot().Yaw();
  const double sideways = motion.sideways;
  body_->SetLinearVel(Vector(forward * std::cos(heading) - sideways * std::sin(heading),
                             forward * std::sin(heading) + sideways * std::cos(heading), body_->WorldLinearVel().Z()));
  body_->SetAngularVel(Vector(0, 0, turn));
}

void Robot::look(Span<float> distances) const {
  // Each update rounds the ends of the rays a little: they are aimed anew, so that no reading depends on earlier ones.
  const ::gazebo::physics::MultiRayShapePtr shape = eye_->LaserShape();
  for (std::size_t i = 0; i < rays_.size(); ++i) {
    shape->SetRay(static_cast<unsigned>(i), rays_[i].begin, rays_[i].end);
  }
  // Rays begin inside of the robot, which is not to be seen.
  for (const Part& part : parts_) {
    dGeomSetCategoryBits(part.geometry, 0);
    dGeomSetCollideBits(part.geometry, 0);
  }
  eye_->Update(true);
  for (const Part& part : parts_) {
    dGeomSetCategoryBits(part.geometry, part.category);
    dGeomSetCollideBits(part.geometry, part.collides);
  }
  for (std::size_t i = 0; i < distances.size(); ++i) {
    distances[i] = rays_.reading(i, eye_->Range(static_cast<unsigned>(i)));
  }
}

}  // namespace swarmwright::gazebo
