// Missions of the arena in ARGoS 3:
//
//   swarmwright-argos --broker mqtt://localhost:1883 --id 6

#include "argos_physics.hpp"

#include <swarmwright/swarmwright.hpp>

#include <cstdio>
#include <cstdlib>

int main(int count, char** values) {
  swarmwright::PhysicsDescription argos;
  argos.title = "arena-argos";
  argos.determinism = swarmwright::Determinism::bitwise;
  const int status = swarmwright::serve_physics<ArgosPhysics>(argos, count, values);
  // ARGoS does not survive the destructors of its own libraries.
  std::fflush(nullptr);
  std::_Exit(status);
}
