//! Batteries of robots.
#![allow(clippy::unwrap_used)] // helpers of tests

use serde_json::{Value, json};
use swarmwright_kernels::Arena;
use swarmwright_simulation::Simulation;

/// Robots in a wide arena whose eastern half charges.
fn parameters(battery: &Value, start: &Value) -> Value {
    let robot = json!({
        "radius": 0.05, "battery": battery,
        "drive": {"kind": "differential", "wheel_base": 0.08, "max_speed": 0.2},
        "sensors": [{"kind": "battery"}, {"kind": "range_and_bearing", "range": 50, "gives": ["count"]}],
        "actuators": [{"kind": "led", "colors": ["green"]}],
    });
    let mission = json!({
        "walls": {"rectangle": [40, 40]}, "start": start, "fitness": "order",
        "floor": {"patches": [{"name": "east", "rectangle": {"x": [0, 20], "y": [-20, 20]}, "color": "white"}]},
    });
    json!({"mission": mission, "robot": robot, "robots": 2, "seed": 3})
}

fn arena(battery: &Value, start: &Value) -> Arena {
    let mut arena = Arena::default();
    let parameters = parameters(battery, start);
    arena.reset(parameters.as_object().unwrap()).unwrap();
    arena
}

fn west() -> Value {
    json!({"rectangle": {"x": [-10, -5], "y": [-5, 5]}})
}

fn east() -> Value {
    json!({"rectangle": {"x": [5, 10], "y": [-5, 5]}})
}

/// The charge, and how many are heard.
fn sensed(arena: &Arena) -> [f32; 2] {
    let mut numbers = [0.0; 2];
    arena.sense(0, &mut numbers);
    numbers
}

/// Where the first robot is, the colour that it shows, and how it fares.
fn first(arena: &Arena) -> ([f32; 2], [String; 2]) {
    let scene = arena.scene().unwrap();
    let of = |kind: &str| scene.bodies.iter().find(|body| body.kind == kind);
    let body = of("agent").unwrap();
    let led = of("led").map_or_else(String::new, |led| led.state.to_string());
    ([body.x, body.y], [led, body.state.to_string()])
}

#[track_caller]
fn close(a: f32, b: f32) {
    assert!((a - b).abs() < 1e-4, "{a}, {b}");
}

#[test]
fn a_battery_discharges_by_time_and_by_what_the_drive_is_told() {
    let battery = json!({"standing": 20, "driving": 10});
    for (wheels, lasts) in [
        ([0.0, 0.0], 20.0),
        ([1.0, 1.0], 10.0),
        ([-1.0, 1.0], 10.0),
        // A half of the effort: in the middle of the two rates.
        ([0.5, 0.5], 1.0 / 0.075),
        ([0.0, 1.0], 1.0 / 0.075),
    ] {
        let mut arena = arena(&battery, &west());
        close(sensed(&arena)[0], 1.0);
        let mut last = 1.0;
        for tick in 1..=250 {
            arena.step(&[wheels[0], wheels[1], 1.0].repeat(2));
            let charge = sensed(&arena)[0];
            let expected = 1.0 - tick as f32 / 10.0 / lasts;
            // Less than half of what a tick takes is nothing.
            let half = 0.05 / lasts;
            close(charge, if expected > half { expected } else { 0.0 });
            assert!(charge <= last);
            last = charge;
        }
        assert_eq!(last, 0.0);
    }
}

#[test]
fn a_battery_is_empty_after_its_time_to_the_tick() {
    for seconds in [1, 5, 6, 10, 20, 33, 100] {
        let mut arena = arena(&json!({"standing": seconds, "driving": seconds}), &west());
        let ticks = 10 * seconds;
        for tick in 1..=ticks {
            arena.step(&[0.5, 0.5, 1.0].repeat(2));
            assert_eq!(sensed(&arena)[0] > 0.0, tick < ticks, "{seconds} s: {tick}");
        }
    }
}

#[test]
fn a_robot_without_charge_stands_dark_and_is_not_heard() {
    let mut arena = arena(&json!({"standing": 4, "driving": 2}), &west());
    let told = [1.0, 1.0, 1.0].repeat(2);
    for tick in 0..60 {
        let (before, _) = first(&arena);
        let charge = sensed(&arena)[0];
        arena.step(&told);
        let (after, shows) = first(&arena);
        let way = (after[0] - before[0]).hypot(after[1] - before[1]);
        if charge > 0.0 {
            // Also in the tick at whose end it is empty.
            let empty = sensed(&arena)[0] == 0.0;
            assert_eq!(shows, ["green", if empty { "empty" } else { "" }]);
            assert!(way > 0.01, "{tick}: {way}");
        } else {
            assert_eq!(shows, ["", "empty"]);
            assert_eq!(sensed(&arena)[1], 0.0);
        }
        if tick < 15 {
            assert_eq!(sensed(&arena)[1], 1.0);
        }
        if tick > 25 {
            assert_eq!(way, 0.0, "{tick}");
        }
    }
}

#[test]
fn a_battery_charges_on_its_patch_also_when_it_is_empty() {
    let battery = json!({"standing": 100, "driving": 10, "charge": 0, "charging": {"patch": "east", "duration": 5}});
    let told = [0.1, 0.1, 1.0].repeat(2);
    let mut on = arena(&battery, &east());
    let mut off = arena(&battery, &west());
    for tick in 1..=70 {
        on.step(&told);
        off.step(&told);
        close(sensed(&on)[0], (tick as f32 / 50.0).min(1.0));
        assert_eq!(sensed(&off)[0], 0.0);
    }
    assert_eq!(first(&on).1, ["green", ""]);
    assert_eq!(first(&off).1, ["", "empty"]);
}

#[test]
fn a_preset_may_have_a_battery() {
    let start = |robot: Value| {
        let mut arena = Arena::default();
        let parameters = json!({"robot": robot, "robots": 5, "seed": 1});
        arena.reset(parameters.as_object().unwrap()).unwrap();
        arena
    };
    let mut weak =
        start(json!({"preset": "e-puck-rm1.1", "battery": {"standing": 2, "driving": 1}}));
    let mut lasting =
        start(json!({"preset": "e-puck-rm1.1", "battery": {"standing": 1e5, "driving": 1e4}}));
    let mut plain = start(json!("e-puck-rm1.1"));
    let mut numbers = [[0.0; 24]; 3];
    for tick in 0..30 {
        for (arena, numbers) in [&mut weak, &mut lasting, &mut plain]
            .into_iter()
            .zip(&mut numbers)
        {
            arena.step(&[0.5, 1.0].repeat(5));
            arena.sense(2, numbers);
        }
        // A battery that is not empty changes nothing.
        assert_eq!(numbers[1], numbers[2], "{tick}");
    }
    assert_ne!(first(&weak).0, first(&plain).0);
    assert_eq!(first(&lasting).0, first(&plain).0);
}

#[test]
fn mistakes_name_the_place() {
    let refusal = |battery: Value| {
        let parameters = parameters(&battery, &west());
        let refused = Arena::default().reset(parameters.as_object().unwrap());
        refused.unwrap_err().to_string()
    };
    let cases = [
        (
            refusal(json!(null)),
            "robot.sensors[0]: the robot has no battery; add battery: {standing: 600",
        ),
        (
            refusal(json!({"standing": 10})),
            "robot.battery: missing field `driving`",
        ),
        (
            refusal(json!({"standing": 10, "driving": 20})),
            "robot.battery.driving: 20 found, expected seconds, at most the 10 while standing",
        ),
        (
            refusal(json!({"standing": 0, "driving": 0})),
            "robot.battery.standing: 0 found, expected 1 to 1000000",
        ),
        (
            refusal(json!({"standing": 10, "driving": 5, "charge": 2})),
            "robot.battery.charge: 2 found, expected 0 to 1",
        ),
        (
            refusal(
                json!({"standing": 10, "driving": 5, "charging": {"patch": "east", "duration": 0}}),
            ),
            "robot.battery.charging.duration: 0 found",
        ),
        (
            refusal(
                json!({"standing": 10, "driving": 5, "charging": {"patch": "nest", "duration": 5}}),
            ),
            "robot.battery.charging.patch: no patch of the mission's floor is named \"nest\"; available: east",
        ),
    ];
    for (message, expected) in cases {
        assert!(message.contains(expected), "{message:?} lacks {expected:?}");
    }
}
