//! The list of kinds against the schema, which the tests of Python and Java compare theirs with, and the golden vectors.
#![allow(clippy::unwrap_used)] // helpers of tests

use serde_json::{Value, json};
use std::collections::BTreeSet;
use swarmwright_controllers::{KINDS, Specification};

fn protocol(file: &str) -> Value {
    let path = format!("{}/../../../protocol/{file}", env!("CARGO_MANIFEST_DIR"));
    serde_json::from_str(&std::fs::read_to_string(path).unwrap()).unwrap()
}

/// The specifications in the golden vectors.
fn golden() -> Vec<Value> {
    let vectors = protocol("vectors/controllers.json");
    let cases = ["controllers", "parameter_sets"].map(|list| vectors[list].clone());
    let cases = cases
        .iter()
        .flat_map(|cases| cases.as_array().unwrap().clone());
    cases.map(|case| case["specification"].clone()).collect()
}

#[test]
fn the_schema_has_the_same_kinds_in_the_same_order() {
    let schema = protocol("schemas/controller.schema.json");
    let titles = schema["oneOf"].as_array().unwrap().iter().map(|kind| {
        let reference = kind["$ref"].as_str().unwrap();
        reference.rsplit('/').next().unwrap().to_owned()
    });
    let mut titles: Vec<_> = titles.collect();
    assert_eq!(titles.pop().unwrap(), "team"); // controllers of these kinds, for groups of agents
    assert_eq!(titles, KINDS);
}

#[test]
fn an_unknown_kind_is_refused_with_all_kinds() {
    let unknown = json!({"version": 1, "kind": "spiking"}).to_string();
    let message = Specification::from_json(&unknown).unwrap_err().to_string();
    for kind in KINDS {
        assert!(message.contains(&format!("{kind:?}")), "{message}");
    }
}

#[test]
fn every_kind_has_golden_vectors_and_is_written_as_it_is_read() {
    let mut seen = BTreeSet::new();
    for document in golden() {
        let specification: Specification = serde_json::from_value(document.clone()).unwrap();
        let written = serde_json::to_value(&specification).unwrap();
        assert_eq!(written["kind"], document["kind"]);
        seen.insert(document["kind"].as_str().unwrap().to_owned());
    }
    assert_eq!(seen, KINDS.iter().map(ToString::to_string).collect());
}

/// For each kind: what is missing, and what is too much, is named.
#[test]
fn missing_and_unknown_fields_are_named_for_every_kind() {
    for kind in KINDS {
        let mut documents = golden().into_iter();
        let document = documents.find(|one| one["kind"] == *kind).unwrap();
        for field in document.as_object().unwrap().keys() {
            let mut less = document.clone();
            less.as_object_mut().unwrap().remove(field);
            let message = Specification::from_json(&less.to_string())
                .unwrap_err()
                .to_string();
            let expected = format!("controller.{field}: is missing; expected");
            assert!(message.starts_with(&expected), "{message}");
        }
        let mut more = document.clone();
        more["spikes"] = json!(1);
        let message = Specification::from_json(&more.to_string())
            .unwrap_err()
            .to_string();
        assert!(
            message.starts_with("controller.spikes: is unknown; expected one of version, kind, "),
            "{message}"
        );
        for field in document.as_object().unwrap().keys() {
            assert!(message.contains(field.as_str()), "{message}");
        }
    }
}
