//! Replays protocol/vectors/emergency_exit.json, which an independent implementation computed.
#![allow(clippy::unwrap_used, clippy::panic)] // helpers of tests

use serde_json::Value;
use swarmwright_controllers::{Controller, Specification};
use swarmwright_worlds::{Episode, Parameters, Scene, Simulation, create};

fn vectors() -> Value {
    let path = concat!(
        env!("CARGO_MANIFEST_DIR"),
        "/../../../protocol/vectors/emergency_exit.json"
    );
    serde_json::from_str(&std::fs::read_to_string(path).unwrap()).unwrap()
}

fn parameters(case: &Value) -> &Parameters {
    case["parameters"].as_object().unwrap()
}

fn read<T: serde::de::DeserializeOwned>(value: &Value) -> T {
    serde_json::from_value(value.clone()).unwrap()
}

/// Columns and rows of all agents, and their states.
fn agents(scene: &Scene) -> (Vec<[u32; 2]>, Vec<String>) {
    let agents = scene.bodies.iter().filter(|body| body.kind == "agent");
    agents
        .map(|b| {
            let cell = [b.x as u32, (scene.height - b.y) as u32];
            (cell, b.state.to_string())
        })
        .unzip()
}

fn assert_end(name: &str, simulation: &dyn Simulation, end: &Value) {
    assert!(simulation.acting().is_empty(), "{name} has ended");
    let scene = simulation.scene().unwrap();
    assert_eq!(u64::from(scene.step), end["steps"], "{name}: steps");
    let (cells, states) = agents(&scene);
    assert_eq!(cells, read::<Vec<[u32; 2]>>(&end["cells"]), "{name}: cells");
    assert_eq!(states, read::<Vec<String>>(&end["states"]), "{name}");
    assert_eq!(simulation.fitness(), end["fitness"], "{name}: fitness");
}

#[test]
fn episodes_agree_act_by_act() {
    let vectors = vectors();
    let cases = vectors["episodes"].as_array().unwrap();
    assert!(cases.len() >= 20);
    let mut simulation = create("emergency_exit").unwrap();
    for case in cases {
        let name = case["name"].as_str().unwrap();
        simulation
            .reset(parameters(case))
            .unwrap_or_else(|e| panic!("{name}: {e}"));
        for (i, step) in case["steps"].as_array().unwrap().iter().enumerate() {
            let acting: Vec<u32> = read(&step["acting"]);
            assert_eq!(simulation.acting(), acting, "{name}, step {i}");
            let sensed = acting.iter().map(|agent| {
                let mut sensors = [f32::NAN; 10];
                simulation.sense(*agent, &mut sensors);
                sensors
            });
            let expected: Vec<[f32; 10]> = read(&step["sensors"]);
            assert_eq!(sensed.collect::<Vec<_>>(), expected, "{name}, step {i}");
            let actuators: Vec<[f32; 2]> = read(&step["actuators"]);
            simulation.step(actuators.as_flattened());
        }
        assert_end(name, simulation.as_ref(), &case["end"]);
    }
}

#[test]
fn rollouts_agree_step_by_step() {
    let vectors = vectors();
    let cases = vectors["rollouts"].as_array().unwrap();
    assert!(cases.len() >= 15);
    for case in cases {
        let name = case["name"].as_str().unwrap();
        let specification: Specification = read(&case["controller"]);
        let mut episode = Episode::new(
            create("emergency_exit").unwrap(),
            parameters(case),
            &Controller::new(&specification),
        )
        .unwrap();
        let mut ways = vec![agents(&episode.simulation().scene().unwrap()).0];
        while !episode.done() {
            episode.step().unwrap();
            let scene = episode.simulation().scene().unwrap();
            assert_eq!(
                scene.step as usize,
                ways.len(),
                "{name}: a step of all agents"
            );
            ways.push(agents(&scene).0);
        }
        if let Some(expected) = case.get("cells") {
            let expected: Vec<Vec<[u32; 2]>> = read(expected);
            assert_eq!(ways, expected, "{name}");
        }
        assert_end(name, episode.simulation(), &case["end"]);
    }
}
