//! Scores FREVO's own networks and compares with the fitness that FREVO gave them.
#![allow(clippy::unwrap_used, clippy::panic)] // helpers of tests

use roxmltree::{Document, Node, ParsingOptions};
use serde_json::{Value, json};
use swarmwright_controllers::{Controller, Specification};
use swarmwright_worlds::{Parameters, create, rollout};

fn read(name: &str) -> String {
    let folder = concat!(env!("CARGO_MANIFEST_DIR"), "/../../../tests/data/frevo/");
    std::fs::read_to_string(format!("{folder}{name}")).unwrap()
}

fn number<T: std::str::FromStr>(text: &str) -> T
where
    T::Err: std::fmt::Debug,
{
    text.trim().parse().unwrap()
}

/// A network's controller and FREVO's fitness.
fn network(net: Node<'_, '_>) -> (Controller, f64) {
    let of = |name| number::<usize>(net.attribute(name).unwrap());
    let (sensors, actuators) = (of("input_nodes"), of("output_nodes"));
    // Biases and weights stand in the order of a genome.
    let weights: Vec<f32> = net
        .descendants()
        .filter(|n| n.has_tag_name("bias") || n.has_tag_name("weight"))
        .map(|n| number(n.text().unwrap()))
        .collect();
    let specification = json!({
        "version": 1, "kind": "fully_meshed", "sensors": sensors, "actuators": actuators,
        "hidden": of("nodes") - sensors - actuators, "activation": "clamp", "iterations": 2,
        "output_range": [0, 1], "weights": weights,
    });
    let specification = Specification::from_json(&specification.to_string()).unwrap();
    (
        Controller::new(&specification),
        number(net.attribute("fitness").unwrap()),
    )
}

/// Scores every network of a result file, its fitness being the sum over `seeds`.
fn rescored(file: &str, mut parameters: Parameters, seeds: std::ops::Range<u64>) {
    let text = read(file);
    let options = ParsingOptions {
        allow_dtd: true,
        ..ParsingOptions::default()
    };
    let document = Document::parse_with_options(&text, options).unwrap();
    let networks: Vec<_> = document
        .descendants()
        .filter(|n| n.has_tag_name("FullyMeshedNet"))
        .map(network)
        .collect();
    assert_eq!(networks.len(), 50);
    let mut simulation = create("emergency_exit").unwrap();
    for (i, (controller, frevo)) in networks.iter().enumerate() {
        let mut fitness = 0.0;
        for seed in seeds.clone() {
            parameters.insert("seed".to_owned(), seed.into());
            fitness += rollout(simulation.as_mut(), &parameters, controller).unwrap();
        }
        let difference = (fitness - frevo).abs();
        assert!(difference <= 1e-9, "network {i}: {fitness}, FREVO {frevo}");
    }
}

#[test]
fn the_stadium() {
    let field: Value = serde_json::from_str(&read("stadium.json")).unwrap();
    let parameters = Parameters::from_iter([("field".to_owned(), field)]);
    rescored("emergency_exit_stadium.zre", parameters, 0..1);
}

#[test]
fn ten_random_fields() {
    rescored("emergency_exit_random.zre", Parameters::new(), 0..10);
}
