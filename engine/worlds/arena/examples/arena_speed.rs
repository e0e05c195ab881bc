//! Measures the speed of the arena: `arena_speed CANDIDATES LEVEL PARAMETERS [modules]`.
//!
//! The controllers are EvoStick networks with weights from -2 to 2, or random state machines if `modules` is given.
//! LEVEL is `scalar` or the name of an instruction set. Prints the wall-clock time and the sum of all fitness values.

use serde_json::{Value, json};
use swarmwright_controllers::Architecture;
use swarmwright_kernels::Arena;
use swarmwright_lanes::Level;
use swarmwright_simulation::counter::uniform;
use swarmwright_simulation::{Block, Means, Simulation};

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let arguments: Vec<String> = std::env::args().collect();
    let [_, candidates, level, parameters, kind @ ..] = arguments.as_slice() else {
        return Err("usage: arena_speed CANDIDATES LEVEL PARAMETERS [modules]".into());
    };
    let candidates: usize = candidates.parse()?;
    let machines = kind.first().is_some_and(|kind| kind == "modules");
    let architecture = if machines {
        json!({"kind": "modules", "version": 1, "sensors": 9, "actuators": 2, "states": 4, "transitions": 4})
    } else {
        json!({"kind": "evostick", "version": 1, "sensors": 24, "actuators": 2})
    };
    let architecture = Architecture::from_json(&architecture.to_string())?;
    let mut parameters: Value = serde_json::from_str(parameters)?;
    if machines {
        parameters["robot"] = json!("e-puck-rm1.2");
    }
    let parameters = parameters.as_object().ok_or("expected an object")?;
    let count = candidates * architecture.weight_count();
    // Upper limits of the genes for the number of states, for a state, and for a transition.
    let (state, transition) = ([6.0, 100.0, 5.0, 5.0], [4.0, 6.0, 1.0, 10.0, 20.0]);
    let most = |gene: usize| match gene.checked_sub(1).map(|gene| gene % 24) {
        None => 5.0,
        Some(gene @ 0..4) => state[gene],
        Some(gene) => transition[(gene - 4) % 5],
    };
    let length = architecture.weight_count();
    let weight = |index: usize| {
        let number = uniform(1, 2, index as u64);
        if machines {
            number * most(index % length)
        } else {
            number * 4.0 - 2.0
        }
    };
    let genomes: Vec<f32> = (0..count).map(weight).collect();
    let block = Block {
        architecture: &architecture,
        genomes: &genomes,
        parameters,
        seeds: &[0],
        metrics: &[],
        stop: None,
    };
    let level = Level::available()
        .into_iter()
        .find(|candidate| candidate.name() == level);
    let mut arena = Arena::default();
    let start = std::time::Instant::now();
    let fitness = arena.evaluate(&block, Means { level, threads: 1 });
    let fitness = fitness.ok_or("no evaluation")??;
    println!(
        "{} s, fitness sum {}",
        start.elapsed().as_secs_f64(),
        fitness.iter().sum::<f64>()
    );
    Ok(())
}
