//! Minisim's own steering: computed by hand, by itself, and the same however it is evaluated.
#![allow(clippy::unwrap_used, clippy::panic)] // helpers of tests

use proptest::prelude::*;
use serde_json::{Map, Value, json};
use swarmwright_controllers::{Architecture, Controller, Specification};
use swarmwright_lanes::Level;
use swarmwright_worlds::{Block, Means, Minisim, RolloutError, Simulation, evaluate, rollout};

fn object(value: &Value) -> Map<String, Value> {
    value.as_object().unwrap().clone()
}

/// Where the agents are, after each step until the end.
fn tracks(parameters: &Value) -> Vec<Vec<[f32; 2]>> {
    let mut simulation = Minisim::default();
    simulation.reset(&object(parameters)).unwrap();
    let mut tracks = Vec::new();
    while !simulation.done() {
        assert_eq!(simulation.acting(), &[] as &[u32]);
        simulation.step(&[]);
        let scene = simulation.scene().unwrap();
        let agents = scene.bodies.iter().filter(|body| body.kind == "agent");
        tracks.push(agents.map(|body| [body.x, body.y]).collect());
    }
    tracks
}

#[test]
fn an_agent_goes_straight_to_the_goal() {
    let found = tracks(
        &json!({"steering": "rule", "numDefenders": 0, "goal": [3.5, 7.5], "mapHeight": 9,
        "agents": [[0.5, 3.5]], "speedAgents": 2.5}),
    );
    // The way is 3, 4, 5 long.
    assert_eq!(found, [vec![[2.0, 5.5]], vec![[3.5, 7.5]]]);
}

#[test]
fn an_agent_evades_the_closest_defender() {
    let world = |evasion: &str, avoidance: f32| {
        json!({"steering": "rule", "evasion": evasion, "avoidance": avoidance, "avoidanceRadius": 4,
            "agents": [[5, 3]], "defenders": [[7, 3], [7, 3.5]], "goal": [12, 3], "speedDefenders": 0, "maxSteps": 1})
    };
    // Half way into the radius, so that a weight of 2 counts 1.
    assert_eq!(tracks(&world("away", 1.0))[0], [[6.0, 3.0]]);
    assert_eq!(tracks(&world("away", 2.0))[0], [[5.0, 3.0]]);
    assert_eq!(tracks(&world("away", 4.0))[0], [[4.0, 3.0]]);
    let n = 2.0_f32.sqrt();
    assert_eq!(
        tracks(&world("left", 2.0))[0],
        [[5.0 + 1.0 / n, 3.0 + 1.0 / n]]
    );
    assert_eq!(
        tracks(&world("right", 2.0))[0],
        [[5.0 + 1.0 / n, 3.0 - 1.0 / n]]
    );
    let mut far = world("left", 2.0);
    far["avoidanceRadius"] = json!(2);
    assert_eq!(tracks(&far)[0], [[6.0, 3.0]]);
}

#[test]
fn an_agent_at_its_goal_or_on_a_defender_has_a_way() {
    let found = tracks(
        &json!({"steering": "rule", "agents": [[5, 3], [2, 2]], "defenders": [[2, 2]], "goal": [5, 3],
        "goalRadius": 0, "captureRadius": 0, "speedAgents": 0.5, "maxSteps": 1}),
    );
    assert_eq!(found[0][0], [5.0, 3.0]);
    assert!(found[0][1].iter().all(|number| number.is_finite()));
}

#[test]
fn what_is_no_rule_is_refused() {
    for (name, value) in [
        ("steering", json!("hand")),
        ("evasion", json!("up")),
        ("avoidance", json!(-1)),
        ("avoidanceRadius", json!("2")),
    ] {
        let mut parameters = Map::new();
        parameters.insert(name.to_owned(), value);
        let error = Minisim::default().reset(&parameters).unwrap_err();
        assert_eq!(error.name, name);
    }
}

fn set() -> Value {
    json!({"version": 1, "kind": "parameter_set", "parameters": [
        {"name": "avoidance", "type": "real"},
        {"name": "avoidanceRadius", "type": "real"},
        {"name": "evasion", "type": "categorical", "choices": ["away", "left", "right"]},
        {"name": "maxSteps", "type": "integer"}]})
}

fn controller(weights: &[f32]) -> Controller {
    let mut document = set();
    document["weights"] = json!(weights);
    Controller::new(&Specification::from_json(&document.to_string()).unwrap())
}

#[test]
fn a_parameter_set_where_agents_wait_is_an_error_that_says_what_to_do() {
    let mut simulation = Minisim::default();
    let error = rollout(
        &mut simulation,
        &Map::new(),
        &controller(&[1.0, 2.0, 0.0, 15.0]),
    )
    .unwrap_err();
    assert!(
        matches!(error, RolloutError::NotSteered { agent: 0, .. }),
        "{error}"
    );
    assert!(error.to_string().contains("steering: rule"), "{error}");
}

#[test]
fn a_controller_has_nothing_to_say_to_agents_that_steer_themselves() {
    let document = json!({"version": 1, "kind": "layered", "sensors": 4, "actuators": 1, "hidden": [],
        "activation": "tanh", "output_range": [-1, 1], "weights": [1, 2, 3, 4, 5]});
    let layered = Controller::new(&Specification::from_json(&document.to_string()).unwrap());
    let parameters = object(&json!({"steering": "rule", "evasion": "left"}));
    let mut simulation = Minisim::default();
    let found = rollout(&mut simulation, &parameters, &layered).unwrap();
    let expected = rollout(
        &mut simulation,
        &parameters,
        &controller(&[1.0, 2.0, 1.0, 15.0]),
    )
    .unwrap();
    assert_eq!(found.to_bits(), expected.to_bits());
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(32))]

    #[test]
    fn every_candidate_has_its_own_parameters(
        candidates in prop::collection::vec((0.0f32..5.0, 0.0f32..6.0, 0u8..3, 1u8..30), 1..20),
        agents in 1u32..5, defenders in 0u32..5, seeds in prop::collection::vec(any::<u64>(), 1..4),
    ) {
        let architecture = Architecture::from_json(&set().to_string()).unwrap();
        let parameters = object(&json!({"steering": "rule", "placement": "random", "numAgents": agents,
            "numDefenders": defenders}));
        let genomes: Vec<[f32; 4]> = candidates
            .iter()
            .map(|(avoidance, radius, evasion, steps)| [*avoidance, *radius, f32::from(*evasion), f32::from(*steps)])
            .collect();
        let block = Block { architecture: &architecture, genomes: genomes.as_flattened(), parameters: &parameters, seeds: &seeds, metrics: &[], stop: None };
        let mut expected = Vec::new();
        for genome in &genomes {
            for seed in &seeds {
                // The values by hand, and a controller that is never asked.
                let mut own = parameters.clone();
                own.extend(object(&json!({"seed": seed, "avoidance": genome[0], "avoidanceRadius": genome[1],
                    "evasion": (["away", "left", "right"][genome[2] as usize]), "maxSteps": genome[3]})));
                let mut simulation = Minisim::default();
                simulation.reset(&own).unwrap();
                while !simulation.done() {
                    simulation.step(&[]);
                }
                expected.push(simulation.fitness().to_bits());
            }
        }
        for level in [None, Some(Level::best())] {
            for threads in [1, 2] {
                let found = evaluate("minisim", &block, Means { level, threads }).unwrap().unwrap();
                let found: Vec<u64> = found.iter().map(|value| value.to_bits()).collect();
                prop_assert_eq!(&found, &expected);
            }
        }
    }
}
