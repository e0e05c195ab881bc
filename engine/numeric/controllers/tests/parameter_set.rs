//! Parameter sets: what weights mean, and that they steer no agents.
#![allow(clippy::unwrap_used, clippy::panic)] // helpers of tests

use serde_json::{Value, json};
use swarmwright_controllers::{Architecture, Controller, ControllerError, Specification};

fn set(weights: &[f32]) -> Value {
    json!({"version": 1, "kind": "parameter_set", "parameters": [
        {"name": "avoidance", "type": "real"},
        {"name": "hops", "type": "integer"},
        {"name": "strategy", "type": "categorical", "choices": ["a", "b"]}], "weights": weights})
}

fn controller(weights: &[f32]) -> Controller {
    Controller::new(&Specification::from_json(&set(weights).to_string()).unwrap())
}

/// protocol/vectors/controllers.json: specifications, the parameters of an experiment, and those of an episode.
#[test]
fn parameters_are_merged_as_the_vectors_say() {
    let path = concat!(
        env!("CARGO_MANIFEST_DIR"),
        "/../../../protocol/vectors/controllers.json"
    );
    let vectors: Value = serde_json::from_str(&std::fs::read_to_string(path).unwrap()).unwrap();
    let cases = vectors["parameter_sets"].as_array().unwrap();
    assert!(cases.len() >= 5);
    for case in cases {
        let specification = Specification::from_json(&case["specification"].to_string()).unwrap();
        let written = serde_json::to_string(&specification).unwrap();
        assert_eq!(written.parse::<Specification>().unwrap(), specification);
        let parameters = case["parameters"].as_object().unwrap();
        let merged = Controller::new(&specification)
            .merged(parameters)
            .into_owned();
        assert_eq!(Value::from(merged), case["merged"], "{}", case["name"]);
    }
}

#[test]
fn it_has_values_and_steers_nobody() {
    let mut controller = controller(&[0.33, 7.0, 1.0]);
    let values = controller.parameters();
    assert_eq!(
        Value::from(values.clone()),
        json!({"avoidance": 0.33, "hops": 7, "strategy": "b"})
    );
    assert_eq!(
        Value::from(values).to_string(),
        r#"{"avoidance":0.33,"hops":7,"strategy":"b"}"#
    );
    assert_eq!((controller.sensors(), controller.actuators()), (0, 0));
    assert!(!controller.steers());
    assert_eq!(
        controller.step(&[], &mut []),
        Err(ControllerError::SteersNoAgents)
    );
}

#[test]
fn its_values_count_before_others() {
    let mut given = json!({"hops": 1, "maxSteps": 15})
        .as_object()
        .unwrap()
        .clone();
    let merged = controller(&[1.0, 2.0, 0.0]).merged(&given).into_owned();
    given.extend(controller(&[1.0, 2.0, 0.0]).parameters());
    assert_eq!(merged, given);
    assert_eq!(merged["hops"], json!(2));
}

#[test]
fn refuses_with_the_parameter_and_the_cure() {
    let cases: [(Value, &[&str]); 9] = [
        (json!([]), &["controller.parameters: 0 found"]),
        (
            json!({}),
            &["controller.parameters: {} found", "a list of parameters"],
        ),
        (
            json!([{"name": "a"}]),
            &["controller.parameters[0]: missing field `type`"],
        ),
        (
            json!([{"name": "a", "type": "text"}]),
            &[
                "controller.parameters[0]: type: \"text\" found",
                "real, integer, categorical",
            ],
        ),
        (
            json!([{"name": "a", "type": "categorical"}]),
            &["controller.parameters[0]: choices: expected"],
        ),
        (
            json!([{"name": "a", "type": "real", "choices": ["b"]}]),
            &["controller.parameters[0]: choices: only allowed for the type categorical"],
        ),
        (
            json!([{"name": "seed", "type": "real"}]),
            &["controller.parameters[0]: \"seed\" cannot be the name"],
        ),
        (
            json!([{"name": "a", "type": "real"}, {"name": "a", "type": "integer"}]),
            &["controller.parameters[1]: \"a\" is given twice"],
        ),
        (
            json!([{"name": "a", "type": "real", "range": [0, 1]}]),
            &["controller.parameters[0]: unknown field `range`"],
        ),
    ];
    for (parameters, parts) in cases {
        let mut document = set(&[]);
        document["parameters"] = parameters;
        let message = Architecture::from_json(&document.to_string())
            .unwrap_err()
            .to_string();
        for part in parts {
            assert!(message.contains(part), "{message:?} lacks {part:?}");
        }
    }
    let few = Specification::from_json(&set(&[1.0]).to_string()).unwrap_err();
    assert!(few.to_string().contains("needs 3"), "{few}");
}
