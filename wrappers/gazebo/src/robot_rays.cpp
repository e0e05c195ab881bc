#include "robot_rays.hpp"

#include "gazebo.hpp"
#include "sdf_world.hpp"

#include <algorithm>
#include <cmath>

namespace swarmwright::gazebo {

RobotRays::RobotRays(const RobotModel& model, double height) : model_(model) {
  const std::optional<UserModel>& user = settings().model;
  if (user) {
    for (const auto& [begin, end] : aims_of(*user, model, height)) {
      rays_.push_back({begin, end});
      if (!user->sensor.empty()) {
        const Vector along = user->link_at.Rot().RotateVector(end - begin).Normalized();
        seen_from_.emplace_back(user->link_at.CoordPositionAdd(begin), along);
      }
    }
    return;
  }
  const double end = static_cast<double>(model.ray_start) + static_cast<double>(model.ray_range);
  const Vector up(0, 0, height);
  for (const float angle : model.rays) {
    const Vector along(std::cos(static_cast<double>(angle)), std::sin(static_cast<double>(angle)), 0);
    rays_.push_back({along * ray_origin(model) + up, along * end + up});
  }
}

float RobotRays::reading(std::size_t ray, double met) const {
  double from_middle = met;
  if (!seen_from_.empty() && std::isfinite(met)) {
    const Vector at = seen_from_[ray].first + seen_from_[ray].second * (met - ray_origin(model_));
    from_middle = std::hypot(at.X(), at.Y());
  }
  const double reach = from_middle - static_cast<double>(model_.ray_start);
  return static_cast<float>(std::clamp(reach, 0.0, static_cast<double>(model_.ray_range)));
}

}  // namespace swarmwright::gazebo
