//! Machines of modules: what they do, step by step, and how often what is left to chance happens.
#![allow(clippy::unwrap_used)] // helpers of tests

use serde_json::json;
use swarmwright_controllers::{
    BEHAVIOUR_NAMES, CONDITION_NAMES, Controller, Specification, SpecificationError,
};

const STRAIGHT: [f32; 2] = [1.0, 1.0];

/// A state: behaviour, rwm, alpha, transitions of target, condition, probability, xi and eta.
type State<'a> = (&'a str, f32, f32, &'a [(usize, &'a str, f32, f32, f32)]);

fn number(names: &[&str], name: &str) -> f32 {
    names.iter().position(|other| *other == name).unwrap() as f32
}

fn machine(states: &[State<'_>]) -> Controller {
    let mut weights = vec![states.len() as f32];
    for (behaviour, rwm, alpha, transitions) in states {
        weights.extend([
            number(&BEHAVIOUR_NAMES, behaviour),
            *rwm,
            *alpha,
            transitions.len() as f32,
        ]);
        for (target, condition, probability, xi, eta) in *transitions {
            let condition = number(&CONDITION_NAMES, condition);
            weights.extend([*target as f32, condition, *probability, *xi, *eta]);
        }
        weights.resize(weights.len() + 5 * (4 - transitions.len()), 0.0);
    }
    let document = json!({"version": 1, "kind": "modules", "sensors": 9, "actuators": 2, "states": states.len(),
        "transitions": 4, "weights": weights});
    Controller::new(&Specification::from_json(&document.to_string()).unwrap())
}

/// Sensors: proximity, light, ground, neighbours, attraction, and a random number that counts up to all multiples of 2^-24.
struct Sensed {
    values: [f32; 9],
    drawn: u32,
}

impl Sensed {
    fn new() -> Self {
        let mut values = [0.0; 9];
        values[4] = 0.5;
        Self { values, drawn: 7 }
    }

    fn step(&mut self, controller: &mut Controller) -> [f32; 2] {
        // An odd stride goes through all of them.
        self.drawn = (self.drawn + 5_764_801) % (1 << 24);
        self.values[8] = self.drawn as f32 / 16_777_216.0;
        let mut actuators = [f32::NAN; 2];
        controller.step(&self.values, &mut actuators).unwrap();
        actuators
    }
}

fn close(actual: f64, expected: f64, count: usize) {
    let deviation = (expected * (1.0 - expected) / count as f64)
        .sqrt()
        .max(1e-9);
    assert!(
        (actual - expected).abs() < 4.5 * deviation,
        "{actual} instead of {expected}"
    );
}

/// How often the first state is left, of all steps in which it may be left.
fn share(
    condition: &str,
    probability: f32,
    (xi, eta): (f32, f32),
    sense: impl Fn(&mut Sensed),
) -> f64 {
    let mut controller = machine(&[
        ("stop", 1.0, 1.0, &[(1, condition, probability, xi, eta)]),
        (
            "phototaxis",
            1.0,
            1.0,
            &[(0, "fixed_probability", 1.0, 1.0, 0.0)],
        ),
    ]);
    let mut sensed = Sensed::new();
    sense(&mut sensed);
    let (mut chances, mut left, mut entered) = (0, 0, true);
    for _ in 0..60_000 {
        let stops = sensed.step(&mut controller) == [0.0, 0.0];
        if stops && !entered {
            chances += 1;
        }
        entered = !stops;
    }
    // Each visit of the other state takes two steps; count them anew.
    controller.reset();
    let mut before = true;
    for _ in 0..60_000 {
        let stops = sensed.step(&mut controller) == [0.0, 0.0];
        left += usize::from(before && !stops);
        before = stops;
    }
    if chances == 0 {
        0.0
    } else {
        left as f64 / chances as f64
    }
}

#[test]
fn transitions_are_made_with_their_probability() {
    for probability in [0.0, 0.03, 0.5, 1.0] {
        let found = share("fixed_probability", probability, (1.0, 0.0), |_| ());
        assert!(
            (found - f64::from(probability)).abs() < 0.02,
            "{found} instead of {probability}"
        );
    }
    for (condition, ground) in [
        ("black_floor", 0.1),
        ("grey_floor", 0.5),
        ("white_floor", 0.95),
    ] {
        for seen in [0.0, 0.1, 0.11, 0.5, 0.94, 0.95, 1.0] {
            let kind = |value: f32| {
                if value <= 0.1 {
                    0
                } else if value >= 0.95 {
                    2
                } else {
                    1
                }
            };
            let expected = if kind(seen) == kind(ground) { 0.4 } else { 0.0 };
            let found = share(condition, 0.4, (1.0, 0.0), |sensed| sensed.values[4] = seen);
            assert!(
                (found - expected).abs() < 0.02,
                "{condition} at {seen}: {found}"
            );
        }
    }
    for (condition, sign) in [("neighbours", 1.0), ("few_neighbours", -1.0)] {
        for neighbours in [0.0, 3.0, 4.0, 9.0] {
            let expected = 1.0 / (1.0 + (-sign * 0.8 * (f64::from(neighbours) - 4.0)).exp());
            let found = share(condition, 0.0, (4.0, 0.8), |sensed| {
                sensed.values[5] = neighbours
            });
            assert!(
                (found - expected).abs() < 0.02,
                "{condition} of {neighbours}: {found}"
            );
        }
    }
}

#[test]
fn one_of_those_that_hold_is_made_and_all_are_equally_likely() {
    let back: &[_] = &[(0, "fixed_probability", 1.0, 1.0, 0.0)];
    let mut controller = machine(&[
        (
            "stop",
            1.0,
            1.0,
            &[
                (1, "fixed_probability", 1.0, 1.0, 0.0),
                (2, "white_floor", 1.0, 1.0, 0.0),
                (2, "grey_floor", 1.0, 1.0, 0.0),
                (3, "fixed_probability", 0.5, 1.0, 0.0),
            ],
        ),
        ("phototaxis", 1.0, 1.0, back),
        ("anti_phototaxis", 1.0, 1.0, back),
        ("exploration", 1.0, 1.0, back),
    ]);
    let mut sensed = Sensed::new();
    (sensed.values[2], sensed.values[3]) = (0.0, 1.0);
    let (mut counts, mut before) = ([0_usize; 3], true);
    let visits = 30_000;
    while counts.iter().sum::<usize>() < visits {
        let [left, right] = sensed.step(&mut controller);
        let place = match (left, right) {
            (0.0, 0.0) => None,
            _ if left < right => Some(0),
            _ if left > right => Some(1),
            _ => Some(2),
        };
        if let (true, Some(place)) = (before, place) {
            counts[place] += 1;
        }
        before = place.is_none();
    }
    // Two of them hold, and a third one in half of the steps.
    let share = |place: usize| counts[place] as f64 / visits as f64;
    close(share(0), 5.0 / 12.0, visits);
    close(share(1), 5.0 / 12.0, visits);
    close(share(2), 1.0 / 6.0, visits);
}

#[test]
fn a_state_that_was_entered_is_left_a_step_later_at_the_soonest() {
    let mut controller = machine(&[
        ("stop", 1.0, 1.0, &[(1, "fixed_probability", 1.0, 1.0, 0.0)]),
        (
            "exploration",
            1.0,
            1.0,
            &[(0, "fixed_probability", 1.0, 1.0, 0.0)],
        ),
    ]);
    let mut sensed = Sensed::new();
    let steps: Vec<bool> = (0..8)
        .map(|_| sensed.step(&mut controller) == STRAIGHT)
        .collect();
    assert_eq!(steps, [false, false, true, true, false, false, true, true]);
}

#[test]
fn robots_turn_away_on_the_spot_for_a_random_time() {
    let mut controller = machine(&[("exploration", 10.0, 1.0, &[])]);
    let mut sensed = Sensed::new();
    let mut lengths = [0_usize; 11];
    for side in [-0.2_f32, 0.2] {
        for _ in 0..10_000 {
            // In the step that detects an obstacle the robot still drives ahead.
            (sensed.values[0], sensed.values[1]) = (0.1, side);
            assert_eq!(sensed.step(&mut controller), STRAIGHT);
            (sensed.values[0], sensed.values[1]) = (0.0, 0.0);
            let away = if side < 0.0 { [-1.0, 1.0] } else { [1.0, -1.0] };
            let mut length = 0;
            while sensed.step(&mut controller) == away {
                length += 1;
            }
            lengths[length] += 1;
        }
    }
    assert_eq!((lengths[0], lengths[10]), (0, 0));
    // Not at all is as long as once.
    close(lengths[1] as f64 / 20_000.0, 0.2, 20_000);
    for length in &lengths[2..10] {
        close(*length as f64 / 20_000.0, 0.1, 20_000);
    }
}

#[test]
fn obstacles_behind_and_far_ones_are_none() {
    for (x, y, turns) in [
        (0.1, 0.0, true),
        (0.0, 0.1, true),
        (0.06, -0.081, true),
        (0.09, 0.0, false),
        (-0.01, 0.5, false),
        (-1.0, 0.0, false),
    ] {
        let mut controller = machine(&[("exploration", 10.0, 1.0, &[])]);
        let mut sensed = Sensed::new();
        (sensed.values[0], sensed.values[1]) = (x, y);
        sensed.step(&mut controller);
        assert_eq!(sensed.step(&mut controller) != STRAIGHT, turns, "{x}, {y}");
    }
}

/// Behaviour, alpha, proximity, light, attraction.
type Case = (&'static str, f32, [f32; 2], [f32; 2], [f32; 2]);

#[test]
fn vectors_are_followed_with_the_outer_wheel_at_full_speed() {
    let cases: [Case; 6] = [
        ("phototaxis", 1.0, [0.0, 0.0], [0.6, 0.8], [0.0, 0.0]),
        ("phototaxis", 1.0, [0.2, -0.1], [0.6, 0.8], [0.3, 0.3]),
        ("anti_phototaxis", 1.0, [0.1, 0.1], [0.6, -0.8], [0.3, 0.3]),
        ("attraction", 3.0, [0.05, 0.02], [1.0, 0.0], [-0.2, 0.1]),
        ("repulsion", 3.0, [0.05, 0.02], [1.0, 0.0], [0.2, -0.1]),
        ("attraction", 2.9, [0.0, 0.0], [1.0, 0.0], [0.01, -0.02]),
    ];
    for (behaviour, alpha, proximity, light, attraction) in cases {
        let mut controller = machine(&[(behaviour, 1.0, alpha, &[])]);
        let mut sensed = Sensed::new();
        sensed.values[..4].copy_from_slice(&[proximity, light].concat());
        sensed.values[6..8].copy_from_slice(&attraction);
        let alpha = alpha.trunc();
        let axis = |axis: usize| match behaviour {
            "phototaxis" => light[axis] - 5.0 * proximity[axis],
            "anti_phototaxis" => -light[axis] - 5.0 * proximity[axis],
            "attraction" => alpha * attraction[axis] - 6.0 * proximity[axis],
            _ => -alpha * alpha * attraction[axis] - 5.0 * proximity[axis],
        };
        let (x, y) = (axis(0), axis(1));
        let length = x.hypot(y);
        let expected = if length < 0.1 {
            STRAIGHT
        } else if y > 0.0 {
            [x / length, 1.0]
        } else {
            [1.0, x / length]
        };
        let found = sensed.step(&mut controller);
        for (found, expected) in found.iter().zip(expected) {
            assert!(
                (found - expected).abs() < 1e-6,
                "{behaviour}: {found} instead of {expected}"
            );
        }
    }
}

/// A tree: of each subtree the condition with its probability, and the behaviour.
fn tree(subtrees: &[(&str, f32, &str)]) -> Controller {
    let mut weights = vec![subtrees.len() as f32];
    for (condition, probability, behaviour) in subtrees {
        let (behaviour, condition) = (
            number(&BEHAVIOUR_NAMES, behaviour),
            number(&CONDITION_NAMES, condition),
        );
        weights.extend([behaviour, 10.0, 1.0, 0.0]);
        weights.extend([7.0, condition, *probability, 1.0, 0.0]);
    }
    let document = json!({"version": 1, "kind": "modules", "form": "tree", "sensors": 9, "actuators": 2,
        "states": subtrees.len(), "transitions": 1, "weights": weights});
    Controller::new(&Specification::from_json(&document.to_string()).unwrap())
}

#[test]
fn a_tree_goes_on_with_the_subtree_that_acted_and_begins_again_after_the_last() {
    const TO_THE_LIGHT: [f32; 2] = [0.0, 1.0];
    const STOPPED: [f32; 2] = [0.0, 0.0];
    let mut controller = tree(&[
        ("black_floor", 1.0, "exploration"),
        ("white_floor", 1.0, "phototaxis"),
        ("fixed_probability", 1.0, "stop"),
    ]);
    let mut sensed = Sensed::new();
    (sensed.values[2], sensed.values[3]) = (0.0, 1.0);
    for (ground, expected) in [
        (0.5, STRAIGHT),
        (1.0, STRAIGHT),
        // The first condition holds, and the second subtree acts in the same step.
        (0.0, TO_THE_LIGHT),
        (0.5, TO_THE_LIGHT),
        (0.0, TO_THE_LIGHT),
        // All conditions hold: no action.
        (1.0, STOPPED),
        (0.5, STRAIGHT),
    ] {
        sensed.values[4] = ground;
        assert_eq!(sensed.step(&mut controller), expected, "{ground}");
    }
}

#[test]
fn a_tree_of_one_subtree_stops_as_often_as_its_condition_holds() {
    let mut controller = tree(&[("fixed_probability", 0.25, "exploration")]);
    let mut sensed = Sensed::new();
    let steps = 40_000;
    let stops = (0..steps).filter(|_| sensed.step(&mut controller) == [0.0, 0.0]);
    close(stops.count() as f64 / f64::from(steps), 0.25, 40_000);
}

#[test]
fn conditions_of_a_tree_draw_random_numbers_of_their_own() {
    let half = ("fixed_probability", 0.5, "exploration");
    let mut controller = tree(&[half, half, half, ("fixed_probability", 0.5, "phototaxis")]);
    let mut sensed = Sensed::new();
    (sensed.values[2], sensed.values[3]) = (0.0, 1.0);
    let (mut stops, steps) = (0, 40_000);
    for _ in 0..steps {
        stops += usize::from(sensed.step(&mut controller) == [0.0, 0.0]);
    }
    // Each of four conditions fails once on average, which is a step, and then comes the stop.
    close(stops as f64 / f64::from(steps), 0.2, 15_000);
}

#[test]
fn a_turn_ends_with_its_subtree() {
    let mut controller = tree(&[
        ("black_floor", 1.0, "exploration"),
        ("white_floor", 1.0, "exploration"),
    ]);
    let mut sensed = Sensed::new();
    for _ in 0..200 {
        (sensed.values[0], sensed.values[1], sensed.values[4]) = (0.5, 0.1, 0.5);
        sensed.step(&mut controller);
        (sensed.values[0], sensed.values[1]) = (0.0, 0.0);
        assert_ne!(sensed.step(&mut controller), STRAIGHT);
        sensed.values[4] = 0.0;
        assert_eq!(sensed.step(&mut controller), STRAIGHT);
        // Both conditions cannot hold at a time: from the second back to the first over the end.
        sensed.values[4] = 1.0;
        assert_eq!(sensed.step(&mut controller), [0.0, 0.0]);
    }
}

#[test]
fn a_tree_has_four_subtrees_and_one_condition_each() {
    let read = |form: &str, states: usize, transitions: usize| {
        let document = json!({"version": 1, "kind": "modules", "form": form, "sensors": 9, "actuators": 2,
            "states": states, "transitions": transitions});
        swarmwright_controllers::Architecture::from_json(&document.to_string())
    };
    let wrong = |found: Result<swarmwright_controllers::Architecture, SpecificationError>| {
        found.map_or_else(|error| error.to_string(), |_| String::new())
    };
    assert!(read("tree", 4, 1).is_ok());
    assert_eq!(read("machine", 5, 2).unwrap(), {
        let document = json!({"version": 1, "kind": "modules", "sensors": 9, "actuators": 2, "states": 5, "transitions": 2});
        swarmwright_controllers::Architecture::from_json(&document.to_string()).unwrap()
    });
    assert!(
        wrong(read("tree", 5, 1)).contains("states: 5 found, expected a whole number from 1 to 4")
    );
    assert!(wrong(read("tree", 4, 2)).contains("transitions: 2 found, expected 1"));
    assert!(
        wrong(read("bush", 4, 1)).contains("form: \"bush\" found, expected one of machine, tree")
    );
}
