//! Operations of episodes of the arena in lanes, by kind: this example reads one JSON object, `{"parameters", "architecture",
//! "genomes", "seeds"}`, and prints another one with how many operations of each kind a vector of 16 lanes took, and the
//! fitness of each episode.
//!
//! Episodes are computed with lanes that count what is done with them, so the counts are those of the operations that
//! are needed by these episodes and no others: what no lane needs is left out by the algorithm itself.

mod counted;

use std::io::Read;

use serde::Deserialize;
use serde_json::{Map, Value, json};
use swarmwright_controllers::Architecture;
use swarmwright_simulation::Block;

/// The computation.
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
    let fitness = swarmwright_arena::evaluate_in::<counted::Numbers>(&block)
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
