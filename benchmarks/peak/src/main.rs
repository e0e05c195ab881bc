//! Peak rates of the operations that a rollout is made of: `peak [LEVEL]` prints one JSON object, operations per ns.
//!
//! Each kind runs as many independent streams as registers hold, so that throughput and not latency is measured. A
//! vector operation counts once, however many lanes it has. Rates are the best of several short rounds: a round in
//! which the processor was given to somebody else does not count.

mod scalar;
mod vector;

use std::time::Instant;
use swarmwright_lanes::Level;

/// Rounds of each kind, and what one takes in the mean.
const ROUNDS: usize = 40;

/// Operations per nanosecond in the best of the rounds; `round` does its work and returns how many operations it was.
fn rate(mut round: impl FnMut() -> u64) -> f64 {
    (0..ROUNDS)
        .map(|_| {
            let start = Instant::now();
            let operations = round();
            #[expect(clippy::cast_precision_loss, reason = "a rate")]
            let operations = operations as f64;
            operations / start.elapsed().as_secs_f64() / 1e9
        })
        .fold(0.0, f64::max)
}

fn main() -> Result<(), String> {
    let levels = Level::available();
    let level = match std::env::args().nth(1) {
        None => Level::best(),
        Some(name) => levels
            .iter()
            .copied()
            .find(|level| level.name() == name)
            .ok_or_else(|| {
                format!("this processor has no {name}; usage: peak [portable|avx2|avx512]")
            })?,
    };
    let rates = [
        ("multiply_add", rate(|| level.run(vector::MultiplyAdd))),
        ("divide", rate(|| level.run(vector::Divide))),
        ("square_root", rate(|| level.run(vector::SquareRoot))),
        ("integer", rate(|| level.run(vector::Integer))),
        ("scalar_load", rate(scalar::loads)),
        ("scalar_store", rate(scalar::stores)),
    ];
    let rates: Vec<String> = rates
        .iter()
        .map(|(kind, rate)| format!("\"{kind}\": {rate:.4}"))
        .collect();
    println!(
        "{{\"level\": \"{}\", \"lanes\": {}, {}}}",
        level.name(),
        level.width(),
        rates.join(", ")
    );
    Ok(())
}
