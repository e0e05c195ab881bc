//! Counts the operations of arena episodes in lanes, by kind.
//!
//! Reads one JSON object, `{"parameters", "architecture", "genomes", "seeds"}`, and prints another with the number of
//! operations of each kind for vectors of 16 lanes, and the fitness of each episode.
//!
//! The episodes run on lanes that count their operations. Work that the algorithm skips because no lane needs it is not
//! counted.

mod counted;

use std::io::Read;

use serde::Deserialize;
use serde_json::{Map, Value, json};
use swarmwright_controllers::Architecture;
use swarmwright_simulation::Block;

/// The episodes to compute.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Work {
    parameters: Map<String, Value>,
    architecture: Value,
    /// (candidates, weights), row-major.
    genomes: Vec<f32>,
    seeds: Vec<u64>,
}

fn main() -> Result<(), String> {
    let mut text = String::new();
    std::io::stdin()
        .read_to_string(&mut text)
        .map_err(|error| error.to_string())?;
    let work: Work = serde_json::from_str(&text).map_err(|error| error.to_string())?;
    let architecture = Architecture::from_json(&work.architecture.to_string())
        .map_err(|error| error.to_string())?;
    let block = Block {
        architecture: &architecture,
        genomes: &work.genomes,
        parameters: &work.parameters,
        seeds: &work.seeds,
        metrics: &[],
        stop: None,
    };
    let fitness = swarmwright_kernels::evaluate_in::<counted::Numbers>(&block)
        .map_err(|error| error.to_string())?
        .ok_or("the arena does not compute these episodes in lanes")?;
    let vectors = block.len().div_ceil(counted::WIDTH);
    let [vector, integer, divide, square_root, scalar_load] = counted::counts();
    println!(
        "{}",
        json!({
            "vectors": vectors, "fitness": fitness, "vector": vector, "integer": integer, "divide": divide,
            "square_root": square_root, "scalar_load": scalar_load,
        })
    );
    Ok(())
}
