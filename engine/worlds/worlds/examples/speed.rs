//! How fast blocks are evaluated here: `cargo run --release -p swarmwright-worlds --example speed -- TITLE CANDIDATES NETWORK PARAMETERS [LEVEL]`.

use std::time::Instant;

use swarmwright_controllers::Architecture;
use swarmwright_lanes::Level;
use swarmwright_worlds::{Block, Means, evaluate};

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let arguments: Vec<String> = std::env::args().collect();
    let [_, title, candidates, network, parameters, only @ ..] = arguments.as_slice() else {
        return Err("usage: speed TITLE CANDIDATES NETWORK PARAMETERS (both JSON) [LEVEL]".into());
    };
    let candidates: usize = candidates.parse()?;
    let architecture = Architecture::from_json(network)?;
    let parameters = serde_json::from_str(parameters)?;
    // Any spread of weights does; this one needs no generator.
    let weight = |index: usize| {
        ((index as u64).wrapping_mul(0x9E37_79B9_7F4A_7C15) >> 40) as f32 / 4_194_304.0 - 2.0
    };
    let genomes: Vec<f32> = (0..candidates * architecture.weight_count())
        .map(weight)
        .collect();
    let block = Block {
        architecture: &architecture,
        genomes: &genomes,
        parameters: &parameters,
        seeds: &[0],
        metrics: &[],
        stop: None,
    };
    let levels = std::iter::once(None).chain(Level::available().into_iter().map(Some));
    for level in
        levels.filter(|level| only.is_empty() || level.is_some_and(|level| only[0] == level.name()))
    {
        for threads in [1, 2] {
            let mut best = f64::INFINITY;
            let mut sum = 0.0;
            for _ in 0..5 {
                let start = Instant::now();
                let fitness = evaluate(title, &block, Means { level, threads })
                    .ok_or("unknown simulation")??;
                best = best.min(start.elapsed().as_secs_f64());
                sum = fitness.iter().sum::<f64>();
            }
            let name = level.map_or("one by one", Level::name);
            println!(
                "{name:>10} {threads} threads: {:>12.0} episodes/s (fitness sum {sum})",
                candidates as f64 / best
            );
        }
    }
    Ok(())
}
