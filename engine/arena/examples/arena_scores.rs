//! Objectives of EvoStick controllers in the arena: `arena_scores FILE MISSION CONTROLLER SEEDS [PARAMETERS]`. The file holds
//! `weights` by the name of the controller; prints a JSON list, an objective for each seed from 1 on.

use serde_json::{Value, json};
use swarmwright_arena::Arena;
use swarmwright_controllers::{Architecture, Controller};
use swarmwright_simulation::rollout;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let arguments: Vec<String> = std::env::args().collect();
    let [_, file, mission, controller, seeds, more @ ..] = arguments.as_slice() else {
        return Err("usage: arena_scores FILE MISSION CONTROLLER SEEDS [PARAMETERS]".into());
    };
    let data: Value = serde_json::from_str(&std::fs::read_to_string(file)?)?;
    let weights: Vec<f32> = serde_json::from_value(data["weights"][controller].clone())?;
    let architecture = json!({"kind": "evostick", "version": 1, "sensors": 24, "actuators": 2});
    let architecture = Architecture::from_json(&architecture.to_string())?;
    let controller = Controller::with_weights(&architecture.into(), weights.into())?;
    let mut arena = Arena::default();
    let mut parameters: Value = match more {
        [text, ..] => serde_json::from_str(text)?,
        [] => json!({}),
    };
    parameters["mission"] = json!(mission);
    let mut scores = Vec::new();
    for seed in 1..=seeds.parse::<u64>()? {
        parameters["seed"] = json!(seed);
        let parameters = parameters
            .as_object()
            .ok_or("parameters: expected an object")?;
        scores.push(rollout(&mut arena, parameters, &controller)?);
    }
    println!("{}", json!(scores));
    Ok(())
}
