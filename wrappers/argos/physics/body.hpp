// What a mission of the arena consists of, as an entity of ARGoS's engine dynamics2d: walls, obstacles, objects to push
// and robots that no plug-in of ARGoS has.
#pragma once

#include <argos3/core/simulator/entity/composable_entity.h>
#include <argos3/core/simulator/entity/embodied_entity.h>
#include <argos3/plugins/simulator/physics_engines/dynamics2d/dynamics2d_stretchable_object_model.h>
#include <argos3/plugins/simulator/physics_engines/dynamics2d/dynamics2d_velocity_control.h>

#include <string>
#include <vector>

// Entities belong to this namespace, since ARGoS's macros open it.
namespace argos {

/// How a body looks and what moves it.
struct SwarmwrightShape {
  enum class Kind {
    /// Stays where it is.
    fixed,
    /// Is pushed, against its friction.
    loose,
    /// Moves as it is told, as far as its force allows.
    driven,
  };
  Kind kind = Kind::fixed;
  /// Of a disc, metres; 0 for a polygon.
  double radius = 0;
  /// Corners of a convex polygon, counter-clockwise, in the body's frame, metres.
  std::vector<CVector2> corners = {};
  /// Kilograms.
  double mass = 0;
  /// The largest force of friction with the floor, or of the drive, newtons.
  double force = 0;
  /// The same for the torque, newton metres.
  double torque = 0;
};

/// A disc or a convex polygon.
class SwarmwrightBody : public CComposableEntity {
 public:
  ENABLE_VTABLE();

  SwarmwrightBody(const std::string& id, SwarmwrightShape shape);

  std::string GetTypeDescription() const override { return "swarmwright_body"; }

  const SwarmwrightShape& shape() const { return shape_; }
  CEmbodiedEntity& embodied() { return *embodied_; }

  /// Metres and radians a second, in the body's frame.
  double forward = 0;
  double sideways = 0;
  double turn = 0;

 private:
  SwarmwrightShape shape_;
  CEmbodiedEntity* embodied_;
};

/// The same in the engine.
class SwarmwrightBodyModel : public CDynamics2DStretchableObjectModel {
 public:
  SwarmwrightBodyModel(CDynamics2DEngine& engine, SwarmwrightBody& entity);
  ~SwarmwrightBodyModel() override;

  void UpdateFromEntityStatus() override;

 private:
  SwarmwrightBody& entity_;
  CDynamics2DVelocityControl control_;
};

}  // namespace argos
