//! Grippers: what is held moves with the robot.
#![allow(clippy::unwrap_used)] // helpers of tests

use serde_json::{Value, json};
use swarmwright_kernels::Arena;
use swarmwright_simulation::Simulation;

/// A robot that pulls with 3 N, and goes as it is told.
fn robot() -> Value {
    json!({"radius": 0.05, "mass": 1, "sensors": [{"kind": "gripper"}], "actuators": [{"kind": "gripper"}],
        "drive": {"kind": "holonomic", "max_speed": 0.2, "max_turn": 0, "acceleration": 3}})
}

/// Robots one above the other, 5 mm west of a box that is held by its friction with the floor.
fn beside(robots: usize, mass: f64, friction: f64) -> Value {
    let kinds: Vec<Value> = (0..robots)
        .map(|index| json!({"name": format!("robot {index}"), "count": 1, "robot": robot()}))
        .collect();
    let reach = 0.12 * robots as f64;
    json!({
        "walls": {"rectangle": [4, 3]}, "robots": kinds,
        "objects": [{"name": "load", "size": [0.2, 0.6], "center": [0.1, 0], "mass": mass, "friction": friction}],
        "floor": {"patches": [{"name": "west", "rectangle": {"x": [-2, -0.1], "y": [-1, 1]}, "color": 0}]},
        "start": {"rectangle": {"x": [-0.0551, -0.0549], "y": [-reach / 2.0, reach / 2.0]}},
        "metrics": {
            "held": {"kind": "objects_held", "object": "load"},
            "share": {"kind": "objects_held", "when": "end", "share": true},
        },
        "fitness": "held",
    })
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

fn places(arena: &Arena, kind: &str) -> Vec<[f32; 2]> {
    let scene = arena.scene().unwrap();
    let bodies = scene.bodies.iter().filter(|body| body.kind == kind);
    bodies
        .map(|body| [body.x - scene.width / 2.0, body.y - scene.height / 2.0])
        .collect()
}

fn holds(arena: &Arena, agent: u32) -> f32 {
    let mut sensors = vec![0.0; arena.description().sensors];
    arena.sense(agent, &mut sensors);
    *sensors.last().unwrap()
}

/// All robots drive with these speeds along x, and grip where the number is above 0.
fn drive(arena: &mut Arena, along: f32, grip: f32, ticks: usize) {
    for _ in 0..ticks {
        let scene = arena.scene().unwrap();
        let headings = scene.bodies.iter().filter_map(|body| body.heading);
        let actuators: Vec<f32> = headings
            .flat_map(|heading| [heading.cos() * along, -heading.sin() * along, 0.0, grip])
            .collect();
        arena.step(&actuators);
    }
}

#[test]
fn what_is_held_is_pulled_until_it_is_let_go() {
    let mission = beside(1, 0.5, 0.2);
    let mut swarm = arena(&json!({"mission": mission}));
    assert_eq!(swarm.sensor_names(), ["holds"]);
    assert_eq!(swarm.actuator_names(), ["ahead", "left", "turn", "gripper"]);
    assert_eq!(holds(&swarm, 0), 0.0);
    drive(&mut swarm, -1.0, 0.5, 50);
    assert_eq!(holds(&swarm, 0), 1.0);
    let ([robot, ..], [load, ..]) = (&places(&swarm, "agent")[..], &places(&swarm, "object")[..])
    else {
        panic!("a robot and a load");
    };
    assert!(robot[0] < -0.8 && load[0] < -0.6, "{robot:?} {load:?}");
    assert!(
        (load[0] - robot[0] - 0.15).abs() < 0.005,
        "in contact: {robot:?} {load:?}"
    );
    // Let go, it stays where it is.
    let left = load[0];
    drive(&mut swarm, -1.0, -0.5, 20);
    assert_eq!(holds(&swarm, 0), 0.0);
    let load = places(&swarm, "object")[0];
    assert!((load[0] - left).abs() < 0.02, "{load:?} {left}");
    assert!(places(&swarm, "agent")[0][0] < robot[0] - 0.3);
    // Too far away now.
    drive(&mut swarm, 0.0, 1.0, 2);
    assert_eq!(holds(&swarm, 0), 0.0);
    let held = swarm.metrics()[0];
    assert_eq!(held, 50.0, "ticks in which it was held");
    // Who does not grip moves nothing.
    let mut swarm = arena(&json!({"mission": mission}));
    drive(&mut swarm, -1.0, 0.0, 50);
    assert!((places(&swarm, "object")[0][0] - 0.1).abs() < 1e-5);
}

#[test]
fn as_many_grippers_as_friction_demands_pull_an_object() {
    // 2.4 N, 4.7 N.
    for (robots, friction, moves) in [(1, 0.12, true), (1, 0.24, false), (2, 0.24, true)] {
        for seed in 0..3 {
            let mission = beside(robots, 2.0, friction);
            let mut swarm = arena(&json!({"mission": mission, "seed": seed}));
            drive(&mut swarm, -1.0, 1.0, 60);
            for agent in 0..robots {
                assert_eq!(holds(&swarm, agent as u32), 1.0);
            }
            let way = 0.1 - places(&swarm, "object")[0][0];
            assert_eq!(way > 0.3, moves, "{robots} {friction}: {way}");
            assert!(moves || way < 0.01, "{robots} {friction}: {way}");
        }
    }
}

#[test]
fn a_robot_turns_within_the_ring_of_its_gripper() {
    let mut mission = beside(1, 0.1, 0.1);
    mission["objects"] = json!([{"name": "load", "radius": 0.05, "mass": 0.1, "friction": 0.1, "center": [0.05, 0]}]);
    mission["start"] = json!({"rectangle": {"x": [-0.0551, -0.0549], "y": [-0.0001, 0.0001]}});
    mission["robots"] = json!(1);
    mission["robot"] = json!({"radius": 0.05, "mass": 1, "sensors": [{"kind": "gripper"}], "actuators": [{"kind": "gripper"}],
        "drive": {"kind": "differential", "wheel_base": 0.1, "max_speed": 0.1}});
    for seed in 0..6 {
        let mut swarm = arena(&json!({"mission": mission, "seed": seed}));
        let apart = |swarm: &Arena| {
            let (robot, load) = (places(swarm, "agent")[0], places(swarm, "object")[0]);
            (load[0] - robot[0]).hypot(load[1] - robot[1])
        };
        let heading = |swarm: &Arena| swarm.scene().unwrap().bodies[0].heading.unwrap();
        let before = (heading(&swarm), places(&swarm, "object")[0]);
        for _ in 0..12 {
            swarm.step(&[-0.5, 0.5, 1.0]);
        }
        let turn = (heading(&swarm) - before.0).rem_euclid(std::f32::consts::TAU);
        let load = places(&swarm, "object")[0];
        assert!(turn > 1.0, "{turn}");
        let moved = (load[0] - before.1[0]).hypot(load[1] - before.1[1]);
        assert!(moved < 0.01, "{moved}");
        // Wherever it drives, it takes the load along.
        for _ in 0..60 {
            swarm.step(&[1.0, 1.0, 1.0]);
        }
        let load = places(&swarm, "object")[0];
        let moved = (load[0] - before.1[0]).hypot(load[1] - before.1[1]);
        assert!(moved > 0.35, "{seed}: {moved}");
        assert!(
            (apart(&swarm) - 0.1).abs() < 0.01,
            "{seed}: {}",
            apart(&swarm)
        );
        assert!(holds(&swarm, 0) > 0.5);
    }
}

#[test]
fn each_robot_holds_one_object_the_nearest() {
    let objects: Vec<Value> = [(-0.108, "near"), (0.106, "nearer")]
        .iter()
        .map(|(x, name)| json!({"name": name, "radius": 0.05, "mass": 0.1, "center": [x, 0]}))
        .collect();
    let mission = json!({"walls": {"rectangle": [2, 2]}, "robot": robot(), "robots": 1, "objects": objects,
        "start": {"rectangle": {"x": [-0.0001, 0.0001], "y": [-0.0001, 0.0001]}},
        "metrics": {"held": {"kind": "objects_held", "when": "end"}, "near": {"kind": "objects_held", "object": "near", "when": "end"}},
        "fitness": "held"});
    let mut swarm = arena(&json!({"mission": mission, "duration": 1}));
    let before = places(&swarm, "object");
    drive(&mut swarm, 0.0, 1.0, 10);
    let of = |name: &str| {
        let index = swarm
            .description()
            .metrics
            .iter()
            .position(|metric| metric.name == name);
        swarm.metrics()[index.unwrap()]
    };
    assert_eq!([of("held"), of("near")], [1.0, 0.0]);
    assert_eq!(places(&swarm, "object")[0], before[0]);
}

#[test]
fn kinds_without_a_gripper_ignore_its_number() {
    let mut hands = robot();
    hands["sensors"] = json!([{"kind": "compass"}, {"kind": "gripper"}]);
    let plain = json!({"radius": 0.05, "sensors": [{"kind": "compass"}],
        "drive": {"kind": "holonomic", "max_speed": 0.2, "max_turn": 0}});
    let mut mission = beside(1, 0.5, 0.2);
    mission["robots"] = json!([{"name": "hands", "count": 1, "robot": hands}, {"name": "plain", "count": 1, "robot": plain}]);
    mission["start"] = json!({"rectangle": {"x": [-0.0551, -0.0549], "y": [-0.2, 0.2]}});
    let mut swarm = arena(&json!({"mission": mission}));
    assert_eq!(swarm.actuator_names(), ["ahead", "left", "turn", "gripper"]);
    drive(&mut swarm, 0.0, 1.0, 3);
    assert_eq!([holds(&swarm, 0), holds(&swarm, 1)], [1.0, 0.0]);
    assert_eq!(states(&swarm), ["hands, holds an object", "plain"]);
    drive(&mut swarm, 0.0, -1.0, 1);
    assert_eq!(states(&swarm), ["hands", "plain"]);
}

/// How scenes call the robots.
fn states(arena: &Arena) -> Vec<String> {
    let bodies = arena.scene().unwrap().bodies.into_iter();
    let agents = bodies.filter(|body| body.kind == "agent");
    agents.map(|body| body.state.into_owned()).collect()
}

#[test]
fn mistakes_are_told() {
    let with = |sensors: Value, actuators: Value| {
        let mut robot = robot();
        robot["sensors"] = sensors;
        robot["actuators"] = actuators;
        json!({"robot": robot})
    };
    let gripper = json!({"kind": "gripper"});
    for (parameters, expected) in [
        (
            with(json!([gripper]), json!([])),
            "robot.sensors[0]: the robot has no gripper; add the actuator {kind: gripper}",
        ),
        (
            with(json!([gripper, gripper]), json!([gripper])),
            "a sensor gripper already exists",
        ),
        (
            with(json!([gripper]), json!([gripper, gripper])),
            "robot.actuators[1]: a gripper already exists",
        ),
        (
            with(json!([gripper]), json!([{"kind": "gripper", "reach": 0.1}])),
            "reach: 0.1 found, expected 0.001 to 0.02",
        ),
    ] {
        let message = refusal(&parameters);
        assert!(message.contains(expected), "{message:?} lacks {expected:?}");
    }
    let mut mission = beside(1, 1.0, 1.0);
    mission["metrics"]["held"]["object"] = json!("lod");
    let message = refusal(&json!({"mission": mission}));
    assert!(
        message.contains("no object is named \"lod\"; available: load"),
        "{message}"
    );
}
