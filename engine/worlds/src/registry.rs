//! The built-in simulations: one line each.

use crate::{Minisim, Simulation};
use serde_json::{Map, Value, json};

type Create = fn() -> Box<dyn Simulation>;

/// Title and constructor, sorted by title.
const SIMULATIONS: [(&str, Create); 1] = [("minisim", || Box::<Minisim>::default())];

/// Titles of the built-in simulations, sorted.
pub fn titles() -> Vec<&'static str> {
    SIMULATIONS.iter().map(|(title, _)| *title).collect()
}

/// A simulation at the start of an episode with default parameters; None for an unknown title.
pub fn create(title: &str) -> Option<Box<dyn Simulation>> {
    SIMULATIONS
        .iter()
        .find(|(known, _)| *known == title)
        .map(|(_, create)| create())
}

/// A JSON object: title, dimensions, max_agents (null: no limit), sensors, actuators, parameters (name to type,
/// default, description); None for an unknown title.
pub fn describe(title: &str) -> Option<Value> {
    let simulation = create(title)?;
    let description = simulation.description();
    let parameters: Map<String, Value> = simulation
        .parameters()
        .into_iter()
        .map(|p| (p.name.to_owned(), json!(p)))
        .collect();
    Some(json!({
        "title": description.title,
        "dimensions": description.dimensions,
        "max_agents": description.max_agents,
        "sensors": description.sensors,
        "actuators": description.actuators,
        "parameters": parameters,
    }))
}
