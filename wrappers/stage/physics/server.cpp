// Missions of the arena in Stage:
//
//   swarmwright-stage --broker mqtt://localhost:1883 --id 6

#include "stage_physics.hpp"

#include <swarmwright/swarmwright.hpp>

#include <cstdio>
#include <cstdlib>

int main(int count, char** values) {
  swarmwright::PhysicsDescription stage;
  stage.title = "arena-stage";
  stage.determinism = swarmwright::Determinism::bitwise;
  const int status = swarmwright::serve_physics<StagePhysics>(stage, count, values);
  // Threads of Stage use its worlds until the end.
  std::fflush(nullptr);
  std::_Exit(status);
}
