//! Machines with modules in Python: read and counted here, computed elsewhere.
#![allow(clippy::unwrap_used)] // helpers of tests

use serde_json::{Value, json};
use std::sync::Arc;
use swarmwright_controllers::{Architecture, Controller, ControllerError, KINDS, Specification};

fn machine() -> Value {
    json!({"version": 1, "kind": "python_modules", "sensors": 9, "actuators": 2, "states": 3, "transitions": 2,
        "behaviours": [
            {"name": "Spiral", "file": "spiral.py", "sha256": "5f", "parameters": {
                "growth": [0.001_000_000_047_497_451_3, 0.1, false], "turn": [1.0, 30.0, true]}},
            {"name": "stop", "parameters": {}}],
        "conditions": [{"name": "elapsed", "parameters": {"after": [1.0, 300.0, true]}}]})
}

fn architecture(document: &Value) -> Architecture {
    Architecture::from_json(&document.to_string()).unwrap()
}

#[test]
fn parameters_in_python_have_places_behind_those_of_the_engine() {
    let read = architecture(&machine());
    // Number of states; each with 4 + 2 weights and 2 transitions of 5 + 1.
    assert_eq!(read.weight_count(), 1 + 3 * (6 + 2 * 6));
    assert_eq!((read.sensors(), read.actuators()), (9, 2));
    let needed: Vec<_> = read.in_python().unwrap().needed().collect();
    let names: Vec<_> = needed
        .iter()
        .map(|one| (one.role, one.name, one.sha256))
        .collect();
    assert_eq!(
        names,
        [
            ("behaviour", "Spiral", Some("5f")),
            ("condition", "elapsed", None)
        ]
    );
    let mut own = machine();
    own["behaviours"][1]["file"] = "own.py".into();
    assert_eq!(
        architecture(&own).in_python().unwrap().needed().count(),
        3,
        "a class in a file is never the engine's"
    );
}

#[test]
fn it_is_written_as_it_is_read() {
    let mut document = machine();
    document["weights"] = vec![0.5; architecture(&machine()).weight_count()].into();
    let specification: Specification = serde_json::from_value(document.clone()).unwrap();
    assert_eq!(serde_json::to_value(&specification).unwrap(), document);
}

#[test]
fn it_is_not_computed_here() {
    assert!(!KINDS.contains(&"python_modules"));
    let read = Arc::new(architecture(&machine()));
    let weights = vec![0.0; read.weight_count()];
    let mut controller = Controller::with_weights(&read, weights.into()).unwrap();
    let mut actuators = [0.5; 2];
    assert_eq!(
        controller.step(&[0.0; 9], &mut actuators),
        Err(ControllerError::InPython)
    );
    assert_eq!(actuators, [0.5; 2]);
}

#[test]
fn what_is_wrong_is_named() {
    for (change, message) in [
        (
            json!({"behaviours": []}),
            "controller.behaviours: 0 found, expected 1 to 256",
        ),
        (
            json!({"conditions": [{"name": "x"}]}),
            "controller.conditions: ",
        ),
        (
            json!({"conditions": [{"name": "x", "parameters": {}, "code": "y"}]}),
            "controller.conditions: ",
        ),
        (json!({"states": 17}), "controller.states: 17 found"),
        (
            json!({"form": "tree"}),
            "controller.transitions: 2 found, expected 1",
        ),
    ] {
        let mut document = machine();
        let fields = change.as_object().unwrap().clone();
        document.as_object_mut().unwrap().extend(fields);
        let error = Architecture::from_json(&document.to_string()).unwrap_err();
        assert!(error.to_string().starts_with(message), "{error}");
    }
    let team = json!({"version": 1, "kind": "team", "groups": [{"name": "all", "agents": null, "controller": machine()}]});
    let error = Architecture::from_json(&team.to_string()).unwrap_err();
    assert!(error.to_string().contains("python_modules"), "{error}");
}
