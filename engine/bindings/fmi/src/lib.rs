//! Simulations as Functional Mock-up Units (FMUs): the functions for co-simulation of FMI 2.0 and FMI 3.0.
//!
//! The simulation is in this process, or, of a proxy, on a simulation server behind a broker.
//!
//! One library serves every FMU that `swarmwright export-fmu` writes: what is in it is said by `resources/model.json`, see
//! [`model`]. Nothing unwinds out of here: every function is [shielded](shield).
#![allow(unsafe_code)] // the interface is made of pointers; each use says why it holds
#![warn(clippy::undocumented_unsafe_blocks)]

#[allow(non_snake_case, missing_docs)] // the names of the standard
mod fmi2;
#[allow(non_snake_case, missing_docs)] // the names of the standard
mod fmi3;
mod instance;
mod local;
mod log;
mod model;
mod remote;
mod shield;
mod text;
mod variables;
mod world;
