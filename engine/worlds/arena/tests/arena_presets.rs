//! Built-in robots of which something is different.
#![allow(clippy::unwrap_used)] // helpers of tests

use serde_json::{Value, json};
use swarmwright_kernels::Arena;
use swarmwright_simulation::Simulation;

/// Twelve robots close together on black, between grey and a lamp.
fn arena(robot: &Value, seed: u64) -> Arena {
    let mission = json!({
        "walls": {"rectangle": [3, 3]}, "lights": [{"at": [0, -1.2, 0.4], "intensity": 2}],
        "floor": {"patches": [{"name": "spot", "circle": {"radius": 0.5}, "color": "black"}]},
        "start": {"disc": {"radius": 0.6}}, "fitness": "order",
    });
    let mut arena = Arena::default();
    let parameters =
        json!({"mission": mission, "robot": robot, "robots": 12, "duration": 20, "seed": seed});
    arena.reset(parameters.as_object().unwrap()).unwrap();
    arena
}

fn sensed(arena: &Arena) -> Vec<f32> {
    let mut all = Vec::new();
    for agent in 0..12 {
        let mut numbers = vec![0.0; arena.description().sensors];
        arena.sense(agent, &mut numbers);
        all.extend(numbers);
    }
    all
}

/// What robots sense while they drive in curves.
fn episode(robot: &Value, seed: u64) -> Vec<Vec<f32>> {
    let mut arena = arena(robot, seed);
    let actuators = arena.description().actuators;
    let driven: Vec<f32> = (0..12 * actuators)
        .map(|index| 1.0 - 0.11 * (index % 7) as f32)
        .collect();
    let mut all = vec![sensed(&arena)];
    for _ in 0..60 {
        arena.step(&driven);
        all.push(sensed(&arena));
    }
    all
}

fn bits(numbers: Vec<Vec<f32>>) -> Vec<u32> {
    let numbers = numbers.into_iter().flatten();
    numbers.map(f32::to_bits).collect()
}

fn refusal(robot: &Value) -> String {
    let parameters = json!({"robot": robot});
    let refused = Arena::default().reset(parameters.as_object().unwrap());
    refused.unwrap_err().to_string()
}

/// Everything that can be different of each built-in robot, with what the robot has anyway.
fn all_as_they_are() -> [Value; 6] {
    let e_puck = |name: &str| {
        json!({"preset": name, "radius": 0.035, "height": 0.076, "mass": 0.4, "friction": [0.49, 0.07],
            "drive": {"wheel_base": 0.053, "max_speed": 0.12, "acceleration": 3.75, "noise": 0.05},
            "sensors": {
                "proximity": {"range": 0.05, "noise": 0.05, "response": [1.08212, -36.8961, 298.701]},
                "light": {"reach": 2.5, "noise": 0.05}, "ground": {"noise": 0.05},
                "range_and_bearing": {"range": 0.7, "loss": 0.85}}})
    };
    [
        e_puck("e-puck-rm1.1"),
        e_puck("e-puck-rm1.2"),
        json!({"preset": "foot-bot", "radius": 0.085_036_758, "sensors": {"proximity": {"range": 0.1}}}),
        json!({"preset": "kilobot", "drive": {"noise": 0.1}, "sensors": {"range_and_bearing": {"loss": 0.1}}}),
        json!({"preset": "point", "drive": {"max_turn": 180}, "sensors": {"neighbours": {"range": 1}}}),
        json!({"preset": "turtlebot3", "sensors": {"encoders": {"noise": 0}, "compass": {"noise": 2},
            "proximity": {"range": 3.5}}}),
    ]
}

#[test]
fn a_change_that_changes_nothing_gives_the_same_bits() {
    for robot in all_as_they_are() {
        let name = &robot["preset"];
        for seed in 0..3 {
            let expected = bits(episode(name, seed));
            assert_eq!(bits(episode(&robot, seed)), expected, "{name}");
            assert_eq!(
                bits(episode(&json!({"preset": name}), seed)),
                expected,
                "{name}"
            );
        }
    }
}

#[test]
fn every_change_has_an_effect_and_none_on_what_controllers_get_in_number() {
    for robot in all_as_they_are() {
        let name = &robot["preset"];
        let before = bits(episode(name, 1));
        for part in ["drive", "sensors"] {
            let mut single = Vec::new();
            for (key, value) in robot[part].as_object().into_iter().flatten() {
                match value {
                    Value::Object(inner) => single.extend(
                        inner
                            .iter()
                            .map(|(field, value)| json!({key: {field: changed(field, value)}})),
                    ),
                    value => single.push(json!({key: changed(key, value)})),
                }
            }
            for change in single {
                let other = json!({"preset": name, part: change});
                let mut arena = arena(&other, 1);
                assert_eq!(arena.description().sensors, arena.sensor_names().len());
                assert_eq!(
                    arena.sensor_names(),
                    self::arena(name, 1).sensor_names(),
                    "{other}"
                );
                arena.step(&vec![0.0; 12 * arena.description().actuators]);
                let after = bits(episode(&other, 1));
                assert_eq!(after.len(), before.len());
                assert!(after != before, "{other}");
            }
        }
        let other = json!({"preset": name, "radius": 0.1});
        assert!(bits(episode(&other, 1)) != before, "{other}");
    }
}

/// Another number, and another of each number in a list.
fn changed(field: &str, value: &Value) -> Value {
    match value {
        Value::Array(items) => items.iter().map(|item| changed(field, item)).collect(),
        value => {
            let number = value.as_f64().unwrap();
            // The lamp is near by its intensity.
            json!(match field {
                "reach" => 0.05 * number,
                "loss" => 1.0 - number,
                _ if number == 0.0 => 0.2,
                _ => 0.7 * number,
            })
        }
    }
}

#[test]
fn a_range_stretches_the_response() {
    let composed = json!({"radius": 0.105, "height": 0.192, "sensors": [{"kind": "proximity", "count": 36, "range": 1}],
        "drive": {"kind": "differential", "wheel_base": 0.16, "max_speed": 0.22, "acceleration": 2.5, "noise": 0.02}});
    let preset =
        json!({"preset": "turtlebot3", "sensors": {"proximity": {"range": 1, "noise": 0}}});
    for seed in 0..5 {
        let (expected, found) = (arena(&composed, seed), arena(&preset, seed));
        let (expected, found) = (sensed(&expected), sensed(&found));
        for agent in 0..12 {
            let found = &found[agent * 40..][..36];
            for (found, expected) in found.iter().zip(&expected[agent * 36..][..36]) {
                assert!((found - expected).abs() < 1e-5, "{found}, {expected}");
            }
        }
    }
}

#[test]
fn noise_and_loss_are_what_they_say() {
    // Nothing is near a robot's floor but grey: readings differ by the noise alone.
    let readings = |noise: f64, loss: f64| {
        let robot = json!({"preset": "foot-bot", "sensors": {"ground": {"noise": noise}, "range_and_bearing": {"loss": loss}}});
        let mission = json!({"walls": {"rectangle": [8, 8]}, "start": {"disc": {"radius": 1}}, "fitness": "order"});
        let mut ground = Vec::new();
        let mut heard = 0.0;
        for seed in 0..40 {
            let mut arena = Arena::default();
            let parameters = json!({"mission": mission, "robot": robot, "robots": 2, "seed": seed});
            arena.reset(parameters.as_object().unwrap()).unwrap();
            let mut numbers = [0.0; 57];
            arena.sense(0, &mut numbers);
            ground.extend(
                numbers[48..52]
                    .iter()
                    .map(|grey| (f64::from(*grey) - 0.498).abs()),
            );
            heard += f64::from(u8::from(numbers[52] > 0.0));
        }
        (ground.into_iter().fold(0.0, f64::max), heard / 40.0)
    };
    let (off, heard) = readings(0.0, 0.0);
    assert!(off < 1e-3 && heard == 1.0, "{off}, {heard}");
    let (off, heard) = readings(0.3, 0.5);
    assert!(
        (0.25..=0.301).contains(&off) && (0.2..0.8).contains(&heard),
        "{off}, {heard}"
    );
    assert_eq!(readings(0.0, 1.0).1, 0.0);
}

#[test]
fn mistakes_name_the_place() {
    let of = |part: &str, value: Value| refusal(&json!({"preset": "e-puck-rm1.1", part: value}));
    let cases = [
        (
            refusal(&json!({"preset": "e-pukc"})),
            "robot.preset: \"e-pukc\" found, expected the name of a robot (e-puck-rm1.1, ",
        ),
        (
            refusal(&json!({"preset": 1})),
            "robot.preset: 1 found, expected the name of a robot",
        ),
        (
            of("noise", json!(1)),
            "robot.noise: unknown field `noise`, expected one of `preset`, ",
        ),
        (
            of("radius", json!(0)),
            "robot.radius: 0 found, expected 0.001 to 10",
        ),
        (
            of("sensors", json!([{"kind": "light", "noise": 0.5}])),
            "found, but with preset it is a mapping of what is different, such as {light: {noise: 0.5}}",
        ),
        (
            of("sensors", json!({"light": 0.5})),
            "robot.sensors.light: 0.5 found, but with preset it is a mapping",
        ),
        (
            of("sensors", json!({"light": {"noise": 2}})),
            "robot.sensors.light.noise: 2 found, expected 0 to 1",
        ),
        (
            of("sensors", json!({"proximity": {"count": 4}})),
            "robot.sensors.proximity.count: unknown field `count`, expected one of `range`, ",
        ),
        (
            of("sensors", json!({"compass": {"noise": 2}})),
            "robot.sensors.compass: e-puck-rm1.1 has no such sensor; it has proximity, light, ground, range_and_bearing",
        ),
        (
            of("sensors", json!({"range_and_bearing": {"loss": -1}})),
            "robot.sensors.range_and_bearing.loss: -1 found",
        ),
        (
            of("drive", json!({"max_turn": 20})),
            "robot.drive.max_turn: the drive of e-puck-rm1.1 is differential, which has none",
        ),
        (
            of("drive", json!({"noise": 1})),
            "robot.drive.noise: 1 found, expected 0 to 0.2",
        ),
        (
            of("drive", json!({"max_speed": 0.8})),
            "robot.drive: it turns by up to 30.",
        ),
        (
            of("radius", json!(0.004)),
            "robot.drive.max_speed: 0.12 found, expected a number above 0, at most 25 radii a second, 0.1",
        ),
    ];
    for (message, expected) in cases {
        assert!(message.contains(expected), "{message:?} lacks {expected:?}");
    }
}
