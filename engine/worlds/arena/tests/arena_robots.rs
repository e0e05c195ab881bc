//! Robots that are composed of a drive, sensors and actuators.
#![allow(clippy::unwrap_used)] // helpers of tests

use serde_json::{Value, json};
use swarmwright_kernels::Arena;
use swarmwright_simulation::Simulation;

fn arena(robot: &Value, robots: u32, seed: u64) -> Arena {
    let mission = json!({
        "walls": {"rectangle": [6, 6]},
        "floor": {"patches": [{"name": "east", "rectangle": {"x": [0, 3], "y": [-3, 3]}, "color": "black"}]},
        "start": {"rectangle": {"x": [-1, 1], "y": [-1, 1]}},
        "fitness": "order",
    });
    let parameters = json!({"mission": mission, "robot": robot, "robots": robots, "seed": seed});
    let mut arena = Arena::default();
    arena.reset(parameters.as_object().unwrap()).unwrap();
    arena
}

fn refusal(robot: &Value) -> String {
    let parameters = json!({"robot": robot});
    let refused = Arena::default().reset(parameters.as_object().unwrap());
    refused.unwrap_err().to_string()
}

/// A robot with a drive and these sensors.
fn robot(drive: &Value, sensors: &Value) -> Value {
    json!({"radius": 0.05, "drive": drive, "sensors": sensors})
}

fn wheels() -> Value {
    json!({"kind": "differential", "wheel_base": 0.08, "max_speed": 0.2})
}

fn sensed(arena: &Arena, agent: u32) -> Vec<f64> {
    let mut numbers = vec![0.0; arena.description().sensors];
    arena.sense(agent, &mut numbers);
    numbers.into_iter().map(f64::from).collect()
}

/// Where robots are, the origin in the middle.
fn positions(arena: &Arena) -> Vec<[f64; 2]> {
    let scene = arena.scene().unwrap();
    let agents = scene.bodies.iter().filter(|body| body.kind == "agent");
    let middle = [scene.width / 2.0, scene.height / 2.0];
    agents
        .map(|body| [f64::from(body.x - middle[0]), f64::from(body.y - middle[1])])
        .collect()
}

#[track_caller]
fn close(a: f64, b: f64, within: f64) {
    assert!((a - b).abs() <= within, "{a}, {b}");
}

#[test]
fn every_model_runs() {
    for (model, sensors, actuators) in [
        ("e-puck-rm1.1", 24, 2),
        ("e-puck-rm1.2", 9, 2),
        ("foot-bot", 24 + 24 + 4 + 5, 2),
        ("kilobot", 4, 3),
        ("point", 9, 3),
        ("turtlebot3", 36 + 2 + 2, 2),
    ] {
        let mut arena = arena(&json!(model), 15, 1);
        let description = arena.description();
        assert_eq!(
            (description.sensors, description.actuators),
            (sensors, actuators),
            "{model}"
        );
        assert_eq!(arena.sensor_names().len(), sensors);
        assert_eq!(arena.actuator_names().len(), actuators);
        for step in 0..200 {
            for agent in 0..15 {
                for number in sensed(&arena, agent) {
                    assert!(number.is_finite(), "{model} in step {step}");
                }
            }
            let ahead: Vec<f32> = (0..actuators)
                .map(|index| 1.0 - 0.3 * index as f32)
                .collect();
            arena.step(&ahead.repeat(15));
        }
        let at = positions(&arena);
        for (index, a) in at.iter().enumerate() {
            assert!(a[0].abs() < 3.0 && a[1].abs() < 3.0, "{model}: {a:?}");
            for b in &at[..index] {
                let apart = (a[0] - b[0]).hypot(a[1] - b[1]);
                assert!(apart > 0.018, "{model}: {apart}");
            }
        }
    }
}

#[test]
fn a_holonomic_robot_goes_sideways_and_not_faster_across() {
    let drive = json!({"kind": "holonomic", "max_speed": 0.3, "max_turn": 90, "acceleration": 100});
    let sensors = json!([{"kind": "compass"}]);
    for (actuators, speed) in [
        ([0.0, 1.0, 0.0], 0.3),
        ([1.0, 1.0, 0.0], 0.3),
        ([0.5, 0.0, 0.0], 0.15),
    ] {
        let mut arena = arena(&robot(&drive, &sensors), 1, 2);
        arena.step(&actuators);
        let (from, compass) = (positions(&arena)[0], sensed(&arena, 0));
        arena.step(&actuators);
        let to = positions(&arena)[0];
        // In the robot's frame: the compass shows the x axis of the world there.
        let (dx, dy) = (to[0] - from[0], to[1] - from[1]);
        let ahead = dx * compass[0] - dy * compass[1];
        let left = dx * compass[1] + dy * compass[0];
        close(ahead.hypot(left), speed * 0.1, 1e-4);
        let length = actuators[0].hypot(actuators[1]);
        close(ahead, speed * 0.1 * f64::from(actuators[0] / length), 1e-4);
        close(left, speed * 0.1 * f64::from(actuators[1] / length), 1e-4);
    }
    // 90 degrees a second: four seconds are a turn, less a substep at its start.
    let mut arena = arena(&robot(&drive, &sensors), 1, 2);
    let before = sensed(&arena, 0);
    for _ in 0..40 {
        arena.step(&[0.0, 0.0, 1.0]);
    }
    let after = sensed(&arena, 0);
    let turned = (before[0] * after[1] - before[1] * after[0])
        .atan2(before[0] * after[0] + before[1] * after[1]);
    close(turned.abs(), 0.01 * std::f64::consts::FRAC_PI_2, 1e-3);
}

#[test]
fn a_car_drives_in_a_circle_and_never_turns_on_the_spot() {
    let drive = json!({"kind": "car", "wheel_base": 0.2, "max_speed": 0.3, "max_steering": 30, "acceleration": 100});
    let mut arena = arena(
        &robot(&drive, &json!([{"kind": "compass"}, {"kind": "encoders"}])),
        1,
        4,
    );
    let start = sensed(&arena, 0);
    for _ in 0..10 {
        arena.step(&[0.0, 1.0]);
    }
    assert_eq!(sensed(&arena, 0)[..2], start[..2]);
    for _ in 0..5 {
        arena.step(&[1.0, 1.0]);
    }
    // The circle through three places has the radius wheel_base / tan(steering).
    let mut at = Vec::new();
    for _ in 0..3 {
        for _ in 0..8 {
            arena.step(&[1.0, 1.0]);
        }
        at.push(positions(&arena)[0]);
    }
    let side = |a: [f64; 2], b: [f64; 2]| (a[0] - b[0]).hypot(a[1] - b[1]);
    let (a, b, c) = (side(at[0], at[1]), side(at[1], at[2]), side(at[2], at[0]));
    let area = ((at[1][0] - at[0][0]) * (at[2][1] - at[0][1])
        - (at[1][1] - at[0][1]) * (at[2][0] - at[0][0]))
        .abs()
        / 2.0;
    close(
        a * b * c / (4.0 * area),
        0.2 / 30_f64.to_radians().tan(),
        0.01,
    );
    assert_eq!(sensed(&arena, 0)[2..], [1.0, 1.0]);
}

#[test]
fn counts_are_named_after_what_they_count() {
    let sensors = json!([
        {"kind": "neighbours", "range": 0.7, "gives": ["count"]},
        {"kind": "range_and_bearing", "range": 0.7, "gives": ["count", "squashed"]},
    ]);
    let arena = arena(&robot(&wheels(), &sensors), 3, 1);
    assert_eq!(
        arena.sensor_names(),
        ["neighbours", "messages heard", "messages heard squashed"]
    );
}

#[test]
fn neighbours_are_seen_where_they_are() {
    let seen = json!([
        {"kind": "compass"},
        {"kind": "neighbours", "range": 0.7, "gives": ["count", "center", "heading", "nearest"]},
    ]);
    for seed in 0..20 {
        let arena = arena(&robot(&wheels(), &seen), 10, seed);
        let at = positions(&arena);
        let compass: Vec<_> = (0..10).map(|agent| sensed(&arena, agent)).collect();
        for agent in 0..10_usize {
            let numbers = sensed(&arena, agent as u32);
            let [cos, sin] = [numbers[0], -numbers[1]];
            let frame = |x: f64, y: f64| [x * cos + y * sin, y * cos - x * sin];
            let others: Vec<usize> = (0..10)
                .filter(|other| {
                    let (dx, dy) = (at[*other][0] - at[agent][0], at[*other][1] - at[agent][1]);
                    *other != agent && dx.hypot(dy) < 0.7
                })
                .collect();
            let count = others.len() as f64;
            assert_eq!(numbers[2], count);
            let (mut center, mut heading, mut nearest) = ([0.0; 2], [0.0; 2], [0.0; 2]);
            let mut least = f64::INFINITY;
            for other in others {
                let way = frame(at[other][0] - at[agent][0], at[other][1] - at[agent][1]);
                let looks = frame(compass[other][0], -compass[other][1]);
                for axis in 0..2 {
                    center[axis] += way[axis] / 0.7 / count;
                    heading[axis] += looks[axis] / count;
                }
                if way[0].hypot(way[1]) < least {
                    least = way[0].hypot(way[1]);
                    nearest = way.map(|part| part / 0.7);
                }
            }
            let expected = [center, heading, nearest].concat();
            for (number, expected) in numbers[3..].iter().zip(expected) {
                close(*number, expected, 1e-5);
            }
        }
    }
}

#[test]
fn messages_are_heard_by_those_in_range() {
    let mut talker = robot(
        &wheels(),
        &json!([{"kind": "range_and_bearing", "range": 10, "gives": ["count", "message"]}]),
    );
    talker["actuators"] = json!([{"kind": "message", "numbers": 2}]);
    // Two robots: nothing stands between them.
    let mut arena = arena(&talker, 2, 1);
    assert_eq!(sensed(&arena, 0), [1.0, 0.0, 0.0]);
    assert_eq!(arena.actuator_names()[2..], ["message 0", "message 1"]);
    arena.step(&[0.0, 0.0, 0.5, -1.0, 0.0, 0.0, 0.25, 0.75]);
    assert_eq!(sensed(&arena, 0), [1.0, 0.25, 0.75]);
    assert_eq!(sensed(&arena, 1), [1.0, 0.5, -1.0]);
    // All messages are lost.
    talker["sensors"][0]["loss"] = json!(1);
    let parameters = json!({"robot": talker, "robots": 2});
    arena.reset(parameters.as_object().unwrap()).unwrap();
    arena.step(&[0.0, 0.0, 0.5, -1.0, 0.0, 0.0, 0.25, 0.75]);
    assert_eq!(sensed(&arena, 0), [0.0; 3]);
}

#[test]
fn readings_follow_from_where_things_are() {
    let sensors = json!([
        {"kind": "compass"},
        {"kind": "proximity", "count": 64, "range": 3},
        {"kind": "ground", "points": [[0, 0], [0.05, 0]]},
    ]);
    for seed in 0..20 {
        let arena = arena(&robot(&wheels(), &sensors), 1, seed);
        let ([x, y], numbers) = (positions(&arena)[0], sensed(&arena, 0));
        let [cos, sin] = [numbers[0], -numbers[1]];
        for (index, reading) in numbers[2..66].iter().enumerate() {
            let angle = std::f64::consts::TAU * index as f64 / 64.0;
            let (dx, dy) = (
                angle.cos() * cos - angle.sin() * sin,
                angle.cos() * sin + angle.sin() * cos,
            );
            let to_wall =
                ((3.0 - x * dx.signum()) / dx.abs()).min((3.0 - y * dy.signum()) / dy.abs());
            close(
                *reading,
                (1.0 - (to_wall - 0.05) / 3.0).clamp(0.0, 1.0),
                1e-4,
            );
        }
        let grey = |x: f64| if x >= 0.0 { 0.0 } else { 0.498 };
        close(numbers[66], grey(x), 1e-3);
        close(numbers[67], grey(x + 0.05 * cos), 1e-3);
    }
}

#[test]
fn fast_robots_do_not_run_through_each_other() {
    let drive = json!({"kind": "differential", "wheel_base": 0.3, "max_speed": 1.2, "noise": 0.1});
    for seed in 0..5 {
        let mut arena = arena(&robot(&drive, &json!([{"kind": "random"}])), 30, seed);
        for step in 0..200 {
            let turn = if step % 20 < 14 { 1.0 } else { 0.2 };
            arena.step(&[turn, 1.0].repeat(30));
            let at = positions(&arena);
            for (index, a) in at.iter().enumerate() {
                assert!(a[0].abs() < 2.97 && a[1].abs() < 2.97, "{a:?}");
                for b in &at[..index] {
                    let apart = (a[0] - b[0]).hypot(a[1] - b[1]);
                    assert!(apart > 0.07, "{apart}");
                }
            }
        }
    }
}

#[test]
fn mistakes_name_the_place() {
    let some = json!([{"kind": "random"}]);
    let of = |drive: Value, sensors: Value| refusal(&robot(&drive, &sensors));
    let sensor = |sensor: Value| refusal(&robot(&wheels(), &json!([sensor])));
    let cases = [
        (
            refusal(&json!("e-pukc")),
            "robot: \"e-pukc\" found, expected the name of a robot (e-puck-rm1.1, ",
        ),
        (
            refusal(&json!(7)),
            "robot: 7 found, expected the name of a robot",
        ),
        (
            refusal(&json!({"radius": 1})),
            "robot: missing field `drive`",
        ),
        (
            refusal(&json!({"radius": 0, "drive": wheels()})),
            "robot.radius: 0 found, expected 0.001 to 10",
        ),
        (
            of(wheels(), json!([])),
            "robot.sensors: a robot needs at least one sensor",
        ),
        (
            of(json!({"kind": "hover"}), some.clone()),
            "robot.drive.kind: \"hover\" found, expected one of \"differential\"",
        ),
        (
            of(
                json!({"kind": "differential", "wheel_base": 0.1}),
                some.clone(),
            ),
            "robot.drive: missing field `max_speed`",
        ),
        (
            of(
                json!({"kind": "differential", "wheel_base": 0.1, "max_speed": 5}),
                some.clone(),
            ),
            "robot.drive.max_speed: 5 found, expected a number above 0, at most 25 radii a second",
        ),
        (
            of(
                json!({"kind": "differential", "wheel_base": 0.01, "max_speed": 1}),
                some.clone(),
            ),
            "robot.drive: it turns by up to 200 rad/s",
        ),
        (
            of(
                json!({"kind": "car", "wheel_base": 0.1, "max_speed": 1, "max_steering": 90}),
                some,
            ),
            "robot.drive.max_steering: 90 found",
        ),
        (
            sensor(json!({"kind": "proximty"})),
            "robot.sensors[0].kind: \"proximty\" found, expected one of \"proximity\"",
        ),
        (
            sensor(json!({"kind": "proximity", "range": "far", "count": 8})),
            "robot.sensors[0].range: \"far\" (a string) found, expected a number",
        ),
        (
            sensor(json!({"kind": "range_and_bearing", "range": 1, "gives": ["count", "count"]})),
            "robot.sensors[0].gives[1]: occurs twice",
        ),
        (
            of(wheels(), json!([{"kind": "compass"}, {"kind": "compass"}])),
            "robot.sensors[1]: a sensor compass already exists",
        ),
        (
            of(wheels(), json!([{"kind": "random"}, {"kind": "random"}])),
            "robot.sensors[1]: a sensor random already exists",
        ),
        (
            sensor(json!({"kind": "proximity", "range": 1})),
            "robot.sensors[0]: expected count, or angles",
        ),
        (
            sensor(json!({"kind": "proximity", "range": 1, "count": 500})),
            "robot.sensors[0].count: 500 found",
        ),
        (
            sensor(json!({"kind": "proximity", "range": -1, "count": 5})),
            "robot.sensors[0].range: -1 found",
        ),
        (
            sensor(json!({"kind": "ground", "points": []})),
            "robot.sensors[0].points: 0 found, expected 1 to 8",
        ),
        (
            sensor(json!({"kind": "range_and_bearing", "range": 1, "loss": 2})),
            "robot.sensors[0].loss: 2 found",
        ),
        (
            sensor(json!({"kind": "range_and_bearing", "range": 1, "gives": ["message"]})),
            "robot.sensors[0].gives[0]: no message is sent; add an actuator",
        ),
        (
            of(
                wheels(),
                json!([{"kind": "compass"}, {"kind": "light", "count": 1}, {"kind": "light", "count": 2}]),
            ),
            "robot.sensors[2]: a sensor light already exists",
        ),
        (
            refusal(
                &json!({"radius": 0.05, "drive": wheels(), "sensors": [{"kind": "random"}],
                "actuators": [{"kind": "message", "numbers": 1}]}),
            ),
            "robot.actuators: no robot receives the message",
        ),
    ];
    for (message, expected) in cases {
        assert!(message.contains(expected), "{message:?} lacks {expected:?}");
    }
}
