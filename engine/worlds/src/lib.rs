//! Built-in simulations and the trait that every simulation implements.

mod simulation;

pub use simulation::{Body, Description, ParameterError, Parameters, Scene, Simulation};
