//! The floor of the benchmarks: what a broker does for a client as thin as one can be.

mod burst;
mod connection;
mod flood;
mod options;
mod packet;
mod pingpong;
mod relay;
mod swarm;

use options::{Options, Test, USAGE};
use std::process::ExitCode;

/// Whatever went wrong, in words.
pub type Failure = Box<dyn std::error::Error>;

fn main() -> ExitCode {
    let mut arguments = std::env::args().skip(1).peekable();
    if matches!(arguments.peek().map(String::as_str), Some("--help" | "-h")) {
        println!("{USAGE}");
        return ExitCode::SUCCESS;
    }
    let options = match Options::read(arguments) {
        Ok(options) => options,
        Err(error) => {
            eprintln!("mqtt-bare: {error}\n\n{USAGE}");
            return ExitCode::from(2);
        }
    };
    let outcome = match options.test {
        Test::PingPong => pingpong::run(&options),
        Test::Flood => flood::run(&options),
        Test::Burst => burst::run(&options),
        Test::Relay => relay::run(&options),
        Test::Swarm => swarm::run(&options),
        Test::SwarmServer => swarm::serve(&options),
    };
    match outcome {
        Ok(line) => {
            if !line.is_empty() {
                println!("{line}");
            }
            ExitCode::SUCCESS
        }
        Err(error) => {
            eprintln!("mqtt-bare: {error}");
            ExitCode::FAILURE
        }
    }
}
