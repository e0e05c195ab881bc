//! The built-in simulations, and their scenes as text.

mod emergency_exit;
mod minisim;
mod registry;
mod text;

pub use emergency_exit::EmergencyExit;
pub use minisim::Minisim;
pub use registry::{create, describe, described, evaluate, titles, vectors};
pub use swarmwright_arena::{MissionInfo, missions, robots};
pub use swarmwright_kernels::Arena;
pub use swarmwright_simulation::simulation::Describer;
pub use swarmwright_simulation::{
    Block, Body, Description, Determinism, Episode, Failure, Group, Light, Means, MetricInfo, Pace,
    ParameterError, ParameterInfo, ParameterReader, Parameters, Patch, Ray, RolloutError, Scale,
    Scene, Side, Simulation, Style, Together, UnknownMetric, Wall, fail, measure, rollout,
    rollout_until,
};
use swarmwright_simulation::{block, counter, parameters, simulation};
pub use text::{TextStyle, render};
