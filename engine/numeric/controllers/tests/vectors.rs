//! Replays protocol/vectors/controllers.json, which an independent implementation computed.
#![allow(clippy::unwrap_used, clippy::panic)] // helpers of tests

use serde_json::Value;
use swarmwright_controllers::{Controller, Specification, functions};

fn vectors() -> Value {
    let path = concat!(
        env!("CARGO_MANIFEST_DIR"),
        "/../../../protocol/vectors/controllers.json"
    );
    serde_json::from_str(&std::fs::read_to_string(path).unwrap()).unwrap()
}

fn bits(value: &Value) -> u32 {
    u32::from_str_radix(value.as_str().unwrap(), 16).unwrap()
}

/// C99 hexadecimal float, exact in binary64 for every binary32.
fn hexfloat(value: &Value) -> f64 {
    let text = value.as_str().unwrap();
    let (sign, text) = text
        .strip_prefix('-')
        .map_or((1.0, text), |rest| (-1.0, rest));
    let (mantissa, exponent) = text.strip_prefix("0x").unwrap().split_once('p').unwrap();
    let (whole, fraction) = mantissa.split_once('.').unwrap_or((mantissa, ""));
    let digits = u64::from_str_radix(&format!("{whole}{fraction}"), 16).unwrap();
    let exponent = exponent.parse::<i32>().unwrap() - 4 * i32::try_from(fraction.len()).unwrap();
    sign * digits as f64 * 2.0_f64.powi(exponent)
}

/// The number that a hexadecimal float and a bit pattern both say.
fn number(hex: &Value, pattern: &Value) -> f32 {
    let value = f32::from_bits(bits(pattern));
    assert_eq!(
        f64::from(value),
        hexfloat(hex),
        "{hex} and {pattern} are two numbers"
    );
    value
}

fn numbers(step: &Value, hex: &str, pattern: &str) -> Vec<f32> {
    let (hex, pattern) = (
        step[hex].as_array().unwrap(),
        step[pattern].as_array().unwrap(),
    );
    assert_eq!(hex.len(), pattern.len());
    hex.iter().zip(pattern).map(|(h, p)| number(h, p)).collect()
}

#[test]
fn functions_agree() {
    let vectors = vectors();
    let rows = vectors["functions"].as_object().unwrap();
    assert_eq!(rows.len(), 4);
    for (name, rows) in rows {
        let function = match name.as_str() {
            "tanh" => functions::tanh,
            "sigmoid" => functions::sigmoid,
            "sin_pi" => functions::sin_pi,
            "cos_pi" => functions::cos_pi,
            other => panic!("unknown function {other}"),
        };
        let rows = rows.as_array().unwrap();
        assert!(rows.len() >= 200, "{name}: {} points", rows.len());
        for row in rows {
            let (x, y) = (number(&row[0], &row[1]), number(&row[2], &row[3]));
            assert_eq!(function(x).to_bits(), y.to_bits(), "{name}({x:?})");
        }
    }
}

#[test]
fn controllers_agree() {
    let vectors = vectors();
    let cases = vectors["controllers"].as_array().unwrap();
    assert!(cases.len() >= 50, "{} controllers", cases.len());
    for case in cases {
        let name = case["name"].as_str().unwrap();
        let text = case["specification"].to_string();
        let specification =
            Specification::from_json(&text).unwrap_or_else(|e| panic!("{name}: {e}"));
        let written = serde_json::to_string(&specification).unwrap();
        assert_eq!(
            written.parse::<Specification>().unwrap(),
            specification,
            "{name}: written and read"
        );
        let mut controller = Controller::new(&specification);
        let mut actuators = vec![f32::NAN; controller.actuators()];
        for (i, step) in case["steps"].as_array().unwrap().iter().enumerate() {
            if step["reset"].as_bool().unwrap() {
                controller.reset();
            }
            controller
                .step(&numbers(step, "sensors", "sensor_bits"), &mut actuators)
                .unwrap();
            let expected: Vec<u32> = numbers(step, "actuators", "actuator_bits")
                .iter()
                .map(|v| v.to_bits())
                .collect();
            let found: Vec<u32> = actuators.iter().map(|v| v.to_bits()).collect();
            assert_eq!(found, expected, "{name}, step {i}");
        }
    }
}
