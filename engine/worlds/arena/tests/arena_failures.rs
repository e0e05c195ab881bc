//! Robots that fail during an episode.
#![allow(clippy::unwrap_used)] // helpers of tests

use serde_json::{Value, json};
use swarmwright_kernels::Arena;
use swarmwright_simulation::Simulation;

/// Robots that drive on the spot, see how fast they turn, and hear each other.
fn arena(failures: &Value, robots: u32, seed: u64) -> Arena {
    let robot = json!({
        "radius": 0.02,
        "drive": {"kind": "holonomic", "max_speed": 0.1, "max_turn": 90},
        "sensors": [
            {"kind": "compass"},
            {"kind": "range_and_bearing", "range": 50, "gives": ["count", "message"]},
        ],
        "actuators": [{"kind": "message", "numbers": 1}],
    });
    let mission = json!({"walls": {"rectangle": [40, 40]}, "start": {"disc": {"radius": 15}}, "fitness": "order"});
    let parameters = json!({"mission": mission, "robot": robot, "robots": robots, "seed": seed, "failures": failures});
    let mut arena = Arena::default();
    arena.reset(parameters.as_object().unwrap()).unwrap();
    arena
}

fn sensed(arena: &Arena) -> Vec<[f32; 4]> {
    let sensed = arena.acting().iter().map(|agent| {
        let mut numbers = [0.0; 4];
        arena.sense(*agent, &mut numbers);
        numbers
    });
    sensed.collect()
}

/// How far each robot turns in a step, radians.
fn turns(arena: &mut Arena) -> Vec<f32> {
    let before = sensed(arena);
    let actuators = [0.0, 0.0, 1.0, 1.0].repeat(before.len());
    arena.step(&actuators);
    let after = sensed(arena);
    let turn = |(a, b): (&[f32; 4], &[f32; 4])| {
        (a[1] * b[0] - a[0] * b[1]).atan2(a[0] * b[0] + a[1] * b[1])
    };
    before.iter().zip(&after).map(turn).collect()
}

/// A tick at 90 degrees a second.
const TURN: f32 = std::f32::consts::FRAC_PI_2 / 10.0;

fn count(turns: &[f32], of: f32) -> usize {
    turns
        .iter()
        .filter(|turn| (*turn - of).abs() < 1e-3)
        .count()
}

#[test]
fn a_share_stops_and_goes_on() {
    for seed in 0..10 {
        let mut arena = arena(
            &json!([{"kind": "stop", "share": 0.3, "at": 1, "until": 2}]),
            20,
            seed,
        );
        for tick in 1..30 {
            let turns = turns(&mut arena);
            // The first substep of a tick still turns as in the tick before.
            let (stopped, standing) = match tick {
                1 | 11 | 21 => continue,
                12..=20 => (6, 14),
                _ => (0, 20),
            };
            assert_eq!(count(&turns, 0.0), stopped, "tick {tick}");
            assert_eq!(count(&turns, TURN), standing, "tick {tick}");
        }
    }
}

/// How scenes call the robots.
fn states(arena: &Arena) -> Vec<String> {
    let bodies = arena.scene().unwrap().bodies.into_iter();
    bodies.map(|body| body.state.into_owned()).collect()
}

#[test]
fn scenes_say_which_robots_fail_and_how() {
    let mut stopping = arena(
        &json!([{"kind": "stop", "share": 0.3, "at": 1, "until": 2}]),
        20,
        4,
    );
    for tick in 1..30 {
        let turned = turns(&mut stopping);
        let states = states(&stopping);
        match tick {
            // Stopped from here on, as a scene says what begins.
            10 => assert_eq!(states.iter().filter(|state| *state == "stopped").count(), 6),
            20 => assert!(states.iter().all(String::is_empty)),
            // The first substep of a tick still turns as in the tick before.
            1 | 11 | 21 => continue,
            12..20 => {
                for (turn, state) in turned.iter().zip(&states) {
                    let expected = if turn.abs() < 1e-3 { "stopped" } else { "" };
                    assert_eq!(state, expected, "tick {tick}");
                }
                assert!(states.iter().any(|state| !state.is_empty()));
            }
            _ => assert!(states.iter().all(String::is_empty), "tick {tick}"),
        }
    }
    let of = |failures: &Value| states(&arena(failures, 4, 1));
    let slow = json!({"kind": "slow", "share": 1, "factor": 0.5});
    assert_eq!(of(&json!([slow])), ["slow"; 4]);
    let mute = json!({"kind": "mute", "share": 1});
    assert_eq!(of(&json!([slow, mute])), ["mute"; 4]);
    let blind = json!({"kind": "blind", "share": 0.5});
    let mut some = of(&json!([mute, blind]));
    some.sort();
    assert_eq!(some, ["blind", "blind", "mute", "mute"]);
    let loss = json!({"kind": "loss", "loss": 1});
    assert_eq!(of(&json!([loss])), [""; 4], "no robot of its own fails");
}

#[test]
fn other_seeds_and_other_failures_have_other_robots() {
    let stopped = |failures: &Value, seed: u64| {
        let mut arena = arena(failures, 20, seed);
        turns(&mut arena);
        let turns = turns(&mut arena);
        turns
            .iter()
            .map(|turn| turn.abs() < 1e-3)
            .collect::<Vec<_>>()
    };
    let one = json!([{"kind": "stop", "share": 0.5}]);
    let second = json!([{"kind": "mute", "share": 0}, {"kind": "stop", "share": 0.5}]);
    assert_eq!(stopped(&one, 1), stopped(&one, 1));
    assert_ne!(stopped(&one, 1), stopped(&one, 2));
    assert_ne!(stopped(&one, 1), stopped(&second, 1));
}

#[test]
fn slow_robots_do_a_part_of_what_they_are_told() {
    let mut arena = arena(
        &json!([{"kind": "slow", "share": 0.25, "factor": 0.5}]),
        20,
        3,
    );
    turns(&mut arena);
    let turns = turns(&mut arena);
    assert_eq!((count(&turns, TURN / 2.0), count(&turns, TURN)), (5, 15));
}

#[test]
fn blind_robots_sense_nothing() {
    let mut arena = arena(&json!([{"kind": "blind", "share": 0.4, "at": 0.1}]), 10, 3);
    let blind = |arena: &Arena| {
        sensed(arena)
            .iter()
            .filter(|numbers| **numbers == [0.0; 4])
            .count()
    };
    assert_eq!(blind(&arena), 0);
    turns(&mut arena);
    assert_eq!(blind(&arena), 4);
}

#[test]
fn mute_robots_are_not_heard_and_lost_messages_do_not_arrive() {
    // Two robots, of which one is mute: the other one hears nothing.
    let mut two = arena(&json!([{"kind": "mute", "share": 0.5}]), 2, 5);
    turns(&mut two);
    let mut heard: Vec<[f32; 2]> = sensed(&two).iter().map(|n| [n[2], n[3]]).collect();
    heard.sort_by(|a, b| a[0].total_cmp(&b[0]));
    assert_eq!(heard, [[0.0, 0.0], [1.0, 1.0]]);
    let links = two.scene().unwrap().links;
    assert_eq!(links.len(), 1, "the mute one hears the other");
    assert_eq!(sensed(&two)[links[0][1] as usize][2..], [1.0, 1.0]);
    let mut all = arena(&json!([{"kind": "loss", "loss": 1, "at": 0.2}]), 2, 5);
    for heard in [1.0, 1.0, 0.0, 0.0] {
        assert!(sensed(&all).iter().all(|numbers| numbers[2] == heard));
        let links = all.scene().unwrap().links.len();
        assert_eq!(links, if heard > 0.0 { 2 } else { 0 });
        turns(&mut all);
    }
}

/// The share of messages that arrive, for robots with a loss of their own.
fn received(own: f32, failures: &Value) -> f32 {
    let robot = json!({
        "radius": 0.02,
        "drive": {"kind": "holonomic", "max_speed": 0.1, "max_turn": 90},
        "sensors": [{"kind": "range_and_bearing", "range": 100, "loss": own, "gives": ["count"],
            "radio": {"line_of_sight": false}}],
    });
    let mission = json!({"walls": {"rectangle": [40, 40]}, "start": {"disc": {"radius": 15}}, "fitness": "order"});
    let parameters =
        json!({"mission": mission, "robot": robot, "robots": 100, "failures": failures});
    let mut arena = Arena::default();
    arena.reset(parameters.as_object().unwrap()).unwrap();
    let acting = arena.acting();
    let heard = acting.iter().map(|agent| {
        let mut number = [0.0];
        arena.sense(*agent, &mut number);
        number[0]
    });
    heard.sum::<f32>() / (100.0 * 99.0)
}

#[test]
fn failures_lose_messages_in_addition_to_the_robots_own_loss() {
    let loss = |loss: f32| json!({"kind": "loss", "loss": loss});
    let cases = [
        (0.6, json!([]), 0.4),
        (0.6, json!([loss(0.5)]), 0.2),
        (0.6, json!([loss(0.5), loss(0.25)]), 0.15),
        (0.0, json!([loss(0.5), loss(0.5)]), 0.25),
        (0.6, json!([loss(0.0)]), 0.4),
        (0.6, json!([loss(1.0)]), 0.0),
    ];
    for (own, failures, expected) in cases {
        let share = received(own, &failures);
        // Four standard deviations of 9,900 messages are at most 0.02.
        assert!((share - expected).abs() < 0.02, "{failures}: {share}");
    }
}

#[test]
fn failures_without_an_effect_are_refused() {
    let of = |failures: Value| {
        let parameters = json!({"robots": 7, "duration": 20, "failures": failures});
        let refused = Arena::default().reset(parameters.as_object().unwrap());
        refused.map_err(|error| error.to_string())
    };
    let late =
        of(json!([{"kind": "loss", "loss": 1, "at": 5}, {"kind": "loss", "loss": 1, "at": 20}]));
    assert_eq!(
        late.unwrap_err(),
        "parameter failures[1].at: 20 s found, but the episode ends after 20 s: expected less"
    );
    let few = of(json!([{"kind": "stop", "share": 0.07}]));
    assert_eq!(
        few.unwrap_err(),
        "parameter failures[0].share: 0.07 of 7 robots is less than half a robot: expected 0, or at least 0.0714"
    );
    let possible = json!([
        {"kind": "stop", "share": 0.0715, "at": 19.9},
        {"kind": "mute", "share": 0},
        {"kind": "loss", "loss": 0},
    ]);
    assert_eq!(of(possible), Ok(()));
}

#[test]
fn mistakes_name_the_place() {
    let of = |failures: Value| {
        let parameters = json!({"failures": failures});
        let refused = Arena::default().reset(parameters.as_object().unwrap());
        refused.unwrap_err().to_string()
    };
    let cases = [
        (
            of(json!("stop")),
            "failures: \"stop\" found, expected a list",
        ),
        (
            of(json!([{"kind": "stops", "share": 1}])),
            "failures[0].kind: \"stops\" found, expected one of \"stop\"",
        ),
        (
            of(json!([{"kind": "stop"}])),
            "failures[0]: missing field `share`",
        ),
        (
            of(json!([{"kind": "stop", "share": "half"}])),
            "failures[0].share: \"half\" (a string) found, expected a number",
        ),
        (
            of(json!([{"kind": "mute", "share": 0}, {"kind": "stop", "share": 20}])),
            "failures[1].share: 20 found",
        ),
        (
            of(json!([{"kind": "slow", "share": 1, "factor": 2}])),
            "failures[0].factor: 2 found",
        ),
        (
            of(json!([{"kind": "blind", "share": 1, "at": 5, "until": 5}])),
            "failures[0].until: 5 found",
        ),
        (
            of(json!([{"kind": "stop", "share": 1, "at": -1}])),
            "failures[0].at: -1 found",
        ),
    ];
    for (message, expected) in cases {
        assert!(message.contains(expected), "{message:?} lacks {expected:?}");
    }
    let mission = json!({"walls": {"rectangle": [4, 4]}, "start": {"disc": {"radius": 1}}, "fitness": "order",
        "failures": [{"kind": "loss", "loss": 2}]});
    let parameters = json!({"mission": mission});
    let refused = Arena::default()
        .reset(parameters.as_object().unwrap())
        .unwrap_err();
    assert!(
        refused
            .to_string()
            .contains("mission.failures[0].loss: 2 found")
    );
}
