//! Replays protocol/vectors/minisim.json, which an independent implementation computed.
#![allow(clippy::unwrap_used, clippy::panic)] // helpers of tests

use serde_json::Value;
use swarmwright_controllers::{Controller, Specification};
use swarmwright_worlds::{Episode, Parameters, Simulation, create, rollout};

fn vectors() -> Value {
    let path = concat!(
        env!("CARGO_MANIFEST_DIR"),
        "/../../../protocol/vectors/minisim.json"
    );
    serde_json::from_str(&std::fs::read_to_string(path).unwrap()).unwrap()
}

fn bits(value: &Value) -> u32 {
    u32::from_str_radix(value.as_str().unwrap(), 16).unwrap()
}

fn parameters(case: &Value) -> &Parameters {
    case["parameters"].as_object().unwrap()
}

/// Positions as bit patterns, states and fitness at the end of an episode.
fn assert_end(name: &str, simulation: &dyn Simulation, end: &Value) {
    let scene = simulation.scene().unwrap();
    assert_eq!(
        u64::from(scene.step),
        end["steps"].as_u64().unwrap(),
        "{name}: steps"
    );
    for (kind, key) in [("agent", "agent_bits"), ("defender", "defender_bits")] {
        let bodies: Vec<_> = scene.bodies.iter().filter(|b| b.kind == kind).collect();
        let expected = end[key].as_array().unwrap();
        assert_eq!(bodies.len(), expected.len(), "{name}: {kind}s");
        for (i, (body, position)) in bodies.iter().zip(expected).enumerate() {
            let position = [bits(&position[0]), bits(&position[1])];
            assert_eq!(
                [body.x.to_bits(), body.y.to_bits()],
                position,
                "{name}: {kind} {i}"
            );
            if kind == "agent" {
                assert_eq!(
                    body.state,
                    end["states"][i].as_str().unwrap(),
                    "{name}: agent {i}"
                );
            }
        }
    }
    assert_eq!(
        simulation.fitness().to_bits(),
        end["fitness"].as_f64().unwrap().to_bits(),
        "{name}: fitness"
    );
}

#[test]
fn episodes_agree_step_by_step() {
    let vectors = vectors();
    let mut simulation = create("minisim").unwrap();
    for case in vectors["episodes"].as_array().unwrap() {
        let name = case["name"].as_str().unwrap();
        simulation
            .reset(parameters(case))
            .unwrap_or_else(|e| panic!("{name}: {e}"));
        for (i, step) in case["steps"].as_array().unwrap().iter().enumerate() {
            let acting: Vec<u32> = serde_json::from_value(step["acting"].clone()).unwrap();
            assert_eq!(simulation.acting(), acting, "{name}, step {i}");
            for (agent, expected) in acting.iter().zip(step["sensor_bits"].as_array().unwrap()) {
                let mut sensors = [f32::NAN; 4];
                simulation.sense(*agent, &mut sensors);
                let expected: Vec<u32> = expected.as_array().unwrap().iter().map(bits).collect();
                assert_eq!(
                    sensors.map(f32::to_bits).to_vec(),
                    expected,
                    "{name}, step {i}, agent {agent}"
                );
            }
            let actuators: Vec<f32> = step["actuator_bits"]
                .as_array()
                .unwrap()
                .iter()
                .map(|a| f32::from_bits(bits(a)))
                .collect();
            simulation.step(&actuators);
        }
        assert!(simulation.acting().is_empty(), "{name} has ended");
        assert_end(name, simulation.as_ref(), &case["end"]);
    }
}

#[test]
fn rollouts_agree() {
    let vectors = vectors();
    let cases = vectors["rollouts"].as_array().unwrap();
    assert!(cases.len() >= 10);
    for case in cases {
        let name = case["name"].as_str().unwrap();
        let specification: Specification =
            serde_json::from_value(case["controller"].clone()).unwrap();
        let controller = Controller::new(&specification);
        let mut simulation = create("minisim").unwrap();
        let fitness = rollout(simulation.as_mut(), parameters(case), &controller).unwrap();
        assert_eq!(fitness, case["end"]["fitness"].as_f64().unwrap(), "{name}");
        assert_end(name, simulation.as_ref(), &case["end"]);

        let mut episode =
            Episode::new(create("minisim").unwrap(), parameters(case), &controller).unwrap();
        let mut steps = 0;
        while !episode.done() {
            episode.step().unwrap();
            steps += 1;
        }
        assert_eq!(steps, case["end"]["steps"].as_u64().unwrap(), "{name}");
        assert_end(name, episode.simulation(), &case["end"]);
    }
}
