//! The built-in simulations: one line each.

use crate::block::{self, Block, Create, Evaluate, LaneWorld, Means};
use crate::emergency_exit::EmergencyExitLanes;
use crate::minisim::MinisimLanes;
use crate::{Arena, Description, EmergencyExit, Minisim, ParameterError, Parameters, RolloutError};
use serde_json::{Map, Value, json};
use std::borrow::Cow;
use std::sync::LazyLock;

/// What the registry knows of a simulation.
struct Entry {
    title: &'static str,
    create: Create,
    evaluate: Evaluate,
    /// Vectors of lanes that are computed side by side.
    vectors: usize,
    /// Whether sensors and metrics depend on parameters.
    varies: bool,
}

/// All of them, sorted by title.
const SIMULATIONS: [Entry; 3] = [
    Entry {
        title: "arena",
        create: || Box::<Arena>::default(),
        evaluate: swarmwright_kernels::evaluate,
        vectors: swarmwright_kernels::VECTORS,
        varies: true,
    },
    Entry {
        title: "emergency_exit",
        create: || Box::<EmergencyExit>::default(),
        evaluate: block::evaluate::<EmergencyExitLanes>,
        vectors: EmergencyExitLanes::VECTORS,
        varies: false,
    },
    Entry {
        title: "minisim",
        create: || Box::<Minisim>::default(),
        evaluate: block::evaluate::<MinisimLanes>,
        vectors: MinisimLanes::VECTORS,
        varies: false,
    },
];

/// What they say of themselves, in the same order: asked once, since it takes a simulation to ask.
static DESCRIPTIONS: LazyLock<[Description; SIMULATIONS.len()]> =
    LazyLock::new(|| std::array::from_fn(|index| (SIMULATIONS[index].create)().description()));

/// The index of a simulation.
fn find(title: &str) -> Option<usize> {
    SIMULATIONS.iter().position(|entry| entry.title == title)
}

/// Titles of the built-in simulations, sorted.
pub fn titles() -> Vec<&'static str> {
    SIMULATIONS.iter().map(|entry| entry.title).collect()
}

/// What a simulation says of itself with these parameters; None for an unknown title.
///
/// # Errors
/// A parameter that the simulation refuses, where it depends on parameters.
pub fn described(
    title: &str,
    parameters: &Parameters,
) -> Option<Result<Cow<'static, Description>, ParameterError>> {
    find(title).map(|index| description(index, parameters))
}

/// As [`described`], by index.
fn description(
    index: usize,
    parameters: &Parameters,
) -> Result<Cow<'static, Description>, ParameterError> {
    let entry = &SIMULATIONS[index];
    if entry.varies {
        (entry.create)().described(parameters).map(Cow::Owned)
    } else {
        Ok(Cow::Borrowed(&DESCRIPTIONS[index]))
    }
}

/// A simulation at the start of an episode with default parameters; None for an unknown title.
pub fn create(title: &str) -> Option<Box<dyn crate::Simulation>> {
    find(title).map(|index| (SIMULATIONS[index].create)())
}

/// Evaluates a block of controllers in this process: the fitness of every candidate in every episode, each followed by
/// the metrics that the block asks for, row-major (candidates, episodes, 1 + metrics). None for an unknown title.
///
/// # Errors
/// Parameters that the simulation refuses, or controllers that do not fit it.
pub fn evaluate(
    title: &str,
    block: &Block<'_>,
    means: Means,
) -> Option<Result<Vec<f64>, RolloutError>> {
    let index = find(title)?;
    let entry = &SIMULATIONS[index];
    Some(block::evaluate_fitting(
        block,
        means,
        entry.create,
        entry.evaluate,
        || description(index, block.parameters),
    ))
}

/// Vectors of lanes that a simulation computes side by side; None for an unknown title.
pub fn vectors(title: &str) -> Option<usize> {
    find(title).map(|index| SIMULATIONS[index].vectors)
}

/// A JSON object: title, dimensions, max_agents (null: no limit), sensors, actuators, their names and units,
/// parameters (name to type, default, description), metrics (name to unit, description), varies (whether sensors, actuators
/// and metrics depend on parameters), groups (of agents, where there are several kinds: name, agents, sensors, actuators and their
/// names), sides (of a match: name, groups, fitness); None for an unknown title. It is that of these parameters, or of the default ones.
///
/// # Errors
/// A parameter that the simulation refuses.
pub fn describe(
    title: &str,
    parameters: Option<&Parameters>,
) -> Option<Result<Value, ParameterError>> {
    let entry = &SIMULATIONS[find(title)?];
    let mut simulation = (entry.create)();
    if let Some(parameters) = parameters
        && let Err(error) = simulation.reset(parameters)
    {
        return Some(Err(error));
    }
    let description = simulation.description();
    let parameters: Map<String, Value> = simulation
        .parameters()
        .into_iter()
        .map(|p| (p.name.to_owned(), json!(p)))
        .collect();
    let metrics: Map<String, Value> = description
        .metrics
        .iter()
        .map(|m| (m.name.to_string(), json!(m)))
        .collect();
    Some(Ok(json!({
        "title": description.title,
        "dimensions": description.dimensions,
        "max_agents": description.max_agents,
        "sensors": description.sensors,
        "actuators": description.actuators,
        "sensor_names": simulation.sensor_names(),
        "actuator_names": simulation.actuator_names(),
        "sensor_units": simulation.sensor_units(),
        "actuator_units": simulation.actuator_units(),
        "parameters": parameters,
        "metrics": metrics,
        "determinism": description.determinism.name(),
        "varies": entry.varies,
        "groups": simulation.groups(),
        "sides": simulation.sides(),
    })))
}
