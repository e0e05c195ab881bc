//! Draws a Minisim episode in which every agent heads straight for the goal.
//!
//! `cargo run --example minisim -- '{"mapWidth": 100, "mapHeight": 100, "numAgents": 20, "placement": "random"}'`

use std::error::Error;
use swarmwright_worlds::{Minisim, Parameters, Simulation, TextStyle, render};

fn main() -> Result<(), Box<dyn Error>> {
    let text = std::env::args().nth(1).unwrap_or_else(|| "{}".to_owned());
    let parameters: Parameters = serde_json::from_str(&text)?;
    let mut simulation = Minisim::default();
    simulation.reset(&parameters)?;
    let mut sensors = [0.0; 4];
    loop {
        if let Some(scene) = simulation.scene() {
            println!("{}\n", render(&scene, TextStyle::default()).join("\n"));
        }
        if simulation.acting().is_empty() {
            println!("fitness {}", simulation.fitness());
            return Ok(());
        }
        let actuators: Vec<f32> = simulation
            .acting()
            .iter()
            .map(|agent| {
                simulation.sense(*agent, &mut sensors);
                sensors[1].atan2(sensors[0]) / std::f32::consts::PI
            })
            .collect();
        simulation.step(&actuators);
    }
}
