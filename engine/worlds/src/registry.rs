//! The built-in simulations: one line each.

use crate::block::{self, Block, Means};
use crate::emergency_exit::EmergencyExitLanes;
use crate::minisim::MinisimLanes;
use crate::rollout::{RolloutError, check_sizes};
use crate::{Description, EmergencyExit, Minisim, Simulation};
use serde_json::{Map, Value, json};
use std::sync::LazyLock;

type Create = fn() -> Box<dyn Simulation>;
type Evaluate = fn(&Block<'_>, Means, Create) -> Result<Vec<f64>, RolloutError>;

/// Title, constructor and evaluation of blocks, sorted by title.
const SIMULATIONS: [(&str, Create, Evaluate); 2] = [
    (
        "emergency_exit",
        || Box::<EmergencyExit>::default(),
        block::evaluate::<EmergencyExitLanes>,
    ),
    (
        "minisim",
        || Box::<Minisim>::default(),
        block::evaluate::<MinisimLanes>,
    ),
];

/// What they say of themselves, in the same order: asked once, since it takes a simulation to ask.
static DESCRIPTIONS: LazyLock<[Description; SIMULATIONS.len()]> =
    LazyLock::new(|| SIMULATIONS.map(|(_, create, _)| create().description()));

/// The index of a simulation.
fn find(title: &str) -> Option<usize> {
    SIMULATIONS.iter().position(|(known, ..)| *known == title)
}

/// Titles of the built-in simulations, sorted.
pub fn titles() -> Vec<&'static str> {
    SIMULATIONS.iter().map(|(title, ..)| *title).collect()
}

/// What a simulation says of itself; None for an unknown title.
pub fn description(title: &str) -> Option<&'static Description> {
    find(title).map(|index| &DESCRIPTIONS[index])
}

/// A simulation at the start of an episode with default parameters; None for an unknown title.
pub fn create(title: &str) -> Option<Box<dyn Simulation>> {
    find(title).map(|index| SIMULATIONS[index].1())
}

/// Evaluates a block of controllers in this process: the fitness of every candidate in every episode, each followed by
/// the metrics that the block asks for, row-major (candidates, episodes, 1 + metrics). None for an unknown title.
///
/// # Errors
/// Parameters that the simulation refuses, controllers that do not fit it.
pub fn evaluate(
    title: &str,
    block: &Block<'_>,
    means: Means,
) -> Option<Result<Vec<f64>, RolloutError>> {
    let index = find(title)?;
    let (_, create, evaluate) = SIMULATIONS[index];
    let architecture = block.architecture;
    if !architecture.steers() {
        return Some(block::one_by_one(block, means, create));
    }
    let fits = check_sizes(
        &DESCRIPTIONS[index],
        architecture.sensors(),
        architecture.actuators(),
    );
    Some(fits.and_then(|()| evaluate(block, means, create)))
}

/// A JSON object: title, dimensions, max_agents (null: no limit), sensors, actuators, their names and units,
/// parameters (name to type, default, description), metrics (name to unit, description); None for an unknown title.
pub fn describe(title: &str) -> Option<Value> {
    let simulation = create(title)?;
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
    Some(json!({
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
    }))
}
