//! Inference of every controller in one written-down binary32 arithmetic.
//!
//! A controller turns the sensors of one agent into its actuators. Its [`Specification`] is a JSON object; a
//! [`Controller`] is the specification at work, with the state that one agent keeps between steps. The order of
//! operations is fixed (decision 002), so that every language computes the same bits.

mod activation;
mod controller;
mod fully_meshed;
pub mod functions;
mod lanes;
mod layered;
mod mealy_fsm;
mod output_range;
mod parameter_set;
mod reader;
mod specification;

pub use activation::Activation;
pub use controller::{Controller, ControllerError};
pub use fully_meshed::FullyMeshed;
pub use lanes::LaneController;
pub use layered::Layered;
pub use mealy_fsm::MealyFsm;
pub use output_range::OutputRange;
pub use parameter_set::{Parameter, ParameterKind, ParameterSet};
pub use specification::{Architecture, MAX_WEIGHTS, Specification, SpecificationError, VERSION};
