#include "body.hpp"

#include <argos3/core/simulator/space/space.h>
#include <argos3/plugins/simulator/physics_engines/dynamics2d/dynamics2d_engine.h>

#include <cmath>
#include <utility>

namespace argos {

namespace {

/// Rays are level, and meet everything.
constexpr double height = 0.5;

/// Of contacts, as ARGoS has them for boxes and robots; those of two bodies are multiplied.
constexpr double friction_fixed = 0.1;
constexpr double friction_moving = 0.7;

double heading(const CQuaternion& orientation) {
  CRadians z;
  CRadians y;
  CRadians x;
  orientation.ToEulerAngles(z, y, x);
  return z.GetValue();
}

/// Chipmunk wants corners clockwise.
std::vector<cpVect> clockwise(const std::vector<CVector2>& corners) {
  std::vector<cpVect> points;
  for (auto corner = corners.rbegin(); corner != corners.rend(); ++corner) {
    points.push_back(cpv(corner->GetX(), corner->GetY()));
  }
  return points;
}

}  // namespace

SwarmwrightBody::SwarmwrightBody(const std::string& id, SwarmwrightShape shape)
    : CComposableEntity(nullptr, id),
      shape_(std::move(shape)),
      embodied_(
          new CEmbodiedEntity(this, "body", CVector3(), CQuaternion(), shape_.kind != SwarmwrightShape::Kind::fixed)) {
  AddComponent(*embodied_);
}

SwarmwrightBodyModel::SwarmwrightBodyModel(CDynamics2DEngine& engine, SwarmwrightBody& entity)
    : CDynamics2DStretchableObjectModel(engine, entity),
      entity_(entity),
      control_(engine, entity.shape().force, entity.shape().torque) {
  const SwarmwrightShape& shape = entity.shape();
  const bool fixed = shape.kind == SwarmwrightShape::Kind::fixed;
  std::vector<cpVect> corners = clockwise(shape.corners);
  cpSpace* space = engine.GetPhysicsSpace();
  cpBody* body = nullptr;
  if (fixed) {
    body = cpBodyNewStatic();
  } else {
    // Robots of ARGoS have the moment of a disc of twice their radius.
    const double reach = shape.kind == SwarmwrightShape::Kind::driven ? 2 * shape.radius : shape.radius;
    const double moment = corners.empty()
                              ? cpMomentForCircle(shape.mass, 0, reach, cpvzero)
                              : cpMomentForPoly(shape.mass, static_cast<int>(corners.size()), corners.data(), cpvzero);
    body = cpSpaceAddBody(space, cpBodyNew(shape.mass, moment));
  }
  const SAnchor& anchor = entity.embodied().GetOriginAnchor();
  body->p = cpv(anchor.Position.GetX(), anchor.Position.GetY());
  cpBodySetAngle(body, heading(anchor.Orientation));
  cpShape* made = corners.empty() ? cpCircleShapeNew(body, shape.radius, cpvzero)
                                  : cpPolyShapeNew(body, static_cast<int>(corners.size()), corners.data(), cpvzero);
  cpSpaceAddShape(space, made);
  made->e = 0;
  made->u = fixed ? friction_fixed : friction_moving;
  made->collision_type = CDynamics2DEngine::SHAPE_NORMAL;
  SetBody(body, height);
  if (shape.kind == SwarmwrightShape::Kind::loose) {
    SetMass(shape.mass);
    SetLinearFriction(0, shape.force);
    SetAngularFriction(0, shape.torque);
  } else if (shape.kind == SwarmwrightShape::Kind::driven) {
    control_.AttachTo(body);
  }
}

SwarmwrightBodyModel::~SwarmwrightBodyModel() { control_.Detach(); }

void SwarmwrightBodyModel::UpdateFromEntityStatus() {
  if (entity_.shape().kind != SwarmwrightShape::Kind::driven) {
    return;
  }
  // As for ARGoS's robots, the velocity keeps the direction of the heading at the start of the tick.
  const double angle = GetBody()->a;
  const double ahead_x = std::cos(angle);
  const double ahead_y = std::sin(angle);
  control_.SetLinearVelocity(CVector2(entity_.forward * ahead_x - entity_.sideways * ahead_y,
                                      entity_.forward * ahead_y + entity_.sideways * ahead_x));
  control_.SetAngularVelocity(entity_.turn);
}

REGISTER_STANDARD_SPACE_OPERATIONS_ON_COMPOSABLE(SwarmwrightBody)
REGISTER_STANDARD_DYNAMICS2D_OPERATIONS_ON_ENTITY(SwarmwrightBody, SwarmwrightBodyModel)

}  // namespace argos
