//! State, refusals and bounds of a controller.
#![allow(clippy::unwrap_used, clippy::panic)] // helpers of tests

use proptest::prelude::*;
use serde_json::json;
use std::sync::Arc;
use swarmwright_controllers::{Controller, ControllerError, Specification};

const LAYERED: [&str; 5] = ["tanh", "sigmoid", "relu", "clamp", "linear"];

fn meshed(weights: &[f32]) -> Specification {
    let document = json!({"version": 1, "kind": "fully_meshed", "sensors": 2, "actuators": 1, "hidden": 2,
        "activation": "tanh", "iterations": 2, "output_range": [-1, 1], "weights": weights});
    Specification::from_json(&document.to_string()).unwrap()
}

fn layered(activation: &str, weights: &[f32]) -> Specification {
    let document = json!({"version": 1, "kind": "layered", "sensors": 2, "actuators": 1, "hidden": [3],
        "activation": activation, "output_range": [-1, 1], "weights": weights});
    Specification::from_json(&document.to_string()).unwrap()
}

fn run(controller: &mut Controller, sensors: &[[f32; 2]]) -> Vec<u32> {
    let mut actuators = [f32::NAN];
    let step = |s: &[f32; 2]| {
        controller.step(s, &mut actuators).unwrap();
        actuators[0].to_bits()
    };
    sensors.iter().map(step).collect()
}

fn readings() -> impl Strategy<Value = Vec<[f32; 2]>> {
    prop::collection::vec(prop::array::uniform2(-1.0_f32..1.0), 2..8)
}

proptest! {
    #[test]
    fn a_reset_forgets_everything(
        weights in prop::collection::vec(-2.0_f32..2.0, 18),
        before in readings(),
        after in readings(),
    ) {
        let mut fresh = Controller::new(&meshed(&weights));
        let mut used = fresh.clone();
        run(&mut used, &before);
        used.reset();
        prop_assert_eq!(run(&mut used, &after), run(&mut fresh, &after));
    }

    #[test]
    fn clones_have_states_of_their_own(
        weights in prop::collection::vec(-2.0_f32..2.0, 18),
        a in readings(),
        b in readings(),
    ) {
        let origin = Controller::new(&meshed(&weights));
        let alone = run(&mut origin.clone(), &a);
        let (mut one, mut two) = (origin.clone(), origin.clone());
        let mut woven = Vec::new();
        for (i, s) in a.iter().enumerate() {
            woven.extend(run(&mut one, &[*s]));
            if let Some(s) = b.get(i) {
                run(&mut two, &[*s]);
            }
        }
        prop_assert_eq!(woven, alone);
    }

    #[test]
    fn actuators_are_bounded_whatever_the_weights(
        weights in prop::collection::vec(any::<f32>().prop_filter("finite", |w| w.is_finite()), 13),
        sensors in prop::array::uniform2(any::<f32>().prop_filter("finite", |s| s.is_finite())),
        activation in 0..LAYERED.len(),
    ) {
        let mut controller = Controller::new(&layered(LAYERED[activation], &weights));
        let mut actuators = [f32::NAN];
        controller.step(&sensors, &mut actuators).unwrap();
        prop_assert!((-1.0..=1.0).contains(&actuators[0]), "{}", actuators[0]);
    }
}

#[test]
fn a_meshed_network_remembers() {
    let weights: Vec<f32> = (0..18).map(|i| (i as f32 * 0.7).sin()).collect();
    let bits = run(&mut Controller::new(&meshed(&weights)), &[[0.3, -0.4]; 2]);
    assert_ne!(bits[0], bits[1]);
}

#[test]
fn a_hand_computed_network() {
    // hidden: 1 + 2*0.5 + 3*(-1) = -1 -> 0; output: 0.25 + 4*0 = 0.25 -> 2*0.25 - 1
    let document = json!({"version": 1, "kind": "layered", "sensors": 2, "actuators": 1, "hidden": [1],
        "activation": "clamp", "output_range": [0, 1], "weights": [1, 2, 3, 0.25, 4]});
    let mut controller = Controller::new(&Specification::from_json(&document.to_string()).unwrap());
    let mut actuators = [9.0];
    controller.step(&[0.5, -1.0], &mut actuators).unwrap();
    assert_eq!(actuators, [-0.5]);
}

#[test]
fn refusals_leave_the_state_alone() {
    let weights: Vec<f32> = (0..18).map(|i| (i as f32).cos()).collect();
    let mut controller = Controller::new(&meshed(&weights));
    let expected = run(&mut controller.clone(), &[[0.1, 0.2], [0.3, 0.4]]);
    let mut found = run(&mut controller, &[[0.1, 0.2]]);
    let mut one = [0.0];
    assert_eq!(
        controller.step(&[0.1], &mut one),
        Err(ControllerError::SensorCount {
            expected: 2,
            actual: 1
        })
    );
    assert_eq!(
        controller.step(&[0.1, f32::NAN], &mut one),
        Err(ControllerError::SensorValue { index: 1 })
    );
    assert_eq!(
        controller.step(&[f32::INFINITY, 0.0], &mut one),
        Err(ControllerError::SensorValue { index: 0 })
    );
    assert_eq!(
        controller.step(&[0.1, 0.2], &mut [0.0; 2]),
        Err(ControllerError::ActuatorCount {
            expected: 1,
            actual: 2
        })
    );
    found.extend(run(&mut controller, &[[0.3, 0.4]]));
    assert_eq!(found, expected);
}

#[test]
fn weights_from_elsewhere_are_checked() {
    let specification = meshed(&[0.5; 18]);
    let architecture = Arc::new(specification.architecture().clone());
    let built = Controller::with_weights(&architecture, [0.5; 18].into()).unwrap();
    let sensors = [[0.1, 0.2]];
    assert_eq!(
        run(&mut built.clone(), &sensors),
        run(&mut Controller::new(&specification), &sensors)
    );
    let count = Controller::with_weights(&architecture, [0.5; 17].into()).unwrap_err();
    assert_eq!(
        count,
        ControllerError::WeightCount {
            expected: 18,
            actual: 17
        }
    );
    let mut bad = [0.5; 18];
    bad[4] = f32::NAN;
    let value = Controller::with_weights(&architecture, bad.into()).unwrap_err();
    assert_eq!(value, ControllerError::WeightValue { index: 4 });
}

/// Two sensors, the first cut in three, the second in two; every row has a number of its own.
fn machine() -> Specification {
    let weights: Vec<f32> = (0..12u8)
        .flat_map(|row| [f32::from(row % 2), f32::from(row) / 16.0])
        .collect();
    let document = json!({"version": 1, "kind": "mealy_fsm", "sensors": 2, "actuators": 1, "states": 2,
        "thresholds": [[-0.5, 0.5], [0]], "weights": weights});
    Specification::from_json(&document.to_string()).unwrap()
}

#[test]
fn a_machine_goes_from_state_to_state() {
    let mut controller = Controller::new(&machine());
    let mut row = |sensors: [f32; 2]| {
        let mut actuators = [f32::NAN];
        controller.step(&sensors, &mut actuators).unwrap();
        actuators[0] * 16.0
    };
    // State 0: rows 0 to 5, of which the odd ones lead to state 1.
    assert_eq!(row([-1.0, -1.0]), 0.0);
    assert_eq!(row([0.0, -1.0]), 2.0);
    assert_eq!(row([0.0, 0.1]), 3.0);
    // State 1: a sensor that equals a threshold is below it.
    assert_eq!(row([-0.5, 0.0]), 6.0);
    assert_eq!(row([0.6, 1e30]), 5.0);
    assert_eq!(row([0.5, 1.0]), 9.0);
    assert_eq!(row([0.5, -1.0]), 8.0);
    controller.reset();
    assert_eq!(
        run(&mut controller, &[[1.0, 1.0]]),
        [(5.0f32 / 16.0).to_bits()]
    );
}

#[test]
fn any_finite_table_is_a_machine() {
    let document = json!({"version": 1, "kind": "mealy_fsm", "sensors": 1, "actuators": 1, "states": 3,
        "thresholds": [[0]], "weights": [1.9, 0.1, -7, 0.2, 1e30, 0.3, 0.99, 0.4, -0.5, 3, 2, -1e38]});
    let mut controller = Controller::new(&Specification::from_json(&document.to_string()).unwrap());
    let mut actuators = [f32::NAN];
    let found: Vec<f32> = [-1.0, -1.0, -1.0, 1.0, 1.0]
        .iter()
        .map(|sensor| {
            controller.step(&[*sensor], &mut actuators).unwrap();
            actuators[0]
        })
        .collect();
    // 1.9 is state 1, 1e30 the last one, -0.5 the first.
    assert_eq!(found, [0.1, 0.3, 1.0, 0.2, 0.2]);
    controller.reset();
    for (sensor, expected) in [(-1.0, 0.1), (-1.0, 0.3), (1.0, -1.0), (1.0, -1.0)] {
        controller.step(&[sensor], &mut actuators).unwrap();
        assert_eq!(actuators, [expected]);
    }
}
