//! Simulates one tool and many servers: `swarmwright-scale --servers N --episode MS [--preempted-after S] [--share N]
//! [--generations N] [--seed N]`; prints one JSON object.

use std::process::ExitCode;

use swarmwright_fuzzing::{Counting, held};
use swarmwright_schedules::scale::{Scale, simulate};

#[global_allocator]
static ALLOCATOR: Counting = Counting;

fn arguments() -> Result<Scale, String> {
    let mut scale = Scale {
        seed: 1,
        servers: 100,
        episode: 1_000_000,
        preempted_after: None,
        share: 16,
        generations: 2,
    };
    let mut rest = std::env::args().skip(1);
    while let Some(name) = rest.next() {
        let value = rest
            .next()
            .ok_or_else(|| format!("{name} needs a value"))?
            .parse::<u64>()
            .map_err(|error| format!("{name}: {error}"))?;
        let count = usize::try_from(value.max(1)).unwrap_or(usize::MAX);
        match name.as_str() {
            "--seed" => scale.seed = value,
            "--servers" => scale.servers = count,
            "--episode" => scale.episode = value.max(1) * 1000,
            "--preempted-after" => scale.preempted_after = Some(value.max(1) * 1_000_000),
            "--share" => scale.share = count,
            "--generations" => scale.generations = count,
            _ => return Err(format!("{name} is unknown")),
        }
    }
    Ok(scale)
}

fn main() -> ExitCode {
    let done = arguments().and_then(|scale| {
        let figures = simulate(&scale, &held).map_err(|error| error.to_string())?;
        serde_json::to_string(&figures).map_err(|error| error.to_string())
    });
    match done {
        Ok(text) => {
            println!("{text}");
            ExitCode::SUCCESS
        }
        Err(error) => {
            eprintln!("swarmwright-scale: {error}");
            ExitCode::from(2)
        }
    }
}
