//! Built-in simulations and the trait that every simulation implements.

mod counter;
mod minisim;
mod parameters;
mod registry;
mod rollout;
mod simulation;
mod text;

pub use minisim::Minisim;
pub use parameters::ParameterReader;
pub use registry::{create, describe, titles};
pub use rollout::{Episode, RolloutError, rollout};
pub use simulation::{
    Body, Description, ParameterError, ParameterInfo, Parameters, Scene, Simulation,
};
pub use text::{TextStyle, render};
