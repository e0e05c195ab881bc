//! What is refused, and how it is said.
#![allow(clippy::unwrap_used, clippy::panic)] // helpers of tests

use serde_json::{Value, json};
use swarmwright_controllers::{Architecture, KINDS, Specification};

fn layered() -> Value {
    json!({"version": 1, "kind": "layered", "sensors": 2, "actuators": 1, "hidden": [3], "activation": "tanh",
        "output_range": [-1, 1], "weights": vec![0.5; 13]})
}

fn meshed() -> Value {
    json!({"version": 1, "kind": "fully_meshed", "sensors": 2, "actuators": 1, "hidden": 2, "activation": "clamp",
        "iterations": 2, "output_range": [0, 1], "weights": vec![0.25; 18]})
}

fn machine() -> Value {
    json!({"version": 1, "kind": "mealy_fsm", "sensors": 2, "actuators": 1, "states": 3, "thresholds": [[-0.5, 0.5], [0]],
        "weights": vec![0.25; 36]})
}

fn evostick() -> Value {
    json!({"version": 1, "kind": "evostick", "sensors": 24, "actuators": 2, "weights": vec![0.5; 50]})
}

fn hebbian() -> Value {
    json!({"version": 1, "kind": "hebbian", "sensors": 2, "actuators": 1, "hidden": 2, "iterations": 2,
        "weights": vec![0.25; 19]})
}

fn neat() -> Value {
    json!({"version": 1, "kind": "neat", "sensors": 2, "actuators": 1, "sources": [[0, 2], [0, 1, 1, 2]],
        "iterations": 3, "weights": vec![0.25; 9]})
}

fn growing() -> Value {
    json!({"version": 1, "kind": "growing", "sensors": 2, "actuators": 1, "nodes": 2, "connections": 4,
        "recurrent": false, "output_activation": "steep_sigmoid", "output_range": [0, 1], "weights": vec![0.25; 20]})
}

fn refusal(text: &str) -> String {
    Specification::from_json(text).unwrap_err().to_string()
}

#[test]
fn accepts_and_counts() {
    for (document, count) in [
        (layered(), 13),
        (meshed(), 18),
        (machine(), 36),
        (evostick(), 50),
        (hebbian(), 19),
        (neat(), 9),
        (growing(), 20),
    ] {
        let specification = Specification::from_json(&document.to_string()).unwrap();
        assert_eq!(specification.weight_count(), count);
        assert_eq!(
            serde_json::from_value::<Specification>(document.clone()).unwrap(),
            specification
        );
        let mut bare = document;
        bare.as_object_mut().unwrap().remove("weights");
        assert_eq!(
            Architecture::from_json(&bare.to_string()).unwrap(),
            *specification.architecture()
        );
    }
    let mut linear = layered();
    linear["output_activation"] = json!("linear");
    let read = Specification::from_json(&linear.to_string()).unwrap();
    assert_ne!(
        read,
        Specification::from_json(&layered().to_string()).unwrap()
    );
    assert_eq!(
        serde_json::to_value(&read).unwrap()["output_activation"],
        "linear"
    );
    let mut whole = layered();
    whole["sensors"] = json!(2.0);
    assert!(
        Specification::from_json(&whole.to_string()).is_ok(),
        "2.0 is a whole number"
    );
}

#[test]
fn weights_are_read_as_binary32() {
    // Read by way of binary64 this decimal, just above halfway between two binary32, would go to the even neighbour.
    let above_half = "1.00000005960464477540";
    let mut document = layered().to_string();
    document = document.replacen("0.5", above_half, 1);
    let specification = Specification::from_json(&document).unwrap();
    assert_eq!(specification.weights()[0].to_bits(), 1.0_f32.to_bits() + 1);
}

#[test]
fn refuses_with_the_field_and_the_cure() {
    let kinds = KINDS.iter().map(|kind| format!("{kind:?}"));
    let all_kinds = format!("{} or \"team\"", kinds.collect::<Vec<_>>().join(", "));
    let cases: [(Value, &str, Value, &[&str]); 40] = [
        (
            growing(),
            "recurrent",
            json!(1),
            &["controller.recurrent", "1 found, expected true or false"],
        ),
        (
            growing(),
            "output_activation",
            json!("steep"),
            &[
                "controller.output_activation",
                "expected one of steep_sigmoid, tanh",
            ],
        ),
        (
            neat(),
            "sources",
            json!([]),
            &[
                "controller.sources",
                "0 lists found, expected one for each hidden node and each of the 1",
            ],
        ),
        (
            neat(),
            "sources",
            json!([[0, 2], [0, 4]]),
            &[
                "controller.sources[1][1]",
                "4 found, expected a whole number from 0 to 3",
            ],
        ),
        (
            neat(),
            "sources",
            json!([[0], 7]),
            &["controller.sources", "a list of lists of whole numbers"],
        ),
        (
            neat(),
            "weights",
            json!([0.25]),
            &["controller.weights", "this controller needs 9"],
        ),
        (
            layered(),
            "version",
            json!(2),
            &["controller.version", "expected 1"],
        ),
        (
            layered(),
            "kind",
            json!("layerd"),
            &["controller.kind", "\"layerd\"", &all_kinds],
        ),
        (
            layered(),
            "kind",
            json!(7),
            &["controller.kind", "\"layered\", "],
        ),
        (
            layered(),
            "sensors",
            json!(0),
            &["controller.sensors", "from 1 to"],
        ),
        (
            layered(),
            "sensors",
            json!(-1),
            &["controller.sensors", "-1 found"],
        ),
        (
            layered(),
            "sensors",
            json!("2"),
            &["controller.sensors", "\"2\" found", "whole number"],
        ),
        (
            layered(),
            "sensors",
            json!(1.5),
            &["controller.sensors", "1.5 found"],
        ),
        (layered(), "sensors", json!(1e300), &["controller.sensors"]),
        (layered(), "actuators", json!(0), &["controller.actuators"]),
        (
            layered(),
            "output_activation",
            json!("softmax"),
            &[
                "controller.output_activation",
                "\"softmax\" found, expected one of tanh, sigmoid",
            ],
        ),
        (
            layered(),
            "hidden",
            json!(8),
            &["controller.hidden", "a list of whole numbers"],
        ),
        (
            layered(),
            "hidden",
            json!([3, 0]),
            &["controller.hidden[1]", "0 found"],
        ),
        (
            layered(),
            "hidden",
            json!([100_000, 100_000]),
            &["controller.hidden", "at most 1000000"],
        ),
        (
            layered(),
            "hidden",
            json!([1_000_000, 1_000_000, 1_000_000]),
            &["controller.hidden", "at most 1000000"],
        ),
        (
            layered(),
            "activation",
            json!("swish"),
            &[
                "controller.activation",
                "tanh, sigmoid, relu, clamp, linear",
            ],
        ),
        (
            layered(),
            "output_range",
            json!([1, 1]),
            &["controller.output_range", "low < high"],
        ),
        (
            layered(),
            "output_range",
            json!([1, -1]),
            &["controller.output_range"],
        ),
        (
            layered(),
            "output_range",
            json!([-3e38, 3e38]),
            &["controller.output_range"],
        ),
        (
            layered(),
            "output_range",
            json!([0, 1, 2]),
            &["controller.output_range", "[low, high]"],
        ),
        (
            layered(),
            "weights",
            json!([1, 2]),
            &["controller.weights", "2 numbers", "needs 13"],
        ),
        (
            layered(),
            "weights",
            json!([1, "2"]),
            &["controller.weights[1]", "\"2\" found"],
        ),
        (
            layered(),
            "weights",
            json!([1, null]),
            &["controller.weights[1]", "finite"],
        ),
        (
            layered(),
            "weights",
            json!([1, 1e39]),
            &["controller.weights[1]", "finite"],
        ),
        (
            layered(),
            "weights",
            json!({}),
            &["controller.weights", "13 numbers"],
        ),
        (
            layered(),
            "iterations",
            json!(2),
            &["controller.iterations", "is unknown", "output_range"],
        ),
        (
            meshed(),
            "iterations",
            json!(0),
            &["controller.iterations", "from 1 to 1000"],
        ),
        (
            meshed(),
            "activation",
            json!("linear"),
            &["controller.activation", "clamp, sigmoid, tanh, relu"],
        ),
        (
            machine(),
            "states",
            json!(0),
            &["controller.states", "from 1 to"],
        ),
        (
            machine(),
            "states",
            json!(200_000),
            &["controller.thresholds", "2400000 weights", "fewer states"],
        ),
        (
            machine(),
            "thresholds",
            json!([[0]]),
            &["controller.thresholds", "[[0]] found", "a list of 2 lists"],
        ),
        (
            machine(),
            "thresholds",
            json!([[0], "0"]),
            &["controller.thresholds", "ascending numbers"],
        ),
        (
            machine(),
            "thresholds",
            json!([[0], [0.5, 0.5]]),
            &["controller.thresholds[1]", "greater than the one before"],
        ),
        (
            machine(),
            "thresholds",
            json!([[0, 1e39], [0]]),
            &["controller.thresholds"],
        ),
        (
            machine(),
            "weights",
            json!([1, 2]),
            &["controller.weights", "2 numbers", "needs 36"],
        ),
    ];
    for (mut document, field, value, parts) in cases {
        document[field] = value.clone();
        let message = refusal(&document.to_string());
        for part in parts {
            assert!(
                message.contains(part),
                "{field} = {value}: {message:?} lacks {part:?}"
            );
        }
    }
}

#[test]
fn refuses_what_is_missing() {
    for document in [layered(), meshed(), machine()] {
        for field in document.as_object().unwrap().keys() {
            let mut less = document.clone();
            less.as_object_mut().unwrap().remove(field);
            let message = refusal(&less.to_string());
            assert!(
                message.starts_with(&format!("controller.{field}: is missing; expected")),
                "{message}"
            );
        }
    }
}

#[test]
fn refuses_text_that_is_no_object() {
    assert!(refusal("[1, 2]").contains("expected a JSON object"));
    assert!(refusal("{\"version\": 1,\n oops}").contains("line 2"));
    assert!(refusal("").contains("not JSON"));
    let nan = layered().to_string().replacen("0.5", "NaN", 1);
    assert!(refusal(&nan).contains("not JSON"));
    let deep = "[".repeat(1_000_000);
    assert!(refusal(&deep).contains("expected a JSON object"));
    let inside = format!("{deep}{}", "]".repeat(1_000_000));
    let nested = layered().to_string().replacen("[3]", &inside, 1);
    assert!(refusal(&nested).starts_with("controller"));
}
