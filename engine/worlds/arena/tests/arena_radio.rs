//! Radios: which messages arrive, and when.
#![allow(clippy::unwrap_used)] // helpers of tests

use serde_json::{Value, json};
use swarmwright_kernels::Arena;
use swarmwright_simulation::Simulation;

/// Standing robots that send a number, and hear how many others there are and the mean of their numbers.
fn arena(radio: &Value, loss: f64, robots: u32, seed: u64) -> Arena {
    let mission = json!({
        "walls": {"rectangle": [6, 6]},
        "obstacles": [{"center": [0, 0], "size": [0.02, 5.5]}],
        "start": {"rectangle": {"x": [-1, 1], "y": [-1, 1]}},
        "fitness": "order",
    });
    let robot = json!({
        "radius": 0.01,
        "drive": {"kind": "differential", "wheel_base": 0.08, "max_speed": 0.2},
        "sensors": [{"kind": "range_and_bearing", "range": 1, "loss": loss, "radio": radio, "gives": ["count", "message"]}],
        "actuators": [{"kind": "message", "numbers": 1}],
    });
    let parameters = json!({"mission": mission, "robot": robot, "robots": robots, "seed": seed, "duration": 1000});
    let mut arena = Arena::default();
    arena.reset(parameters.as_object().unwrap()).unwrap();
    arena
}

fn heard(arena: &Arena, robot: u32) -> [f64; 2] {
    let mut numbers = [0.0; 2];
    arena.sense(robot, &mut numbers);
    numbers.map(f64::from)
}

/// Distances of robots from one.
fn distances(arena: &Arena, from: usize) -> Vec<f64> {
    let scene = arena.scene().unwrap();
    let agents: Vec<_> = scene
        .bodies
        .iter()
        .filter(|body| body.kind == "agent")
        .collect();
    let others = agents
        .iter()
        .enumerate()
        .filter(|(index, _)| *index != from);
    others
        .map(|(_, body)| f64::from((body.x - agents[from].x).hypot(body.y - agents[from].y)))
        .collect()
}

/// That as many messages arrive as expected from independent links with these probabilities, in as many ticks each.
#[track_caller]
fn follows(received: f64, probabilities: &[f64], ticks: f64) {
    let expected: f64 = probabilities.iter().map(|p| p * ticks).sum();
    let variance: f64 = probabilities.iter().map(|p| p * (1.0 - p) * ticks).sum();
    let off = (received - expected).abs();
    assert!(
        off <= 4.5 * variance.sqrt() + 1e-9,
        "{received} received, {expected} expected"
    );
}

const TICKS: u32 = 300;

/// What robot 0 receives over all ticks.
fn received(arena: &mut Arena, robots: usize) -> f64 {
    let still = [0.0, 0.0, 0.0].repeat(robots);
    let tick = |_| {
        arena.step(&still);
        heard(arena, 0)[0]
    };
    (0..TICKS).map(tick).sum()
}

#[test]
fn fading_follows_the_distribution_of_nakagami() {
    for (fading, exponent) in [(1, 2.0), (1, 3.5), (3, 4.0), (8, 3.0)] {
        let radio = json!({"fading": fading, "exponent": exponent, "line_of_sight": false});
        let (mut total, mut probabilities) = (0.0, Vec::new());
        for seed in 0..30 {
            let mut arena = arena(&radio, 0.25, 2, seed);
            let threshold = f64::from(fading) * distances(&arena, 0)[0].powf(exponent);
            let (mut term, mut sum) = (1.0, 1.0);
            for k in 1..fading {
                term *= threshold / f64::from(k);
                sum += term;
            }
            probabilities.push(0.75 * (-threshold).exp() * sum);
            total += received(&mut arena, 2);
        }
        assert!(probabilities.iter().any(|p| (0.1..0.6).contains(p)));
        follows(total, &probabilities, TICKS.into());
    }
}

#[test]
fn messages_collide_where_many_send() {
    let (mut total, mut probabilities) = (0.0, Vec::new());
    for seed in 0..10 {
        let radio = json!({"slots": 12, "line_of_sight": false});
        let mut arena = arena(&radio, 0.0, 9, seed);
        let senders = distances(&arena, 0).iter().filter(|d| **d < 1.0).count();
        let alone = (11.0_f64 / 12.0).powi(senders as i32 - 1);
        probabilities.extend(vec![alone; senders]);
        total += received(&mut arena, 9);
    }
    follows(total, &probabilities, TICKS.into());
    // Those that take turns collide with fewer.
    let alternating = json!({"slots": 2, "interval": 1, "line_of_sight": false});
    let mut arena = arena(&alternating, 0.0, 9, 3);
    let senders = distances(&arena, 0).iter().filter(|d| **d < 1.0).count();
    assert!((received(&mut arena, 9) - senders as f64 * f64::from(TICKS) / 10.0).abs() < 0.5);
}

#[test]
fn robots_with_an_interval_take_turns() {
    let mut arena = arena(&json!({"interval": 0.3, "line_of_sight": false}), 0.0, 4, 2);
    let near = distances(&arena, 3).iter().filter(|d| **d < 1.0).count();
    assert!(near > 0);
    let mut window = Vec::new();
    for _ in 0..30 {
        arena.step(&[0.0, 0.0, 1.0].repeat(4));
        window.push(heard(&arena, 3)[0]);
    }
    for three in window.windows(3) {
        assert_eq!(three.iter().sum::<f64>(), near as f64);
    }
}

#[test]
fn numbers_arrive_later() {
    let pair = |delay: f64| {
        // Two robots that hear each other.
        (0..).find_map(|seed| {
            let arena = arena(
                &json!({"delay": delay, "line_of_sight": false}),
                0.0,
                2,
                seed,
            );
            (distances(&arena, 0)[0] < 1.0).then_some(arena)
        })
    };
    for (delay, ticks) in [(0.0, 0), (0.1, 1), (0.5, 5)] {
        let mut arena = pair(delay).unwrap();
        for step in 0..20_usize {
            let sent = (step + 1) as f32 / 32.0;
            arena.step(&[0.0, 0.0, sent, 0.0, 0.0, -sent]);
            let then = (step + 1).saturating_sub(ticks) as f64 / 32.0;
            assert_eq!(heard(&arena, 0), [1.0, -then]);
            assert_eq!(heard(&arena, 1), [1.0, then]);
        }
    }
}

#[test]
fn walls_stop_messages_or_do_not() {
    let (mut through, mut stopped) = (0, 0);
    for seed in 0..20 {
        let count = |radio: Value| heard(&arena(&radio, 0.0, 2, seed), 0)[0];
        let free = count(json!({"line_of_sight": false}));
        let near = distances(&arena(&json!({}), 0.0, 2, seed), 0)[0] < 1.0;
        assert_eq!(free, f64::from(u8::from(near)));
        through += u32::from(free > 0.0);
        stopped += u32::from(free > count(json!({"line_of_sight": true})));
        assert_eq!(count(json!({})), count(json!({"line_of_sight": true})));
    }
    assert!(stopped > 0 && through > stopped);
}

#[test]
fn mistakes_name_the_place() {
    let refusal = |robot: Value| {
        let parameters = json!({"robot": robot});
        let refused = Arena::default().reset(parameters.as_object().unwrap());
        refused.unwrap_err().to_string()
    };
    for (radio, expected) in [
        (
            json!({"fading": 1.5}),
            "fading: 1.5 found, expected a whole number of 1 to 8",
        ),
        (
            json!({"fading": 9}),
            "fading: 9 found, expected a whole number of 1 to 8",
        ),
        (
            json!({"exponent": 3}),
            "exponent: has no effect without fading",
        ),
        (
            json!({"fading": 1, "exponent": 0.5}),
            "exponent: 0.5 found, expected 1 to 10",
        ),
        (
            json!({"slots": 1}),
            "slots: 1 found, expected a whole number of 2 to 10000",
        ),
        (
            json!({"interval": 0}),
            "interval: 0 found, expected 0.1 to 10",
        ),
        (
            json!({"delay": 0.15}),
            "delay: 0.15 found, expected a multiple of 0.1 s",
        ),
        (json!({"delay": 60}), "delay: 60 found, expected 0 to 5"),
    ] {
        let preset =
            json!({"preset": "kilobot", "sensors": {"range_and_bearing": {"radio": radio}}});
        let found = refusal(preset);
        let place = "robot.sensors.range_and_bearing.radio.";
        assert!(found.contains(&format!("{place}{expected}")), "{found}");
        let sensor = json!({"kind": "range_and_bearing", "range": 1, "radio": radio});
        let drive = json!({"kind": "differential", "wheel_base": 0.08, "max_speed": 0.2});
        let found = refusal(json!({"radius": 0.05, "drive": drive, "sensors": [sensor]}));
        assert!(
            found.contains(&format!("robot.sensors[0].radio.{expected}")),
            "{found}"
        );
    }
    let found = refusal(
        json!({"preset": "kilobot", "sensors": {"range_and_bearing": {"radio": {"latency": 1}}}}),
    );
    assert!(found.contains("latency"), "{found}");
}
