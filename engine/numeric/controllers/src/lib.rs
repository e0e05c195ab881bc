//! Inference of every controller in one specified binary32 arithmetic.
//!
//! A controller turns the sensors of one agent into its actuators. Its [`Specification`] is a JSON object; a
//! [`Controller`] computes it for one agent and keeps that agent's state between steps. The order of
//! operations is fixed (decision 002), so that every language computes the same bits.

mod activation;
mod architecture;
mod controller;
pub mod functions;
mod kinds;
mod lanes;
mod output_range;
mod reader;
mod specification;
mod swarm;

pub use activation::Activation;
pub use controller::{Controller, ControllerError};
pub use kinds::{
    Architecture, BEHAVIOUR_NAMES, CONDITION_NAMES, Evostick, Form, FullyMeshed, Growing, Hebbian,
    KINDS, Layered, MealyFsm, Module, Modules, Neat, Needed, NodeActivation, PYTHON_MODULES,
    Parameter, ParameterKind, ParameterSet, PythonModules, TEAM, Team, TeamGroup,
};
pub use lanes::{LaneController, LaneControllers, LaneGroup};
pub use output_range::OutputRange;
pub use specification::{MAX_WEIGHTS, Specification, SpecificationError, VERSION};
pub use swarm::SwarmControllers;
