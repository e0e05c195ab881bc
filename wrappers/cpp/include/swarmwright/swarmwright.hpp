// Swarmwright's simulation wrapper for C++17: a simulator becomes a simulation server.
//
//   Simulation   the base class to derive from: reset, acting, sense, step, fitness
//   Server       offers a Simulation: run() has a loop, poll() is for programs with a main loop
//   Plugin       for simulators with a main loop that cannot be called: poll() returns the next task
//   serve        the main function of a simulation server
//   Physics      the base class of simulators that move the robots of missions: start, step, poses
//   Parameters   the parameters of an episode, read with type and range
//
// How to use it: docs/how-to/java-and-cpp.md. All of this is a layer over the C interface in swarmwright.h.
#pragma once

#include <swarmwright/swarmwright.h>
#include <swarmwright/description.hpp>
#include <swarmwright/error.hpp>
#include <swarmwright/parameters.hpp>
#include <swarmwright/physics.hpp>
#include <swarmwright/plugin.hpp>
#include <swarmwright/scene.hpp>
#include <swarmwright/serve.hpp>
#include <swarmwright/server.hpp>
#include <swarmwright/simulation.hpp>
#include <swarmwright/span.hpp>
