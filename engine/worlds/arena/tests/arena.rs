//! The arena: motion as measured in ARGoS, missions, and what is refused.
#![allow(clippy::unwrap_used)] // helpers of tests

use serde_json::{Value, json};
use swarmwright_controllers::{Architecture, Controller};
use swarmwright_kernels::Arena;
use swarmwright_simulation::{Scene, Simulation, rollout};

fn arena(parameters: &Value) -> Result<Arena, String> {
    let mut arena = Arena::default();
    arena
        .reset(parameters.as_object().unwrap())
        .map_err(|error| error.to_string())?;
    Ok(arena)
}

fn positions(scene: &Scene) -> Vec<[f32; 2]> {
    let agents = scene.bodies.iter().filter(|body| body.kind == "agent");
    agents.map(|body| [body.x, body.y]).collect()
}

/// A mission in a large empty arena.
fn empty_arena() -> Value {
    json!({"walls": {"rectangle": [20, 20]}, "start": {"rectangle": {"x": [-1, 1], "y": [-1, 1]}},
        "metrics": {}, "fitness": {"factors": {}}})
}

/// How far robots go in each tick with these actuators.
fn ways(actuators: [f32; 2], ticks: u32, seed: u64) -> Vec<f64> {
    let mut arena =
        arena(&json!({"mission": empty_arena(), "robots": 1, "duration": 60, "seed": seed}))
            .unwrap();
    let mut at = positions(&arena.scene().unwrap())[0];
    (0..ticks)
        .map(|_| {
            arena.step(&actuators);
            let now = positions(&arena.scene().unwrap())[0];
            let way = (f64::from(now[0] - at[0])).hypot(f64::from(now[1] - at[1]));
            at = now;
            way
        })
        .collect()
}

#[test]
fn a_robot_drives_as_measured() {
    // With noise of 5 % on both wheels: the means over seeds.
    let runs: Vec<Vec<f64>> = (0..200).map(|seed| ways([1.0, 1.0], 3, seed)).collect();
    let mean = |tick: usize| runs.iter().map(|run| run[tick]).sum::<f64>() / runs.len() as f64;
    // 9.45 mm from rest, then 12 mm a tick.
    assert!((mean(0) - 0.00945).abs() < 6e-5, "{}", mean(0));
    assert!((mean(1) - 0.012).abs() < 1e-4, "{}", mean(1));
    assert!((mean(2) - 0.012).abs() < 1e-4, "{}", mean(2));
    // Standing robots stand: noise is relative.
    assert_eq!(ways([0.0, 0.0], 5, 1), [0.0; 5]);
}

#[test]
fn robots_neither_leave_nor_run_through_each_other() {
    for (mission, robots) in [
        ("aac", 40),
        ("sca", 30),
        ("guided_shelter", 30),
        ("directional_gate", 30),
    ] {
        let parameters = json!({"mission": mission, "robots": robots, "duration": 40, "seed": 7});
        let mut arena = arena(&parameters).unwrap();
        let mut step = 0_u32;
        while !arena.done() {
            // All drive ahead, now and then they turn.
            let turn = if step % 40 < 30 { 1.0 } else { 0.2 };
            let actuators = [turn, 1.0].repeat(arena.acting().len());
            arena.step(&actuators);
            step += 1;
        }
        let scene = arena.scene().unwrap();
        let robots = positions(&scene);
        // The arena is a regular polygon; a lamp beside it is in the picture, too.
        let corners = scene.floor.unwrap().points;
        let middle =
            [0, 1].map(|axis| corners.iter().map(|p| p[axis]).sum::<f32>() / corners.len() as f32);
        for (index, a) in robots.iter().enumerate() {
            let from_middle = (a[0] - middle[0]).hypot(a[1] - middle[1]);
            assert!(from_middle < 1.24, "{mission}: {from_middle}");
            for b in &robots[..index] {
                let apart = (a[0] - b[0]).hypot(a[1] - b[1]);
                assert!(apart > 0.066, "{mission}: {apart}");
            }
        }
    }
}

#[test]
fn every_mission_runs_and_its_fitness_is_a_number() {
    let missions = swarmwright_arena::missions();
    let files = std::fs::read_dir(concat!(env!("CARGO_MANIFEST_DIR"), "/src/missions")).unwrap();
    let texts =
        files.filter(|file| file.as_ref().unwrap().path().extension() == Some("yaml".as_ref()));
    assert_eq!(missions.len(), texts.count(), "every text is a mission");
    for mission in missions.iter().map(|mission| mission.name) {
        let own = json!({"mission": mission, "duration": 5, "seed": 3});
        let several = !arena(&own).unwrap().groups().is_empty();
        for (robot, sensors) in [("e-puck-rm1.1", 24), ("e-puck-rm1.2", 9)] {
            let mut parameters = own.clone();
            if !several {
                parameters["robot"] = json!(robot);
            }
            let mut arena = arena(&parameters).unwrap();
            let sensors = if several {
                arena.description().sensors
            } else {
                sensors
            };
            assert_eq!(arena.description().sensors, sensors);
            assert_eq!(arena.sensor_names().len(), sensors);
            let mut numbers = vec![0.0; sensors];
            while !arena.done() {
                for agent in arena.acting() {
                    arena.sense(*agent, &mut numbers);
                    assert!(numbers.iter().all(|number| number.is_finite()), "{mission}");
                }
                arena.step(&[0.9, 1.0].repeat(arena.acting().len()));
            }
            assert!(arena.fitness().is_finite(), "{mission}");
            assert_eq!(arena.metrics().len(), arena.description().metrics.len());
        }
    }
}

/// Means and deviations over 30 seeds in ARGoS 3 (e-puck plug-in v59), 120 s: shared/data/argos.
#[test]
fn objectives_agree_with_those_of_argos() {
    let hand = [
        -1.5, -3.0, -0.5, -2.0, 0.0, -0.8, 0.0, 0.0, 0.0, 0.0, -0.8, 0.0, -2.0, -0.5, -3.0, -1.5,
        -0.2, 0.4, -0.4, 0.4, -0.5, 0.4, -0.2, 0.2, 0.2, -0.2, 0.4, -0.5, 0.4, -0.4, 0.4, -0.2,
        0.4, 0.4, 0.4, 0.4, 0.4, 0.4, -0.1, -0.1, -0.6, 0.6, -0.8, 0.8, 0.8, -0.8, 0.6, -0.6, 0.05,
        0.05,
    ];
    let architecture = json!({"kind": "evostick", "version": 1, "sensors": 24, "actuators": 2});
    let architecture = Architecture::from_json(&architecture.to_string())
        .unwrap()
        .into();
    let controller = Controller::with_weights(&architecture, hand.as_slice().into()).unwrap();
    for (mission, mean, deviation) in [("aac", 1190.0, 937.0), ("lcn", 0.500, 0.0329)] {
        let mut arena = Arena::default();
        let scores: Vec<f64> = (1..=30)
            .map(|seed| {
                let parameters = json!({"mission": mission, "seed": seed});
                rollout(&mut arena, parameters.as_object().unwrap(), &controller).unwrap()
            })
            .collect();
        let ours = scores.iter().sum::<f64>() / 30.0;
        let error = deviation * (2.0_f64 / 30.0).sqrt();
        assert!(
            (ours - mean).abs() < 3.0 * error,
            "{mission}: {ours}, ARGoS {mean}"
        );
    }
}

#[test]
fn the_scene_has_all_that_the_mission_has() {
    let mission = json!({"walls": {"rectangle": [3, 2]},
        "obstacles": [{"center": [0.5, 0], "size": [0.1, 0.8], "angle": 10, "height": 0.08}],
        "floor": {"color": "grey", "patches": [
            {"name": "west", "circle": {"center": [-1.2, 0.6], "radius": 0.25}, "color": "black"},
            {"name": "east", "rectangle": {"x": [1, 9], "y": [-1, -0.5]}, "color": "white"}]},
        "lights": [{"at": [0, 1.2, 0.4], "intensity": 2}],
        "start": {"rectangle": {"x": [-1.4, 0], "y": [-0.9, 0.9]}},
        "metrics": {}, "fitness": {"factors": {}}});
    let arena = arena(&json!({"mission": mission, "robots": 12, "seed": 5})).unwrap();
    let scene = arena.scene().unwrap();
    // The lamp stands behind the wall.
    assert_eq!((scene.width, scene.height, scene.step), (3.1, 2.35, 0));
    assert_eq!(scene.origin, [-1.55, -1.05]);
    let near = |a: [f32; 2], b: [f32; 2]| (a[0] - b[0]).abs() < 1e-5 && (a[1] - b[1]).abs() < 1e-5;
    let corners = [[0.05, 0.05], [3.05, 0.05], [3.05, 2.05], [0.05, 2.05]];
    let floor = scene.floor.as_ref().unwrap();
    assert!(floor.points.iter().zip(corners).all(|(a, b)| near(*a, b)));
    assert_eq!(floor.points.len(), 4);
    assert!((floor.grey - 0.5).abs() < 0.002, "a level of 8 bits");
    let [around, obstacle] = &scene.walls[..] else {
        panic!("{:?}", scene.walls)
    };
    assert_eq!((around.points.len(), around.solid), (5, false));
    assert!(near(around.points[4], corners[0]), "it is closed");
    assert_eq!((obstacle.points.len(), obstacle.solid), (4, true));
    let west = &scene.patches[0];
    assert!(near(west.points[0], [0.35, 1.65]));
    assert_eq!(
        (west.name.as_str(), west.radius, west.grey),
        ("west", 0.25, 0.0)
    );
    let east: Vec<f32> = scene.patches[1].points.iter().map(|p| p[0]).collect();
    assert!(east.iter().all(|x| (2.5..=3.11).contains(x)), "{east:?}");
    assert!(near([scene.lights[0].x, scene.lights[0].y], [1.55, 2.25]));
    assert_eq!(scene.rays.len(), 12 * 8);
    assert!(scene.bodies.iter().all(|body| body.heading.is_some()));
    // A robot that hears another one is heard by it: robots are alike and see as far.
    assert!(!scene.links.is_empty());
    for [from, to] in &scene.links {
        assert!(scene.links.contains(&[*to, *from]), "{from} {to}");
        let [a, b] = [from, to].map(|index| &scene.bodies[*index as usize]);
        assert!((a.x - b.x).hypot(a.y - b.y) < 0.7);
    }
}

#[test]
fn the_floor_ends_at_walls_that_are_not_convex() {
    let corners = json!([[-1, -1], [1, -1], [1, 0], [0, 0], [0, 1], [-1, 1]]);
    let mission = json!({"walls": {"corners": corners},
        "obstacles": [{"center": [-0.5, -0.5], "size": [0.2, 0.1]}],
        "start": {"rectangle": {"x": [-0.9, -0.2], "y": [0.1, 0.9]}},
        "metrics": {}, "fitness": {"factors": {}}});
    let arena = arena(&json!({"mission": mission, "robots": 2})).unwrap();
    let scene = arena.scene().unwrap();
    assert_eq!(scene.floor.unwrap().points.len(), 6);
    let walls: Vec<(usize, bool)> = scene
        .walls
        .iter()
        .map(|wall| (wall.points.len(), wall.solid))
        .collect();
    assert_eq!(walls, [(7, false), (4, true)]);
}
