//! The trait that every simulation implements.

use std::borrow::Cow;
use std::sync::Arc;

use serde::Serialize;
use serde_json::{Map, Value};
use swarmwright_controllers::Controller;

use crate::{Block, Means, RolloutError, Scene, Together};

/// Problem-specific parameters, as in a parameters message (D6.1, Schema 10).
pub type Parameters = Map<String, Value>;

/// How far two evaluations of one episode with one controller agree, wherever they were made.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub enum Determinism {
    /// To the bit: all follows from parameters, seed and actuators.
    Bitwise,
    /// Fitness and metrics differ by at most this, as a part of the larger one, absolute below 1; finite, 0 or more.
    Statistical(f64),
    /// Not at all.
    None,
    /// The simulation does not say.
    #[default]
    Undeclared,
}

impl Determinism {
    /// The name in messages; none for what is not declared.
    #[must_use]
    pub const fn name(self) -> Option<&'static str> {
        match self {
            Self::Bitwise => Some("bitwise"),
            Self::Statistical(_) => Some("statistical"),
            Self::None => Some("none"),
            Self::Undeclared => None,
        }
    }

    /// Declared tolerance of results, if any.
    #[must_use]
    pub const fn tolerance(self) -> Option<f64> {
        match self {
            Self::Statistical(tolerance) => Some(tolerance),
            _ => None,
        }
    }
}

/// What a simulation says of itself before it is configured.
#[derive(Debug, Clone, PartialEq)]
pub struct Description {
    /// The title used in discovery.
    pub title: String,
    /// Number of spatial dimensions.
    pub dimensions: u32,
    /// Largest number of agents, none for no limit.
    pub max_agents: Option<u32>,
    /// Numbers in one agent's sensor message.
    pub sensors: usize,
    /// Numbers in one agent's actuator message.
    pub actuators: usize,
    /// What is measured in an episode beside the fitness, in the order of [`Simulation::metrics`].
    pub metrics: Cow<'static, [MetricInfo]>,
    /// Whether an episode can be repeated.
    pub determinism: Determinism,
}

impl Description {
    /// The index of each of the named metrics.
    ///
    /// # Errors
    /// A name that is not a metric of this simulation.
    pub fn metrics_named(&self, names: &[impl AsRef<str>]) -> Result<Vec<usize>, UnknownMetric> {
        let index = |name: &str| {
            let position = self.metrics.iter().position(|metric| metric.name == name);
            position.ok_or_else(|| UnknownMetric {
                name: name.to_owned(),
                simulation: self.title.clone(),
                available: self.metrics.iter().map(|m| m.name.to_string()).collect(),
            })
        };
        names.iter().map(|name| index(name.as_ref())).collect()
    }
}

/// Agents of one kind in an episode: what they sense and how they are steered.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct Group {
    /// The name by which controllers of these agents are found.
    pub name: Cow<'static, str>,
    /// How many there are.
    pub agents: u32,
    /// Numbers that each senses: the first ones of what [`Simulation::sense`] writes, the others are 0.
    pub sensors: usize,
    /// Numbers that each is steered by: the first ones of its row, the others do not count.
    pub actuators: usize,
    /// Whether messages hold the numbers that do not count, too: all agents then have messages of the same length, and a
    /// controller that all share can steer them.
    pub padded: bool,
    /// Names of the sensors, in their order; empty where there are none.
    pub sensor_names: Vec<String>,
    /// Names of the actuators, likewise.
    pub actuator_names: Vec<String>,
    /// Where all kinds have the same numbers: what this one calls the sensors that it has, None for the others. Else empty.
    pub own_sensor_names: Vec<Option<String>>,
    /// The actuators that it has, likewise.
    pub own_actuator_names: Vec<Option<String>>,
}

/// A side of a match: groups of agents that are evaluated together, against those of the other sides.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct Side {
    /// The name in experiments.
    pub name: Cow<'static, str>,
    /// Names of its groups, see [`Group::name`]; a group belongs to one side.
    pub groups: Vec<Cow<'static, str>>,
    /// Name of the metric that is its fitness, larger is better; None where the simulation has none for it.
    pub fitness: Option<Cow<'static, str>>,
}

impl Side {
    /// A side of a simulation that is built in.
    #[must_use]
    pub fn new(name: &'static str, groups: &[&'static str], fitness: &'static str) -> Self {
        Self {
            name: name.into(),
            groups: groups.iter().copied().map(Cow::Borrowed).collect(),
            fitness: Some(fitness.into()),
        }
    }
}

/// What a simulation says of one of its metrics: a number that it measures in an episode.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct MetricInfo {
    /// The name in messages and in fitness expressions: a letter or _, then letters, digits and _.
    #[serde(skip)]
    pub name: Cow<'static, str>,
    /// What it counts or is measured in: agents, steps, metres, ...; empty for a mere number.
    pub unit: Cow<'static, str>,
    /// Meaning, in a sentence.
    pub description: Cow<'static, str>,
}

impl MetricInfo {
    /// A metric of a simulation that is built in.
    #[must_use]
    pub const fn new(name: &'static str, unit: &'static str, description: &'static str) -> Self {
        Self {
            name: Cow::Borrowed(name),
            unit: Cow::Borrowed(unit),
            description: Cow::Borrowed(description),
        }
    }
}

/// A metric that a simulation does not have; says which ones it has.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error(
    "metrics: {name:?} is not a metric of {simulation}; {}",
    if .available.is_empty() { "it has none".to_owned() } else { format!("it has {}", .available.join(", ")) }
)]
pub struct UnknownMetric {
    /// The name that was asked for.
    pub name: String,
    /// Title of the simulation.
    pub simulation: String,
    /// The names that there are.
    pub available: Vec<String>,
}

/// What a simulation says of one of its parameters.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct ParameterInfo {
    /// The name in a parameters message.
    #[serde(skip)]
    pub name: &'static str,
    /// integer, number, string, position ([x, y]), positions ([[x, y], ..]), object, objects (a list of them), or name or object.
    #[serde(rename = "type")]
    pub kind: &'static str,
    /// What it is when left out; null where that depends on other parameters, as the description says.
    pub default: Value,
    /// Meaning, unit and range, in a sentence.
    pub description: &'static str,
}

/// A parameter that cannot be used; says which, why and what would be right.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("parameter {name}: {reason}")]
pub struct ParameterError {
    /// The parameter's name as in the message.
    pub name: String,
    /// What is wrong and what is expected.
    pub reason: String,
}

/// Describes a simulation with given parameters, or says which of them it refuses; apart from the simulation, which may be in
/// an episode meanwhile.
pub type Describer = Arc<dyn Fn(&Parameters) -> Result<Description, ParameterError> + Send + Sync>;

/// An environment that can be reset and stepped. One object runs one episode at a time, any number in turn.
pub trait Simulation: Send {
    /// What this simulation offers; the same at any time, but for those whose sensors, actuators and metrics depend on
    /// parameters: then as after the last [`reset`](Self::reset).
    fn description(&self) -> Description;

    /// What describes it with given parameters, where its sensors, actuators and metrics depend on them.
    fn describer(&self) -> Option<Describer> {
        None
    }

    /// What this simulation offers with these parameters.
    ///
    /// # Errors
    /// As [`reset`](Self::reset), for those where it depends on parameters.
    fn described(&self, parameters: &Parameters) -> Result<Description, ParameterError> {
        match self.describer() {
            Some(describe) => describe(parameters),
            None => Ok(self.description()),
        }
    }

    /// Every parameter that `reset` understands, for documentation and checks.
    fn parameters(&self) -> Vec<ParameterInfo> {
        Vec::new()
    }

    /// All that is wrong with parameters, where this simulation collects it; [`reset`](Self::reset) refuses the first one.
    fn mistakes(&self, parameters: &Parameters) -> Option<Vec<ParameterError>> {
        let _ = parameters;
        None
    }

    /// Names of an agent's sensors, in their order, for drawings; empty where the simulation has no names for them.
    fn sensor_names(&self) -> Vec<String> {
        Vec::new()
    }

    /// Names of an agent's actuators, as [`sensor_names`](Self::sensor_names).
    fn actuator_names(&self) -> Vec<String> {
        Vec::new()
    }

    /// The kinds of agents of the episode that [`reset`](Self::reset) began, where there are several: the first has the agents
    /// from 0 on, the next one those after them. The description has the most sensors and actuators of any.
    fn groups(&self) -> Vec<Group> {
        Vec::new()
    }

    /// The sides of a match, where groups compete; the same at any time, but for those whose description depends on
    /// parameters: then as after the last [`reset`](Self::reset). Where there are none, each group may be a side.
    fn sides(&self) -> Vec<Side> {
        Vec::new()
    }

    /// Gets the controller of the episode that [`reset`](Self::reset) begins next, where both are in one process: for
    /// simulations that run it themselves, of which no agent then acts. Where steps cross the broker it is not called.
    fn take_controller(&mut self, controller: &Controller) {
        let _ = controller;
    }

    /// Units of an agent's sensors, in their order, as text; empty where the simulation says nothing about them.
    fn sensor_units(&self) -> Vec<String> {
        Vec::new()
    }

    /// Units of an agent's actuators, as [`sensor_units`](Self::sensor_units).
    fn actuator_units(&self) -> Vec<String> {
        Vec::new()
    }

    /// Starts an episode. Omitted parameters have their defaults; unknown ones are ignored.
    ///
    /// # Errors
    /// A parameter of the wrong type or out of range; the simulation is then not to be stepped.
    fn reset(&mut self, parameters: &Parameters) -> Result<(), ParameterError>;

    /// The agents whose actuators the next step needs, ascending; none when the episode has ended, and none as long as
    /// all agents are steered by the simulation itself.
    fn acting(&self) -> &[u32];

    /// Whether the episode has ended. While it has not and no agent acts, the simulation goes on by itself: it is stepped
    /// without actuators.
    fn done(&self) -> bool {
        self.acting().is_empty()
    }

    /// Writes the sensors of one acting agent.
    fn sense(&self, agent: u32, sensors: &mut [f32]);

    /// Moves on by one step. `actuators` holds one row per acting agent, in the order of `acting`, each number in -1..=1.
    fn step(&mut self, actuators: &[f32]);

    /// Whether a step is under way: some of the agents that act in turn have acted in it, others have not.
    fn mid_step(&self) -> bool {
        false
    }

    /// Fitness of the episode so far; larger is better.
    fn fitness(&self) -> f64;

    /// The metrics of the episode so far, in the order of the description; asked for only where they are wanted.
    fn metrics(&self) -> Vec<f64> {
        Vec::new()
    }

    /// Another simulation of this kind, so that several episodes can be stepped side by side; none if there can be only
    /// this one.
    fn duplicate(&self) -> Option<Box<dyn Simulation>> {
        None
    }

    /// Runs many calls of this simulation, on whatever thread makes them: for those that can be readied for all of them at
    /// once.
    fn scope(&self) -> fn(&mut dyn FnMut()) {
        |calls| calls()
    }

    /// The fitness of every candidate of a block in every episode, each followed by the metrics that the block asks
    /// for: row-major (candidates, episodes, 1 + metrics), to the bit what [`rollout`](crate::rollout) and
    /// [`measure`](crate::measure) give; none for those who leave that to them.
    ///
    /// # Errors
    /// As [`rollout`](crate::rollout).
    fn evaluate(
        &mut self,
        block: &Block<'_>,
        means: Means,
    ) -> Option<Result<Vec<f64>, RolloutError>> {
        let _ = (block, means);
        None
    }

    /// Many episodes stepped together; none for those who step one at a time. Who has it has
    /// [`duplicate`](Self::duplicate), too, or steps one.
    fn together(&mut self) -> Option<&mut dyn Together> {
        None
    }

    /// Episodes that [`evaluate`](Self::evaluate) and [`together`](Self::together) compute in about the time of one.
    fn lanes(&self) -> usize {
        1
    }

    /// Whether [`scene`](Self::scene) gives a scene once an episode has begun, which can be shown elsewhere.
    fn has_scenes(&self) -> bool {
        false
    }

    /// What can be seen now; none if there is nothing to show.
    fn scene(&self) -> Option<Scene> {
        None
    }

    /// Milliseconds between two frames when shown.
    fn step_size(&self) -> u64 {
        250
    }
}

/// Names or units in the form of [`Simulation::sensor_names`].
#[must_use]
pub fn texts(texts: &[&str]) -> Vec<String> {
    texts.iter().map(|text| (*text).to_owned()).collect()
}

/// Writes the metrics with these indices in the description; NaN for what the simulation does not give.
pub fn measure(simulation: &dyn Simulation, indices: &[usize], values: &mut [f64]) {
    if indices.is_empty() {
        return;
    }
    let all = simulation.metrics();
    for (index, value) in indices.iter().zip(values) {
        *value = all.get(*index).copied().unwrap_or(f64::NAN);
    }
}
