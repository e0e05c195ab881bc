//! Built-in simulations and the trait that every simulation implements.

mod arena;
mod block;
mod counter;
mod emergency_exit;
mod failure;
mod minisim;
mod parameters;
mod registry;
mod rollout;
mod simulation;
mod text;
mod together;

pub use arena::Arena;
pub use block::{Block, Means};
pub use emergency_exit::EmergencyExit;
pub use failure::{Failure, fail};
pub use minisim::Minisim;
pub use parameters::ParameterReader;
pub use registry::{create, describe, described, evaluate, titles};
pub use rollout::{Episode, RolloutError, rollout, rollout_until};
pub use simulation::{
    Body, Description, Determinism, MetricInfo, ParameterError, ParameterInfo, Parameters, Scene,
    Simulation, UnknownMetric, measure,
};
pub use text::{TextStyle, render};
pub use together::Together;
