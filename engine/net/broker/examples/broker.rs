//! Runs the broker alone until standard input ends: `cargo run --release --example broker -- 1883`.

use std::io::Read;
use swarmwright_broker::{Broker, BrokerError, Config};

fn main() -> Result<(), BrokerError> {
    let port = std::env::args().nth(1).and_then(|port| port.parse().ok());
    let broker = Broker::start(&Config {
        port: Some(port.unwrap_or(0)),
        ..Config::default()
    })?;
    println!("{}", broker.url());
    let _ = std::io::stdin().read_to_end(&mut Vec::new());
    broker.stop();
    Ok(())
}
