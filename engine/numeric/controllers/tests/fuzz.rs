//! Arbitrary text as a controller's specification: it is refused with a reason or read, without much memory, and
//! what is read computes.
#![allow(clippy::unwrap_used, clippy::panic)] // helpers of tests

use std::fs;
use std::path::PathBuf;

use proptest::prelude::*;
use serde_json::Value;
use swarmwright_controllers::{Architecture, Controller, Specification};
use swarmwright_fuzzing::{Counting, config, mutated, noise, peak};

#[global_allocator]
static MEMORY: Counting = Counting;

/// Bytes for each byte of text, and what a specification of a few bytes may need.
const BYTES_PER_BYTE: usize = 200;
const BYTES_AT_LEAST: usize = 1 << 16;

/// All specifications in the golden vectors.
fn golden() -> Vec<Vec<u8>> {
    fn look(value: &Value, specifications: &mut Vec<Vec<u8>>) {
        match value {
            Value::Object(fields) => {
                if fields.contains_key("version") && fields.contains_key("kind") {
                    specifications.push(value.to_string().into_bytes());
                }
                fields
                    .values()
                    .for_each(|inner| look(inner, specifications));
            }
            Value::Array(items) => items.iter().for_each(|inner| look(inner, specifications)),
            _ => {}
        }
    }
    let path = "../../../protocol/vectors/controllers.json";
    let text = fs::read_to_string(PathBuf::from(env!("CARGO_MANIFEST_DIR")).join(path)).unwrap();
    let mut specifications = Vec::new();
    look(&serde_json::from_str(&text).unwrap(), &mut specifications);
    specifications.retain(|text| text.len() < 4000);
    assert!(specifications.len() > 20, "{}", specifications.len());
    specifications
}

fn check(payload: &[u8]) {
    let Ok(text) = std::str::from_utf8(payload) else {
        return;
    };
    let most = BYTES_AT_LEAST + BYTES_PER_BYTE * text.len();
    let (architecture, bytes) = peak(|| Architecture::from_json(text));
    assert!(bytes <= most, "{bytes} bytes for {} of text", text.len());
    match &architecture {
        Ok(read) => assert!(read.weight_count() > 0, "{read:?}"),
        Err(error) => assert!(error.to_string().len() > 10, "{error:?}"),
    }
    let (specification, bytes) = peak(|| Specification::from_json(text));
    assert!(bytes <= most, "{bytes} bytes for {} of text", text.len());
    let Ok(specification) = specification else {
        return;
    };
    assert_eq!(
        Ok(specification.architecture().weight_count()),
        architecture.map(|read| read.weight_count())
    );
    assert_eq!(specification.weights().len(), specification.weight_count());
    let mut controller = Controller::new(&specification);
    let mut actuators = vec![0.0; controller.actuators()];
    let sensors = vec![0.5; controller.sensors()];
    if controller.steers() {
        controller.step(&sensors, &mut actuators).unwrap();
    } else {
        assert!(controller.step(&sensors, &mut actuators).is_err());
        controller.parameters();
    }
}

proptest! {
    #![proptest_config(config())]

    #[test]
    fn specifications_that_are_nearly_right(payload in mutated(golden())) {
        check(&payload);
    }

    #[test]
    fn what_is_never_right(payload in noise()) {
        check(&payload);
    }
}
