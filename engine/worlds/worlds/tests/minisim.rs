//! Episodes of Minisim computed by hand, and what holds in every episode.
#![allow(clippy::unwrap_used, clippy::panic)] // helpers of tests

use proptest::prelude::*;
use serde_json::{Value, json};
use swarmwright_worlds::{Body, Minisim, Parameters, Simulation};

fn parameters(document: Value) -> Parameters {
    document.as_object().unwrap().clone()
}

fn start(document: Value) -> Minisim {
    let mut simulation = Minisim::default();
    simulation.reset(&parameters(document)).unwrap();
    simulation
}

fn bodies(simulation: &Minisim, kind: &str) -> Vec<Body> {
    simulation
        .scene()
        .unwrap()
        .bodies
        .into_iter()
        .filter(|b| b.kind == kind)
        .collect()
}

/// Drives all agents with one heading to the end; the number of steps.
fn straight(simulation: &mut Minisim, heading: f32) -> u32 {
    let mut steps = 0;
    while !simulation.acting().is_empty() {
        simulation.step(&vec![heading; simulation.acting().len()]);
        steps += 1;
    }
    steps
}

#[test]
fn straight_on_the_defender_catches_the_agent() {
    // They close in by 1.33 a step from 7.5 apart: 0.85 after 5 steps. In the sixth the agent steps to 6.5, and the
    // defender at 6.35 reaches it. Caught 6 from the goal at 12.5.
    let mut simulation = start(json!({}));
    assert_eq!(straight(&mut simulation, 0.0), 6);
    let (agent, defender) = (
        &bodies(&simulation, "agent")[0],
        &bodies(&simulation, "defender")[0],
    );
    assert_eq!((agent.x, agent.y, &*agent.state), (6.5, 3.5, "caught"));
    assert_eq!((defender.x, defender.y), (6.5, 3.5));
    assert_eq!(simulation.fitness(), -6.0);
}

#[test]
fn straight_on_without_defenders_arrives() {
    // 12 steps from 0.5 to 12.5; after 11 the distance is 1, more than the goal's radius of 0.5.
    let mut simulation = start(json!({"numDefenders": 0}));
    assert_eq!(straight(&mut simulation, 0.0), 12);
    assert_eq!(bodies(&simulation, "agent")[0].state, "arrived");
    assert_eq!(simulation.fitness().to_bits(), 0.0_f64.to_bits());
}

#[test]
fn upwards_the_border_stops_the_agent() {
    // 3.5 to 7 in four steps, then along the border; 15 steps are too few for the defender 7.5 away at 0.33.
    let mut simulation = start(json!({"defenders": [[8, 0]]}));
    assert_eq!(straight(&mut simulation, 0.5), 15);
    let agent = &bodies(&simulation, "agent")[0];
    assert_eq!((agent.x, agent.y, &*agent.state), (0.5, 7.0, "free"));
    assert_eq!(
        simulation.fitness(),
        -f64::from((12.0_f32 * 12.0 + 3.5 * 3.5).sqrt())
    );
}

#[test]
fn the_goal_comes_before_the_capture() {
    // Agent and defender both stand within reach after the step: arrived, not caught.
    let mut simulation = start(json!({"agents": [[11.5, 3.5]], "defenders": [[12.5, 3.5]]}));
    assert_eq!(straight(&mut simulation, 0.0), 1);
    assert_eq!(bodies(&simulation, "agent")[0].state, "arrived");
}

#[test]
fn defenders_turn_to_the_closest_free_agent() {
    // The agent at 3, 1 is caught in the first step; the defender then turns to the far one.
    let mut simulation = start(
        json!({"mapWidth": 20, "mapHeight": 2, "agents": [[3, 1], [15, 1]],
        "defenders": [[3.5, 1]], "speedAgents": 0, "speedDefenders": 1, "captureRadius": 0.25, "maxSteps": 3}),
    );
    simulation.step(&[0.0, 0.0]);
    assert_eq!(simulation.acting(), [1]);
    assert_eq!(bodies(&simulation, "defender")[0].x, 3.0);
    simulation.step(&[0.0]);
    assert_eq!(bodies(&simulation, "defender")[0].x, 4.0);
}

#[test]
fn ties_go_to_the_lower_index() {
    let mut simulation = start(
        json!({"mapWidth": 8, "mapHeight": 8, "agents": [[4, 6], [4, 2]],
        "defenders": [[4, 4]], "speedAgents": 0, "speedDefenders": 1}),
    );
    simulation.step(&[0.0, 0.0]);
    assert_eq!(bodies(&simulation, "defender")[0].y, 5.0);
}

#[test]
fn sensors_of_the_published_example() {
    let mut sensors = [9.0; 4];
    start(json!({})).sense(0, &mut sensors);
    assert_eq!(sensors, [12.0_f32 / 13.0, 0.0, 7.5_f32 / 13.0, 0.0]);
    start(json!({"numDefenders": 0, "goal": [0, 0]})).sense(0, &mut sensors);
    assert_eq!(sensors, [-0.5_f32 / 13.0, -0.5, 0.0, 0.0]);
}

#[test]
fn bodies_are_spread_where_nothing_is_listed() {
    let simulation =
        start(json!({"numAgents": 3, "numDefenders": 1, "mapWidth": 26, "mapHeight": 8}));
    let places = |kind| {
        bodies(&simulation, kind)
            .iter()
            .map(|b| (b.x, b.y))
            .collect::<Vec<_>>()
    };
    assert_eq!(places("agent"), [(0.5, 2.0), (0.5, 4.0), (0.5, 6.0)]);
    assert_eq!(places("defender"), [(16.0, 4.0)]);
    assert_eq!(places("goal"), [(25.5, 4.0)]);
}

#[test]
fn random_placement_follows_the_seed_alone() {
    let place = |seed: i64, agents: u32| {
        let simulation = start(
            json!({"placement": "random", "seed": seed, "numAgents": agents, "numDefenders": 50,
            "mapWidth": 30, "mapHeight": 20}),
        );
        (
            bodies(&simulation, "agent"),
            bodies(&simulation, "defender"),
        )
    };
    let (agents, defenders) = place(5, 50);
    assert!(
        agents
            .iter()
            .all(|b| (0.0..=10.0).contains(&b.x) && (0.0..=20.0).contains(&b.y))
    );
    assert!(
        defenders
            .iter()
            .all(|b| (10.0..=20.0).contains(&b.x) && (0.0..=20.0).contains(&b.y))
    );
    for (bodies, middle) in [(&agents, 5.0), (&defenders, 15.0)] {
        let (left, low) = (
            bodies.iter().filter(|b| b.x < middle).count(),
            bodies.iter().filter(|b| b.y < 10.0).count(),
        );
        assert!(
            (10..=40).contains(&left) && (10..=40).contains(&low),
            "spread over the third: {left}, {low}"
        );
    }
    assert_eq!(place(5, 50), (agents.clone(), defenders.clone()));
    assert_ne!(place(6, 50).0, agents);
    let (fewer, same) = place(5, 20);
    assert_eq!(
        (&fewer[..], same),
        (&agents[..20], defenders),
        "an agent's place does not depend on the others"
    );
    let listed = start(json!({"placement": "random", "seed": 5, "agents": [[1, 2]]}));
    assert_eq!(
        (bodies(&listed, "agent")[0].x, bodies(&listed, "agent")[0].y),
        (1.0, 2.0),
        "lists win"
    );
}

prop_compose! {
    fn worlds()(
        width in 1..30_u32,
        height in 1..30_u32,
        agents in 1..6_u32,
        defenders in 0..5_u32,
        speeds in prop::array::uniform2(0.0..3.0_f32),
        radii in prop::array::uniform2(0.0..2.0_f32),
        steps in 1..40_u32,
        random in any::<bool>(),
        seed in any::<u64>(),
    ) -> Value {
        json!({"mapWidth": width, "mapHeight": height, "numAgents": agents, "numDefenders": defenders,
            "speedAgents": speeds[0], "speedDefenders": speeds[1], "captureRadius": radii[0], "goalRadius": radii[1],
            "maxSteps": steps, "placement": if random { "random" } else { "fixed" }, "seed": seed})
    }
}

/// Plays headings drawn from `draws` in a circle; every scene, and the fitness.
fn play(simulation: &mut Minisim, draws: &[f32]) -> (Vec<Vec<Body>>, f64) {
    let mut draws = draws.iter().copied().cycle();
    let mut scenes = vec![simulation.scene().unwrap().bodies];
    while !simulation.acting().is_empty() {
        let actuators: Vec<f32> = simulation
            .acting()
            .iter()
            .map(|_| draws.next().unwrap())
            .collect();
        simulation.step(&actuators);
        scenes.push(simulation.scene().unwrap().bodies);
    }
    (scenes, simulation.fitness())
}

proptest! {
    #[test]
    fn what_holds_in_every_episode(world in worlds(), draws in prop::collection::vec(-1.0..=1.0_f32, 1..50)) {
        let (width, height) = (world["mapWidth"].as_f64().unwrap(), world["mapHeight"].as_f64().unwrap());
        let steps = usize::try_from(world["maxSteps"].as_u64().unwrap()).unwrap();
        let mut simulation = start(world.clone());
        let (scenes, fitness) = play(&mut simulation, &draws);

        prop_assert!((1..=steps).contains(&(scenes.len() - 1)), "{} steps", scenes.len() - 1);
        for body in scenes.iter().flatten() {
// A defender is not limited to the map; it may end a rounding error beyond an agent at its border.
            let slack = if body.kind == "defender" { 1e-5 } else { 0.0 };
            let inside = (-slack..=width + slack).contains(&f64::from(body.x))
                && (-slack..=height + slack).contains(&f64::from(body.y));
            prop_assert!(inside, "{body:?} is off the map");
        }
        for pair in scenes.windows(2) {
            for (before, after) in pair[0].iter().zip(&pair[1]) {
                prop_assert!(before.state == "free" || before.kind != "agent" || before == after,
                    "{before:?} became {after:?}");
            }
        }
        let last = scenes.last().unwrap();
        let count = |state| last.iter().filter(|body| body.state == state).count() as f64;
        let expected = [count("arrived"), count("caught"), (scenes.len() - 1) as f64, -fitness];
        prop_assert_eq!(simulation.metrics(), expected);
        // A distance is rounded to binary32.
        prop_assert!((-width.hypot(height) * (1.0 + 1e-6)..=0.0).contains(&fitness), "fitness {fitness}");

        simulation.reset(&parameters(world.clone())).unwrap();
        prop_assert_eq!(&play(&mut simulation, &draws), &(scenes, fitness), "the same after a reset");
    }

    #[test]
    fn defenders_keep_to_their_speed(world in worlds(), draws in prop::collection::vec(-1.0..=1.0_f32, 1..50)) {
        let speed = world["speedDefenders"].as_f64().unwrap();
        let (scenes, _) = play(&mut start(world), &draws);
        for pair in scenes.windows(2) {
            for (before, after) in pair[0].iter().zip(&pair[1]).filter(|(b, _)| b.kind == "defender") {
                let way = f64::from(after.x - before.x).hypot(f64::from(after.y - before.y));
                prop_assert!(way <= speed + 1e-5, "{way} in a step");
            }
        }
    }
}
