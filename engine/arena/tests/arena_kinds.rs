//! Swarms with robots of several kinds.
#![allow(clippy::unwrap_used)] // helpers of tests

use serde_json::{Value, json};
use swarmwright_arena::Arena;
use swarmwright_simulation::Simulation;

/// A robot with these sensors; all that have the same number of them fit together.
fn robot(radius: f64, mass: f64, max_speed: f64, sensors: &Value) -> Value {
    json!({"radius": radius, "mass": mass, "sensors": sensors,
        "drive": {"kind": "holonomic", "max_speed": max_speed, "max_turn": 0}})
}

fn nearest() -> Value {
    json!([{"kind": "proximity", "count": 8, "range": 0.5, "response": [0, 1, 0]}])
}

fn mission(start: &Value) -> Value {
    json!({"walls": {"rectangle": [6, 4]}, "start": start, "fitness": "order"})
}

fn arena(parameters: &Value) -> Arena {
    let mut arena = Arena::default();
    arena.reset(parameters.as_object().unwrap()).unwrap();
    arena
}

fn refusal(parameters: &Value) -> String {
    let refused = Arena::default().reset(parameters.as_object().unwrap());
    refused.unwrap_err().to_string()
}

fn drive_east(arena: &mut Arena, speeds: &[f32], ticks: usize) {
    for _ in 0..ticks {
        let scene = arena.scene().unwrap();
        let headings = scene.bodies.iter().filter_map(|body| body.heading);
        let actuators: Vec<f32> = headings
            .zip(speeds)
            .flat_map(|(heading, speed)| [heading.cos() * speed, -heading.sin() * speed, 0.0])
            .collect();
        arena.step(&actuators);
    }
}

#[test]
fn kinds_have_their_own_bodies_and_looks() {
    let kinds = json!([
        {"robot": robot(0.1, 2.0, 0.3, &nearest()), "count": 3, "name": "large"},
        {"robot": "kilobot", "count": 1},
    ]);
    assert!(refusal(&json!({"robots": kinds})).contains(
        "robots[1].robot: kilobot has 4 sensor values, large has 8; all kinds have the same controller"
    ));
    let kinds = json!([
        {"robot": robot(0.1, 2.0, 0.3, &nearest()), "count": 3, "name": "large"},
        {"robot": robot(0.03, 0.2, 0.1, &nearest()), "count": 5},
    ]);
    let start = json!({"rectangle": {"x": [-1, 1], "y": [-1, 1]}});
    let mut arena = arena(&json!({"mission": mission(&start), "robots": kinds}));
    assert_eq!(arena.acting().len(), 8);
    let before = arena.scene().unwrap().bodies;
    let radii: Vec<f32> = before.iter().map(|body| body.radius).collect();
    assert_eq!(radii, [0.1, 0.1, 0.1, 0.03, 0.03, 0.03, 0.03, 0.03]);
    let states: Vec<&str> = before.iter().map(|body| body.state.as_ref()).collect();
    assert_eq!(states[2..4], ["large", "robot 1"]);
    // Nobody overlaps anybody.
    for (index, a) in before.iter().enumerate() {
        for b in &before[index + 1..] {
            assert!((a.x - b.x).hypot(a.y - b.y) >= a.radius + b.radius - 1e-6);
        }
    }
    // Each drives as fast as its kind does.
    let speeds = [1.0; 8];
    drive_east(&mut arena, &speeds, 8);
    let middle = arena.scene().unwrap().bodies;
    drive_east(&mut arena, &speeds, 1);
    let after = arena.scene().unwrap().bodies;
    let fastest = |from: usize, to: usize| {
        let ways = (from..to).map(|index| (after[index].x - middle[index].x) * 10.0);
        ways.fold(0.0, f32::max)
    };
    assert!((fastest(0, 3) - 0.3).abs() < 0.003, "{}", fastest(0, 3));
    // A small one that a large one pushes is faster.
    assert!(fastest(3, 8) > 0.099, "{}", fastest(3, 8));
}

#[test]
fn rays_see_each_kind_in_its_size() {
    // Two robots side by side: each sees the rim of the other.
    let kinds = json!([
        {"robot": robot(0.1, 1.0, 0.1, &nearest()), "count": 1, "name": "large"},
        {"robot": robot(0.03, 1.0, 0.1, &nearest()), "count": 1, "name": "small"},
    ]);
    let start = json!({"rectangle": {"x": [-0.3, 0.3], "y": [-0.001, 0.001]}});
    let mut seen = 0;
    for seed in 0..40 {
        let arena = arena(&json!({"mission": mission(&start), "robots": kinds, "seed": seed}));
        let scene = arena.scene().unwrap();
        let bodies = &scene.bodies;
        let apart = (bodies[0].x - bodies[1].x).hypot(bodies[0].y - bodies[1].y);
        for (agent, other) in [(0, 1), (1, 0)] {
            let mut sensors = [0.0; 8];
            arena.sense(agent as u32, &mut sensors);
            let nearest = sensors.iter().copied().filter(|reading| *reading > 0.0);
            let nearest = nearest.fold(f32::INFINITY, f32::min);
            let rim = apart - bodies[agent].radius - bodies[other].radius;
            if nearest < f32::INFINITY {
                seen += 1;
                assert!(nearest > rim - 1e-3, "{nearest}, {rim}");
                // A ray that meets the disc at all meets it at most a radius beyond its rim.
                assert!(
                    nearest < rim + bodies[other].radius + 1e-3,
                    "{nearest}, {rim}"
                );
            }
        }
        for ray in &scene.rays {
            let mut sensors = [0.0; 8];
            arena.sense(ray.body, &mut sensors);
            let reading = ray.reading.unwrap();
            assert!(sensors.iter().any(|sensor| (sensor - reading).abs() < 1e-4));
        }
    }
    assert!(seen > 40, "{seen}");
}

#[test]
fn the_heavier_of_two_goes_on() {
    // Both push against each other; forces are mass times acceleration.
    let kinds = json!([
        {"robot": robot(0.05, 2.0, 0.2, &nearest()), "count": 1, "name": "heavy"},
        {"robot": robot(0.05, 0.5, 0.2, &nearest()), "count": 1, "name": "light"},
    ]);
    let start = json!({"rectangle": {"x": [-0.2, 0.2], "y": [-0.001, 0.001]}});
    let seed = (0..100).find(|seed| {
        let arena = arena(&json!({"mission": mission(&start), "robots": kinds, "seed": seed}));
        let bodies = arena.scene().unwrap().bodies;
        bodies[0].x < bodies[1].x
    });
    let mut arena =
        arena(&json!({"mission": mission(&start), "robots": kinds, "seed": seed.unwrap()}));
    drive_east(&mut arena, &[1.0, -1.0], 30);
    let before = arena.scene().unwrap().bodies;
    drive_east(&mut arena, &[1.0, -1.0], 10);
    let after = arena.scene().unwrap().bodies;
    for index in 0..2 {
        let speed = after[index].x - before[index].x;
        assert!(speed > 0.1, "{index}: {speed}");
    }
}

#[test]
fn a_list_of_one_kind_is_that_kind() {
    let run = |parameters: Value| {
        let mut arena = arena(&parameters);
        for tick in 0..30 {
            let actuators: Vec<f32> = (0..40)
                .map(|index| ((index * 7 + tick) % 11) as f32 / 5.0 - 1.0)
                .collect();
            arena.step(&actuators);
        }
        let bodies = arena.scene().unwrap().bodies;
        let mut sensors = vec![0.0; 24];
        arena.sense(3, &mut sensors);
        let places: Vec<(f32, f32)> = bodies.iter().map(|body| (body.x, body.y)).collect();
        (places, sensors)
    };
    let several = json!([{"robot": "e-puck-rm1.1", "count": 20}]);
    assert_eq!(run(json!({"robots": several})), run(json!({"robots": 20})));
    // Two kinds that are the same but for their names are no different either.
    let several = json!([
        {"robot": "e-puck-rm1.1", "count": 13, "name": "a"},
        {"robot": "e-puck-rm1.1", "count": 7, "name": "b"},
    ]);
    assert_eq!(run(json!({"robots": several})), run(json!({"robots": 20})));
}

#[test]
fn mistakes_name_the_kind() {
    let e_puck = |count: i64| json!({"robot": "e-puck-rm1.1", "count": count});
    let cases = [
        (
            json!({"robots": []}),
            "robots: 0 kinds found, expected 1 to 16",
        ),
        (
            json!({"robots": [e_puck(0)]}),
            "robots[0].count: 0 found, expected 1 to 100000",
        ),
        (
            json!({"robots": [e_puck(3), e_puck(4)]}),
            "robots[1].name: another kind is named \"e-puck-rm1.1\"; give each a name of its own",
        ),
        (
            json!({"robots": [e_puck(3), {"robot": "r2d2", "count": 1}]}),
            "robots[1].robot: \"r2d2\" found, expected the name of a robot",
        ),
        (
            json!({"robots": [{"robot": "e-puck-rm1.1"}]}),
            "robots[0]: missing field `count`",
        ),
        (
            json!({"robots": [e_puck(3), {"robot": "foot-bot", "count": 2}]}),
            "robots[1].robot: foot-bot has 57 sensor values, e-puck-rm1.1 has 24",
        ),
        (
            json!({"robots": [e_puck(3)], "robot": "foot-bot"}),
            "robot: robots lists kinds with a robot each",
        ),
        (
            json!({"robots": "many"}),
            "robots: \"many\" found, expected 1 to 100000, or a list",
        ),
    ];
    for (parameters, expected) in cases {
        let message = refusal(&parameters);
        assert!(message.contains(expected), "{message:?} lacks {expected:?}");
    }
    let mut mission = mission(&json!({"disc": {"radius": 1}}));
    mission["robots"] = json!([e_puck(3), {"robot": "e-puck-rm1.1", "name": "b", "count": 2}]);
    let message = refusal(&json!({"mission": mission, "robots": 7}));
    assert!(
        message.contains("robots: 7 found, but the mission has 2 kinds of robots"),
        "{message}"
    );
    // A model for all, and the mission's kinds.
    assert_eq!(
        arena(&json!({"mission": mission, "robot": "kilobot"}))
            .acting()
            .len(),
        5
    );
    assert_eq!(arena(&json!({"mission": mission})).acting().len(), 5);
}

#[test]
fn metrics_and_failures_know_the_kinds() {
    let kinds = json!([
        {"robot": "e-puck-rm1.1", "count": 6, "name": "a"},
        {"robot": "e-puck-rm1.1", "count": 4, "name": "b"},
    ]);
    let mut mission = mission(&json!({"rectangle": {"x": [-1, 1], "y": [-1, 1]}}));
    mission["floor"] = json!({"patches": [{"name": "all", "rectangle": {"x": [-3, 3], "y": [-2, 2]}, "color": 0}]});
    mission["robots"] = kinds;
    mission["failures"] = json!([{"kind": "stop", "share": 0.5, "robots": "b"}]);
    mission["metrics"] = json!({
        "a": {"kind": "robots_on", "patch": "all", "robots": "a", "when": "end"},
        "share": {"kind": "robots_on", "patch": "all", "robots": "b", "when": "end", "share": true},
        "both": {"kind": "robots_on", "patch": "all", "when": "end"},
    });
    let mut stopped = Vec::new();
    for seed in 0..10 {
        let parameters = json!({"mission": mission, "duration": 0.5, "seed": seed});
        let mut arena = arena(&parameters);
        let before = arena.scene().unwrap().bodies;
        while !arena.acting().is_empty() {
            arena.step(&[1.0; 20]);
        }
        let after = arena.scene().unwrap().bodies;
        let still: Vec<usize> = (0..10)
            .filter(|robot| before[*robot].heading == after[*robot].heading)
            .collect();
        assert_eq!(still.len(), 2, "{still:?}");
        assert!(still.iter().all(|robot| *robot >= 6), "{still:?}");
        stopped.extend(still);
        let names = arena.description().metrics;
        let values = arena.metrics();
        let value =
            |name: &str| values[names.iter().position(|metric| metric.name == name).unwrap()];
        assert_eq!(
            [value("a"), value("share"), value("both")],
            [6.0, 1.0, 10.0]
        );
    }
    assert!((6..10).all(|robot| stopped.contains(&robot)), "by the seed");
    let mut wrong = mission.clone();
    wrong["metrics"]["a"]["robots"] = json!("c");
    let message = refusal(&json!({"mission": wrong}));
    assert!(
        message
            .contains("mission.metrics.a.robots: no kind of robots is named \"c\"; there is a, b"),
        "{message}"
    );
    let failures = json!([{"kind": "blind", "share": 1, "robots": "d"}]);
    let message = refusal(&json!({"mission": mission, "failures": failures}));
    assert!(
        message.contains("failures[0].robots: no kind of robots is named \"d\""),
        "{message}"
    );
    // Without a list there are no kinds to name.
    let message = refusal(&json!({"mission": mission, "robot": "e-puck-rm1.1"}));
    assert!(message.contains("there is none"), "{message}");
}
