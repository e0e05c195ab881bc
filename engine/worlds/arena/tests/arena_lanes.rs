//! Failures, metrics and robots of all kinds give the same bits in lanes as one episode at a time.
#![allow(clippy::unwrap_used)] // helpers of tests

use serde_json::{Map, Value, json};
use swarmwright_controllers::Architecture;
use swarmwright_kernels::{Arena, evaluate};
use swarmwright_lanes::Level;
use swarmwright_simulation::{Block, Means, Simulation};

/// Checks a network with as many inputs and outputs as the robots have. Returns fitness and metrics of each episode.
pub(super) fn check(parameters: &Value) -> Vec<f64> {
    let parameters = parameters.as_object().unwrap();
    let description = Arena::default().described(parameters).unwrap();
    let layered = layered(description.sensors, description.actuators, 3);
    check_controller(parameters, &layered)
}

fn layered(sensors: usize, actuators: usize, hidden: usize) -> Value {
    json!({"kind": "layered", "version": 1, "hidden": [hidden], "activation": "tanh", "output_range": [-1, 1],
        "sensors": sensors, "actuators": actuators})
}

/// As [`check`], with a network of its own for each kind of robots; if there is one kind, for a robot, for two others, which sense
/// and do less, and for the rest.
pub(super) fn check_team(parameters: &Value) -> Vec<f64> {
    let parameters = parameters.as_object().unwrap();
    let mut arena = Arena::default();
    arena.reset(parameters).unwrap();
    let description = arena.description();
    let (sensors, actuators) = (description.sensors, description.actuators);
    let network = |index: usize, sensors: usize, actuators: usize| match index % 3 {
        0 => layered(sensors, actuators, 2),
        1 => {
            json!({"kind": "fully_meshed", "version": 1, "hidden": 1, "iterations": 2, "activation": "tanh",
                "output_range": [-1, 1], "sensors": sensors, "actuators": actuators})
        }
        _ => json!({"kind": "evostick", "version": 1, "sensors": sensors, "actuators": actuators}),
    };
    let mut groups: Vec<Value> = arena
        .groups()
        .iter()
        .enumerate()
        .map(|(index, group)| {
            assert!(group.padded);
            json!({"name": group.name, "agents": group.agents,
                "controller": network(index, group.sensors, group.actuators)})
        })
        .collect();
    if groups.is_empty() {
        groups = vec![
            json!({"name": "leader", "agents": 1, "controller": network(2, sensors, actuators)}),
            json!({"name": "simple", "agents": 2, "controller": network(1, sensors / 2, actuators - 1)}),
            json!({"name": "others", "agents": null, "controller": network(0, sensors, actuators)}),
        ];
    }
    let team = json!({"kind": "team", "version": 1, "groups": groups});
    check_controller(parameters, &team)
}

fn check_controller(parameters: &Map<String, Value>, architecture: &Value) -> Vec<f64> {
    let description = Arena::default().described(parameters).unwrap();
    let architecture = Architecture::from_json(&architecture.to_string()).unwrap();
    let length = architecture.weight_count();
    let genomes: Vec<f32> = (0..length * 9)
        .map(|index| ((index * 37 % 101) as f32 - 50.0) / 40.0)
        .collect();
    let metrics: Vec<usize> = (0..description.metrics.len()).collect();
    let run = |level: Option<Level>| {
        let block = Block {
            architecture: &architecture,
            genomes: &genomes,
            parameters,
            seeds: &[5, 6, 7],
            metrics: &metrics,
            stop: None,
        };
        let means = Means { level, threads: 1 };
        let numbers = evaluate(&block, means, || Box::<Arena>::default()).unwrap();
        numbers.into_iter().map(f64::to_bits).collect::<Vec<u64>>()
    };
    let one_by_one = run(None);
    assert_eq!(one_by_one.len(), 27 * (1 + metrics.len()));
    for level in Level::available() {
        assert_eq!(
            run(Some(level)),
            one_by_one,
            "{} of {parameters:?}",
            level.name()
        );
    }
    one_by_one.into_iter().map(f64::from_bits).collect()
}

fn failures() -> Value {
    json!([
        {"kind": "stop", "share": 0.3, "at": 2, "until": 4}, {"kind": "slow", "share": 0.5, "factor": 0.4, "at": 1},
        {"kind": "blind", "share": 0.2, "at": 3}, {"kind": "mute", "share": 0.3}, {"kind": "loss", "loss": 0.5, "at": 5},
    ])
}

#[test]
fn robots_of_all_kinds_that_fail() {
    for robot in [
        "e-puck-rm1.1",
        "e-puck-rm1.2",
        "foot-bot",
        "kilobot",
        "point",
        "turtlebot3",
    ] {
        let parameters =
            json!({"robot": robot, "robots": 7, "duration": 6, "failures": failures()});
        check(&parameters);
        check_team(&parameters);
    }
}

#[test]
fn drives_and_sensors() {
    for drive in [
        json!({"kind": "differential", "wheel_base": 0.1, "max_speed": 0.4, "noise": 0.1}),
        json!({"kind": "holonomic", "max_speed": 0.3, "max_turn": 200, "noise": 0.05}),
        json!({"kind": "car", "wheel_base": 0.1, "max_speed": 0.3, "max_steering": 40, "noise": 0.05}),
    ] {
        let robot = json!({
            "radius": 0.04, "drive": drive,
            "sensors": [
                {"kind": "proximity", "angles": [0, 40, -40, 180], "range": 0.3, "noise": 0.1, "gives": "vector"},
                {"kind": "light", "count": 3, "noise": 0.02},
                {"kind": "ground", "points": [[0, 0], [0.03, 0], [0, 0.03], [0, -0.03], [-0.03, 0]], "noise": 0.3},
                {"kind": "range_and_bearing", "range": 0.8, "loss": 0.3, "gives": ["message", "attraction"]},
                {"kind": "neighbours", "range": 0.5, "gives": ["nearest", "heading", "center", "count"]},
                {"kind": "encoders", "noise": 0.1},
                {"kind": "compass", "noise": 5},
            ],
            "actuators": [{"kind": "message", "numbers": 3}],
        });
        check(
            &json!({"mission": "sca", "robot": robot, "robots": 12, "duration": 8, "failures": failures()}),
        );
    }
}

#[test]
fn changed_presets() {
    for robot in [
        json!({"preset": "e-puck-rm1.1", "radius": 0.04, "drive": {"noise": 0.15, "wheel_base": 0.06},
            "sensors": {"proximity": {"range": 0.1, "noise": 0.2}, "light": {"noise": 0.9}, "range_and_bearing": {"loss": 0.5}}}),
        json!({"preset": "e-puck-rm1.2", "drive": {"max_speed": 0.1}, "sensors": {"ground": {"noise": 0.3}}}),
        json!({"preset": "point", "sensors": {"neighbours": {"range": 0.4}, "compass": {"noise": 20}}}),
    ] {
        check(&json!({"robot": robot, "robots": 9, "duration": 6}));
    }
}

#[test]
fn colours_cameras_and_batteries() {
    let mission = json!({
        "walls": {"rectangle": [2, 2]}, "obstacles": [{"center": [0, 0], "size": [0.1, 0.8], "angle": 20}],
        "floor": {"patches": [{"name": "nest", "circle": {"center": [0.6, 0], "radius": 0.4}, "color": "black"}]},
        "lights": [{"at": [0.9, 0, 0.4], "intensity": 2, "color": "yellow"}, {"at": [0, 0.9, 0.1], "intensity": 0, "color": "red"}],
        "start": {"rectangle": {"x": [-1, 1], "y": [-1, 1]}}, "fitness": "order",
    });
    let robot = json!({
        "radius": 0.04, "drive": {"kind": "differential", "wheel_base": 0.1, "max_speed": 0.4, "noise": 0.1},
        "battery": {"standing": 8, "driving": 3, "charge": 0.9, "charging": {"patch": "nest", "duration": 2}},
        "sensors": [
            {"kind": "camera", "range": 0.9, "noise": 10, "colors": ["red", "yellow", "cyan"],
                "gives": ["count", "seen", "attraction", "direction", "sectors"]},
            {"kind": "battery", "noise": 0.05},
            {"kind": "range_and_bearing", "range": 0.8, "loss": 0.3, "gives": ["message", "attraction"]},
        ],
        "actuators": [{"kind": "message", "numbers": 1}, {"kind": "led", "colors": ["red", "cyan"]}],
    });
    let parameters = json!({"mission": mission, "robot": robot, "robots": 12, "duration": 8, "failures": failures()});
    check(&parameters);
    // Walls and objects with colours.
    let mut mission = mission;
    mission["walls"]["colors"] =
        json!([{"side": 2, "color": "red"}, {"side": 0, "color": "cyan", "from": 0.2, "to": 0.9}]);
    mission["obstacles"][0]["color"] = json!("yellow");
    mission["objects"] = json!([
        {"name": "ball", "radius": 0.06, "mass": 0.2, "count": 3, "start": {"disc": {"radius": 0.8}}, "color": "cyan"},
        {"name": "bar", "size": [0.3, 0.05], "mass": 0.1, "center": [0.5, 0.5], "angle": 30, "color": "red"},
        {"name": "dark", "size": [0.1, 0.1], "mass": 0.1, "center": [-0.5, 0.5]},
    ]);
    check(
        &json!({"mission": mission, "robot": robot, "robots": 12, "duration": 8, "failures": failures()}),
    );
}

#[test]
fn metrics_of_missions() {
    for mission in [
        "flocking",
        "chain_formation",
        "dispersion",
        "area_coverage",
        "formation",
        "emergency_exit",
    ] {
        check(&json!({"mission": mission, "robots": 9, "duration": 5}));
    }
    // More than 64 robots are grouped in another way.
    check(&json!({"mission": "flocking", "robots": 70, "duration": 1}));
}

#[test]
fn objects_that_robots_push() {
    check(&json!({"mission": "collective_transport", "robots": 9, "duration": 12}));
    let objects = json!([
        {"name": "disc", "radius": 0.08, "mass": 0.3, "friction": 0.1, "count": 3,
            "start": {"disc": {"radius": 0.6}}},
        {"name": "box", "size": [0.25, 0.1], "mass": 0.2, "friction": 0.1, "count": 3,
            "start": {"rectangle": {"x": [-0.7, 0.7], "y": [-0.4, 0.4]}}},
        {"name": "bar", "size": [0.5, 0.04], "mass": 0.3, "friction": 0.2, "center": [0, 0.3], "angle": 20, "height": 0.02},
    ]);
    let mission = json!({
        "walls": {"corners": [[-1, -0.7], [1, -0.7], [1, 0.7], [0.2, 0.6], [-1, 0.7]]},
        "obstacles": [{"center": [0.5, -0.3], "size": [0.2, 0.05], "angle": 40}],
        "objects": objects, "lights": [{"at": [1.3, 0, 0.2], "intensity": 4}],
        "floor": {"patches": [{"name": "goal", "circle": {"radius": 0.4}, "color": "black"}]},
        "start": {"disc": {"radius": 0.9}},
        "metrics": {
            "near": {"kind": "object_distance", "patch": "goal", "object": "disc"},
            "on": {"kind": "objects_on", "patch": "goal", "share": true},
        },
        "fitness": "near",
    });
    for robot in ["e-puck-rm1.2", "kilobot", "point"] {
        check(
            &json!({"mission": mission, "robot": robot, "robots": 10, "duration": 12, "failures": failures()}),
        );
    }
}

/// One at a time more than 48 robots look at lists of others, in lanes more than 96: lists decide nothing.
#[test]
fn many_robots() {
    let mission = json!({
        "walls": {"rectangle": [5, 6]}, "start": {"rectangle": {"x": [-2.4, 2.4], "y": [-2.9, 2.9]}},
        "metrics": {"order": {"kind": "order"}}, "fitness": "order",
    });
    for (slow, fast) in [(60, 30), (90, 40)] {
        let robots = json!([{"robot": "e-puck-rm1.2", "count": slow}, {"robot": "turtlebot3", "count": fast}]);
        check(
            &json!({"mission": mission, "robots": robots, "duration": 5.2, "failures": failures()}),
        );
        check_team(&json!({"mission": mission, "robots": robots, "duration": 1}));
    }
}

#[test]
fn robots_of_several_kinds() {
    let sensors = json!([
        {"kind": "proximity", "count": 5, "range": 0.2, "noise": 0.05},
        {"kind": "light", "count": 2},
        {"kind": "range_and_bearing", "range": 0.7, "loss": 0.2, "gives": ["count", "message"]},
    ]);
    let wheels = |speed: f64| json!({"kind": "differential", "wheel_base": 0.1, "max_speed": speed, "noise": 0.05});
    let kinds = json!([
        {"name": "large", "count": 4, "robot": {"radius": 0.08, "mass": 1.5, "height": 0.2, "drive": wheels(0.3),
            "sensors": sensors, "actuators": [{"kind": "message", "numbers": 1}]}},
        {"name": "small", "count": 7, "robot": {"radius": 0.03, "mass": 0.2, "drive": wheels(0.1),
            "friction": [0.2, 0.1], "actuators": [{"kind": "message", "numbers": 1}],
            "sensors": [
                {"kind": "proximity", "angles": [0, 30, -30], "range": 0.1, "gives": "vector"},
                {"kind": "range_and_bearing", "range": 0.5, "gives": ["attraction", "message"]},
                {"kind": "light", "count": 8, "gives": "vector"},
                {"kind": "encoders", "noise": 0.1},
            ]}},
    ]);
    let objects = json!([{"name": "load", "radius": 0.1, "mass": 0.4, "center": [0, 0]}]);
    let mission = json!({
        "walls": {"rectangle": [1.6, 1.2]}, "start": {"rectangle": {"x": [-0.7, 0.7], "y": [-0.5, 0.5]}},
        "lights": [{"at": [1, 0, 0.3], "intensity": 3}], "objects": objects, "robots": kinds,
        "floor": {"patches": [{"name": "east", "rectangle": {"x": [0, 2], "y": [-1, 1]}, "color": 0}]},
        "metrics": {"small": {"kind": "robots_on", "patch": "east", "robots": "small"}},
        "failures": [{"kind": "slow", "share": 0.5, "factor": 0.3, "robots": "large"}, {"kind": "mute", "share": 0.3}],
        "fitness": "small",
    });
    check(&json!({"mission": mission, "duration": 12}));
    check_team(&json!({"mission": mission, "duration": 12}));
    // Both together, and robots that lack some of it.
    let mut unequal = mission.clone();
    unequal["robots"][1]["robot"]["sensors"] = json!([
        {"kind": "light", "count": 2}, {"kind": "ground", "points": [[0, 0], [0.02, 0]], "noise": 0.1},
        {"kind": "range_and_bearing", "range": 0.5, "gives": ["attraction", "message"]},
        {"kind": "camera", "range": 0.6, "noise": 5, "colors": ["red", "blue"], "gives": ["count", "attraction"]},
    ]);
    unequal["robots"][0]["robot"]["actuators"] =
        json!([{"kind": "message", "numbers": 1}, {"kind": "led", "colors": ["red", "blue"]}]);
    check(&json!({"mission": unequal, "duration": 12, "failures": failures()}));
    check_team(&json!({"mission": unequal, "duration": 12, "failures": failures()}));
    // One kind shows colours and has a battery, the other one sees colours.
    let leds = json!([{"kind": "led", "colors": ["red", "blue"]}]);
    let mut mission = mission;
    mission["robots"][0]["robot"]["sensors"] = json!([
        {"kind": "camera", "range": 0.6, "noise": 5, "colors": ["red", "blue"], "gives": ["count", "attraction"]},
        {"kind": "light", "count": 3},
    ]);
    mission["robots"][0]["robot"]["actuators"] = leds.clone();
    mission["robots"][1]["robot"]["sensors"] = json!([
        {"kind": "proximity", "count": 8, "range": 0.1}, {"kind": "battery", "noise": 0.01},
    ]);
    mission["robots"][1]["robot"]["actuators"] = leds;
    mission["robots"][1]["robot"]["battery"] =
        json!({"standing": 10, "driving": 4, "charging": {"patch": "east", "duration": 5}});
    check(&json!({"mission": mission, "duration": 12}));
}

#[test]
fn grippers() {
    check(&json!({"mission": "object_retrieval", "duration": 15, "failures": failures()}));
    check_team(&json!({"mission": "object_retrieval", "duration": 15}));
    let robot = json!({
        "radius": 0.04, "drive": {"kind": "differential", "wheel_base": 0.06, "max_speed": 0.2, "noise": 0.1},
        "battery": {"standing": 12, "driving": 6},
        "sensors": [{"kind": "gripper"}, {"kind": "proximity", "count": 6, "range": 0.2}, {"kind": "compass"}],
        "actuators": [{"kind": "gripper", "reach": 0.02}, {"kind": "led", "colors": ["red"]}],
    });
    let objects = json!([
        {"name": "disc", "radius": 0.06, "mass": 0.2, "friction": 0.1, "count": 4, "start": {"disc": {"radius": 0.7}}},
        {"name": "bar", "size": [0.5, 0.04], "mass": 0.3, "friction": 0.2, "count": 2, "start": {"disc": {"radius": 0.6}}},
    ]);
    let mission = json!({
        "walls": {"rectangle": [1.8, 1.8]}, "obstacles": [{"center": [0.3, 0.2], "size": [0.2, 0.1], "angle": 30}],
        "objects": objects, "start": {"disc": {"radius": 0.8}}, "metrics": {"held": {"kind": "objects_held"}}, "fitness": "held",
    });
    check(
        &json!({"mission": mission, "robot": robot, "robots": 10, "duration": 12, "failures": failures()}),
    );
}

/// What a robot loses within a tick it does not hold again in the same tick, whether or not others touch something there.
#[test]
fn fast_grippers_lose_light_objects() {
    let robot = json!({
        "radius": 0.2, "mass": 0.4, "sensors": [{"kind": "proximity", "count": 8, "range": 0.3}, {"kind": "random"}],
        "drive": {"kind": "differential", "wheel_base": 4.0 / 5.9, "max_speed": 4, "acceleration": 3.75, "noise": 0.05},
        "actuators": [{"kind": "gripper", "reach": 0.02}],
    });
    let start = json!({"rectangle": {"x": [-1.3, 1.3], "y": [-0.8, 0.8]}});
    let objects = json!([
        {"name": "disc", "radius": 0.03, "mass": 0.01, "count": 6, "start": start},
        {"name": "box", "size": [0.15, 0.05], "mass": 0.01, "count": 3, "start": start},
    ]);
    for count in [11, 14] {
        let mission = json!({
            "walls": {"rectangle": [3, 2]}, "robots": count, "robot": robot, "objects": objects,
            "start": {"rectangle": {"x": [-1.4, 1.4], "y": [-0.9, 0.9]}},
            "metrics": {"distance": {"kind": "distance_to_center"}}, "fitness": "distance",
        });
        check(&json!({"mission": mission, "duration": 20}));
    }
}

#[test]
fn radios() {
    let every = json!({"fading": 2, "exponent": 2.7, "slots": 15, "interval": 0.2, "delay": 0.3, "line_of_sight": false});
    for radio in [
        every,
        json!({"fading": 1}),
        json!({"slots": 4}),
        json!({"delay": 0.1}),
    ] {
        let robot = |range: f64, radio: &Value| {
            json!({
                "radius": 0.04, "drive": {"kind": "differential", "wheel_base": 0.1, "max_speed": 0.4, "noise": 0.1},
                "sensors": [
                    {"kind": "range_and_bearing", "range": range, "loss": 0.2, "radio": radio,
                        "gives": ["count", "message", "attraction"]},
                ],
                "actuators": [{"kind": "message", "numbers": 2}],
            })
        };
        check(
            &json!({"robot": robot(0.5, &radio), "robots": 12, "duration": 6, "failures": failures()}),
        );
        // So many that one episode at a time looks at the cells around a robot, and robots of two kinds.
        let kinds = json!([{"robot": robot(0.15, &radio), "count": 40}, {"robot": robot(0.3, &json!({"delay": 0.2})), "count": 15}]);
        check(
            &json!({"mission": {"walls": {"rectangle": [4, 4]}, "start": {"rectangle": {"x": [-1.9, 1.9], "y": [-1.9, 1.9]}},
            "fitness": "order"}, "robots": kinds, "duration": 3}),
        );
    }
}

/// Three kinds with a network each, also as many that four vectors do not lie side by side.
#[test]
fn teams_of_three_kinds() {
    for counts in [[1, 3, 2], [20, 30, 25]] {
        let names = ["e-puck-rm1.2", "kilobot", "turtlebot3"];
        let kinds: Vec<Value> = names
            .iter()
            .zip(counts)
            .map(|(name, count)| json!({"robot": name, "count": count}))
            .collect();
        let mission = json!({
            "walls": {"rectangle": [4, 4]}, "start": {"rectangle": {"x": [-1.9, 1.9], "y": [-1.9, 1.9]}},
            "fitness": "order",
        });
        let duration = if counts[0] == 1 { 9.0 } else { 5.2 };
        check_team(
            &json!({"mission": mission, "robots": kinds, "duration": duration, "failures": failures()}),
        );
    }
}

/// Servers announce it, so that requests fill their lanes.
#[test]
fn as_many_episodes_at_once_as_there_are_lanes() {
    let lanes = Arena::default().lanes();
    match Level::best() {
        Level::Portable => assert_eq!(lanes, 1),
        level => assert_eq!(lanes % level.width(), 0),
    }
}
