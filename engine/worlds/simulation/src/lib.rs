//! The trait that every simulation implements, episodes of it, and blocks of evaluations in this process.

pub mod block;
pub mod counter;
mod failure;
mod pace;
pub mod parameters;
pub mod rollout;
mod scene;
pub mod simulation;
mod together;

pub use block::{Block, Means};
pub use failure::{Failure, fail};
pub use pace::Pace;
pub use parameters::ParameterReader;
pub use rollout::{Episode, RolloutError, rollout, rollout_until};
pub use scene::{Body, Light, Patch, Ray, Scale, Scene, Style, Wall};
pub use simulation::{
    Description, Determinism, Group, MetricInfo, ParameterError, ParameterInfo, Parameters, Side,
    Simulation, UnknownMetric, measure,
};
pub use together::Together;
