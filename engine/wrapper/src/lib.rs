//! Simulation wrapper: a Simulation becomes a simulation server on the broker.
