// Swarmwright's simulation wrapper for C++17: a simulator becomes a simulation server.
//
//   Simulation   to derive from: reset, acting, sense, step, fitness
//   Server       offers a Simulation: run() has the loop, poll() leaves it to you
//   Plugin       for simulators that keep their loop and are never called: poll() says what to do
//   serve        a whole program out of a Simulation
//   Parameters   of an episode, read with type and range
//
// How to use it: docs/how-to/attach-cpp.md. All of this is a layer over the C interface in swarmwright.h.
#pragma once

#include <swarmwright/swarmwright.h>
#include <swarmwright/description.hpp>
#include <swarmwright/error.hpp>
#include <swarmwright/parameters.hpp>
#include <swarmwright/plugin.hpp>
#include <swarmwright/serve.hpp>
#include <swarmwright/server.hpp>
#include <swarmwright/simulation.hpp>
#include <swarmwright/span.hpp>
