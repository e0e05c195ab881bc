//! The trait that every simulation implements, episodes of it, and blocks of evaluations in this process.

pub mod block;
pub mod counter;
mod failure;
pub mod parameters;
pub mod rollout;
pub mod simulation;
mod together;

pub use block::{Block, Means};
pub use failure::{Failure, fail};
pub use parameters::ParameterReader;
pub use rollout::{Episode, RolloutError, rollout, rollout_until};
pub use simulation::{
    Body, Description, Determinism, MetricInfo, ParameterError, ParameterInfo, Parameters, Scene,
    Simulation, UnknownMetric, measure,
};
pub use together::Together;
