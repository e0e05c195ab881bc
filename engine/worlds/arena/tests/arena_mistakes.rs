//! What the arena refuses, each with the place and the cure.
#![allow(clippy::unwrap_used)] // helpers of tests

use serde_json::{Value, json};
use swarmwright_kernels::Arena;
use swarmwright_simulation::Simulation;

fn refusal(parameters: &Value) -> String {
    let refused = Arena::default().reset(parameters.as_object().unwrap());
    refused.unwrap_err().to_string()
}

/// What a mission is refused for in which this is different.
fn with(path: &[&str], value: Value) -> String {
    let mut mission = json!({"walls": {"rectangle": [20, 20]}, "start": {"rectangle": {"x": [-1, 1], "y": [-1, 1]}},
        "metrics": {}, "fitness": {"factors": {}}});
    let mut target = &mut mission;
    for key in path {
        target = &mut target[*key];
    }
    *target = value;
    refusal(&json!({"mission": mission}))
}

fn patch(patch: Value) -> String {
    with(&["floor"], json!({"patches": [patch]}))
}

/// What objects are refused for: these fields of one beside what it has.
fn object(fields: Value) -> String {
    let mut object = json!({"name": "a", "mass": 1, "center": [0, 0], "radius": 0.2});
    for (key, value) in fields.as_object().unwrap() {
        if value.is_null() {
            object.as_object_mut().unwrap().remove(key);
        } else {
            object[key] = value.clone();
        }
    }
    let other = json!({"name": "b", "mass": 1, "center": [5, 0], "size": [1, 1], "angle": 45});
    with(&["objects"], json!([other, object]))
}

fn metric(metric: Value) -> String {
    with(&["metrics"], json!({"m": metric}))
}

#[test]
fn mistakes_name_the_place() {
    let cases = [
        (
            with(&["walls"], json!({"sides": 2, "apothem": 1})),
            "mission.walls.sides: 2 found",
        ),
        (
            with(&["walls"], json!({"rectangle": [1, -2]})),
            "mission.walls.rectangle[1]: -2 found",
        ),
        (with(&["walls"], json!({"heigth": 2})), "mission.walls"),
        (
            with(&["walls"], json!({"corners": [[0, 0], [1, 1]]})),
            "mission.walls.corners: 2 corners found",
        ),
        (
            with(
                &["walls"],
                json!({"corners": [[-2, -2], [2, 2], [2, -2], [-2, 2]]}),
            ),
            "mission.walls.corners: the sides [-2, -2] to [2, 2] and [2, -2] to [-2, 2] cross",
        ),
        (
            with(&["obstacles"], json!([{"center": [0, 0], "size": [1, 0]}])),
            "mission.obstacles[0].size: 0 found",
        ),
        (
            with(&["obstacles"], json!([{"center": [30, 0], "size": [1, 1]}])),
            "mission.obstacles[0]: the box lies outside the walls",
        ),
        (
            patch(json!({"name": "a", "color": "black"})),
            "mission.floor.patches[0]: expected circle, or",
        ),
        (
            patch(json!({"name": "a", "color": "blue", "circle": {"radius": 1}})),
            "mission.floor.patches[0].color: \"blue\" (a string) found, expected black, grey, white, random, or a number",
        ),
        (
            patch(json!({"name": "a", "color": 3, "circle": {"radius": 1}})),
            "mission.floor.patches[0].color: 3 found",
        ),
        (
            patch(json!({"name": "a", "color": 1, "circle": {"center": [12, 0], "radius": 1}})),
            "mission.floor.patches[0]: the patch \"a\" lies outside the walls",
        ),
        (
            patch(json!({"name": "a", "color": 1, "rectangle": {"x": [1, 0], "y": [0, 1]}})),
            "mission.floor.patches[0].rectangle.x: [1, 0] found, expected the lower number first",
        ),
        (
            patch(
                json!({"name": "a", "color": 1, "polygon": [[0, 0], [2, 0], [2, 2], [1.5, 0.5]]}),
            ),
            "mission.floor.patches[0].polygon: the polygon has a corner that points inwards",
        ),
        (
            with(&["lights"], json!([{"at": [0, 0], "intensity": 1}])),
            "mission.lights[0].at",
        ),
        (
            with(&["lights"], json!([{"at": [0, 0, 1], "brightness": 1}])),
            "mission.lights[0].brightness: unknown field",
        ),
        (
            with(&["lights"], json!([{"at": [0, 0, 1], "intensity": -1}])),
            "mission.lights[0].intensity: -1 found",
        ),
        (
            with(&["start"], json!({})),
            "mission.start: expected disc, or rectangle",
        ),
        (
            with(
                &["start"],
                json!({"disc": {"center": [50, 0], "radius": 1}}),
            ),
            "mission.start: lies outside",
        ),
        (
            object(json!({"radius": null})),
            "mission.objects[1]: expected radius (a disc), or size",
        ),
        (
            object(json!({"radius": 0})),
            "mission.objects[1].radius: 0 found, expected 0.01 to 100",
        ),
        (
            object(json!({"radius": null, "size": [1, -1]})),
            "mission.objects[1].size[1]: -1 found",
        ),
        (
            object(json!({"mass": null})),
            "mission.objects[1]: missing field `mass`",
        ),
        (
            object(json!({"mass": 0})),
            "mission.objects[1].mass: 0 found, expected 0.001 to 1000",
        ),
        (
            object(json!({"friction": -1})),
            "mission.objects[1].friction: -1 found",
        ),
        (
            object(json!({"weight": 1})),
            "mission.objects[1].weight: unknown field",
        ),
        (
            object(json!({"name": "b"})),
            "mission.objects[1].name: other objects are already named \"b\"; choose another name",
        ),
        (
            object(json!({"center": [9.9, 0]})),
            "mission.objects[1]: must be inside the walls",
        ),
        (
            object(json!({"center": [4.2, 0]})),
            "mission.objects[1]: \"a\" and \"b\" overlap",
        ),
        (
            object(json!({"center": null})),
            "mission.objects[1]: expected center",
        ),
        (
            object(json!({"count": 3})),
            "mission.objects[1].count: 3 found, but only one object has room at a center",
        ),
        (
            object(json!({"center": null, "start": {"disc": {"radius": 1}}, "angle": 3})),
            "mission.objects[1].angle: with start the angle is random",
        ),
        (
            object(json!({"center": null, "start": {"disc": {"radius": -1}}})),
            "mission.objects[1].start.disc.radius: -1 found",
        ),
        (
            object(json!({"center": null, "start": {"disc": {"radius": 1}}, "count": 65})),
            "mission.objects[1].count: 65 found, expected 1 to 64",
        ),
        (
            object(json!({"center": null, "start": {"disc": {"radius": 0.5}}, "count": 30})),
            "mission.objects[1]: 30 objects do not fit into their start region: ",
        ),
        (
            metric(json!({"kind": "objects_on", "patch": "black"})),
            "no patch of the floor is named \"black\"",
        ),
        (with(&["robots"], json!(0)), "mission.robots: 0 found"),
        (with(&["duration"], json!(-3)), "mission.duration: -3 found"),
        (
            with(&["robot"], json!("r2d2")),
            "mission.robot: \"r2d2\" found",
        ),
        (
            metric(json!({"kind": "robots_on", "patch": "black"})),
            "mission.metrics.m.patch: no patch of the floor is named \"black\"",
        ),
        (
            metric(json!({"kind": "most_robots_on", "patches": ["black"]})),
            "mission.metrics.m.patches[0]: no patch of the floor is named \"black\"",
        ),
        (
            metric(json!({"kind": "cell_age", "side": "long", "cells": 3})),
            "mission.metrics.m.side: \"long\" (a string) found, expected a number",
        ),
        (
            metric(json!({"kind": "order", "when": "always"})),
            "mission.metrics.m.when: \"always\" found, expected one of \"each_tick\"",
        ),
        (
            metric(json!({"kind": "chain_reach", "from": "a", "to": "b", "link": 1})),
            "mission.metrics.m.from: no patch of the floor is named \"a\"; available: none",
        ),
        (
            metric(json!({"patch": "a"})),
            "mission.metrics.m: missing field `kind`",
        ),
        (
            with(&["metrics"], json!({"and": {"kind": "order"}})),
            "mission.metrics: and is a keyword",
        ),
        (
            metric(json!({"kind": "robot_on", "patch": "a"})),
            "mission.metrics.m.kind: \"robot_on\" found, expected one of \"robots_on\"",
        ),
        (
            metric(json!({"kind": "largest_group", "link": 0})),
            "mission.metrics.m.link: 0 found",
        ),
        (
            metric(json!({"kind": "order", "when": {"at": 1e6}})),
            "mission.metrics.m.when.at: 1000000 s found, expected 0 to the duration of",
        ),
        (
            metric(json!({"kind": "order", "when": {"at": -1}})),
            "mission.metrics.m.when.at: -1 s found, expected 0 to the duration of",
        ),
        (
            metric(json!({"kind": "shape_deviation", "shape": {}})),
            "mission.metrics.m.shape: expected circle",
        ),
        (
            with(&["metrics"], json!({"a-b": {"kind": "order"}})),
            "mission.metrics: \"a-b\" found",
        ),
        (
            with(&["metrics"], json!({"fitness": {"kind": "order"}})),
            "mission.metrics: fitness is",
        ),
        (
            with(&["fitness"], json!("n")),
            "mission.fitness: no metric is named \"n\"; available: distance_to_center, ",
        ),
        (
            with(&["fitness"], json!("order + speed")),
            ", speed; only the experiment's own fitness may be an expression of metrics",
        ),
        (
            with(&["fitness"], json!([1])),
            "mission.fitness: a list found, expected the name of a metric",
        ),
        (
            refusal(&json!({"mission": "agregation"})),
            "\"agregation\" found, expected the name of a mission (aac or aggregation, ",
        ),
        (
            refusal(&json!({"robot": "e-puck"})),
            "expected the name of a robot (e-puck-rm1.1, e-puck-rm1.2, foot-bot, ",
        ),
    ];
    for (message, expected) in cases {
        assert!(message.contains(expected), "{message:?} lacks {expected:?}");
    }
}

#[test]
fn metrics_of_objects_name_the_object() {
    let mission = json!({"walls": {"rectangle": [20, 20]}, "start": {"disc": {"radius": 1}},
        "floor": {"patches": [{"name": "west", "rectangle": {"x": [-5, -4], "y": [-1, 1]}, "color": 0}]},
        "objects": [{"name": "load", "mass": 1, "radius": 0.2, "center": [5, 0]}],
        "metrics": {"m": {"kind": "object_distance", "patch": "west", "object": "lod"}}, "fitness": "m"});
    let message = refusal(&json!({"mission": mission}));
    assert!(
        message.contains("mission.metrics.m.object: no object is named \"lod\"; available: load"),
        "{message}"
    );
    let mut without = mission;
    without["objects"] = json!([]);
    let message = refusal(&json!({"mission": without}));
    assert!(
        message.contains("mission.metrics.m: the mission has no objects"),
        "{message}"
    );
}

#[test]
fn robots_that_do_not_fit_are_counted() {
    let message = refusal(&json!({"robots": 2000}));
    let found = message
        .split("only ")
        .nth(1)
        .and_then(|rest| rest.split(' ').next())
        .and_then(|number| number.parse::<f64>().ok())
        .unwrap();
    // Discs thrown at random without overlap fill about half of a plane (0.547 in the limit).
    let filled = found * 0.035 * 0.035 / (1.2 * 1.2);
    assert!((0.4..0.6).contains(&filled), "{message}");
}

#[test]
fn robots_start_inside_of_walls_and_outside_of_boxes() {
    // The start is larger than the arena and has a box in it that robots fit into.
    let mission = json!({
        "walls": {"corners": [[-1, -1], [1, -1], [1, 0], [0, 0], [0, 1], [-1, 1]]},
        "obstacles": [{"center": [-0.5, -0.5], "size": [0.6, 0.6]}],
        "start": {"rectangle": {"x": [-1.5, 1.5], "y": [-1.5, 1.5]}},
        "fitness": "order",
    });
    for seed in 0..20 {
        let mut arena = Arena::default();
        let parameters = json!({"mission": mission, "robots": 30, "seed": seed});
        arena.reset(parameters.as_object().unwrap()).unwrap();
        let scene = arena.scene().unwrap();
        for body in scene.bodies.iter().filter(|body| body.kind == "agent") {
            let (x, y) = (body.x - scene.width / 2.0, body.y - scene.height / 2.0);
            assert!(
                x.abs() < 1.0 && y.abs() < 1.0 && (x < 0.0 || y < 0.0),
                "{x}, {y}"
            );
            assert!((x + 0.5).abs() > 0.3 || (y + 0.5).abs() > 0.3, "{x}, {y}");
        }
    }
}

#[test]
fn a_time_until_has_one_share() {
    for (bounds, answer) in [
        (json!({}), "expected either at_least or at_most"),
        (
            json!({"at_least": 1, "at_most": 0}),
            "expected either at_least or at_most",
        ),
        (
            json!({"at_least": 20}),
            "at_least: 20 found, expected 0 to 1",
        ),
        (
            json!({"at_most": -0.1}),
            "at_most: -0.1 found, expected 0 to 1",
        ),
    ] {
        let mut metric = json!({"kind": "time_until", "patch": "a"});
        for (key, value) in bounds.as_object().unwrap() {
            metric[key] = value.clone();
        }
        let patch = json!({"name": "a", "circle": {"radius": 1}, "color": "black"});
        let mission = json!({"walls": {"rectangle": [4, 4]}, "start": {"disc": {"radius": 1}},
            "floor": {"patches": [patch]}, "metrics": {"m": metric}, "fitness": "m"});
        let refused = refusal(&json!({"mission": mission}));
        assert!(
            refused.contains("mission.metrics.m") && refused.contains(answer),
            "{refused}"
        );
    }
}

#[test]
fn patches_lie_within_the_walls_however_narrow_they_are() {
    let read = |patch: Value| {
        let mut patch = patch;
        patch["name"] = json!("patch");
        patch["color"] = json!("black");
        let mission = json!({
            "walls": {"rectangle": [2, 2]}, "floor": {"patches": [patch]},
            "start": {"disc": {"radius": 0.5}}, "robots": 1, "fitness": "order",
        });
        let parameters = json!({ "mission": mission });
        Arena::default().reset(parameters.as_object().unwrap())
    };
    let tape = |from: [f64; 2], to: [f64; 2]| {
        let beside = |[x, y]: [f64; 2]| [x, y + 1e-4];
        json!({"polygon": [from, to, beside(to), beside(from)]})
    };
    let rectangle = |x: [f64; 2], y: [f64; 2]| json!({"rectangle": {"x": x, "y": y}});
    let circle = |x: f64, radius: f64| json!({"circle": {"center": [x, 0], "radius": radius}});
    for patch in [
        tape([-3.0, -2.13], [3.0, 2.71]),
        tape([-0.3, -0.2], [0.3, 0.21]),
        tape([0.8, 0.0], [1.7, 0.3]),
        rectangle([-1.0, 1.0], [-1.0, 1.0]),
        rectangle([-0.99, -0.9899], [-5.0, 5.0]),
        circle(0.3, 1e-5),
        circle(1.2, 0.201),
        circle(9.0, 20.0),
    ] {
        let found = read(patch.clone());
        assert!(found.is_ok(), "{patch}: {found:?}");
    }
    for patch in [
        tape([-3.0, 0.0], [0.0, 3.0]),
        tape([1.1, 0.0], [1.7, 0.3]),
        rectangle([1.0, 2.0], [-1.0, 1.0]),
        rectangle([-2.0, -1.0], [-1.0, 1.0]),
        circle(1.2, 0.199),
    ] {
        let refused = read(patch.clone()).unwrap_err().to_string();
        assert!(refused.contains("outside the walls"), "{patch}: {refused}");
    }
}

/// All that is wrong with parameters, as texts.
fn mistakes(parameters: &Value) -> Vec<String> {
    let mistakes = Arena::default().mistakes(parameters.as_object().unwrap());
    mistakes.unwrap().iter().map(ToString::to_string).collect()
}

#[test]
fn all_mistakes_are_told_at_once_and_nothing_that_only_follows_from_them() {
    let found = mistakes(&json!({
        "mission": {
            "walls": {"rectangle": [20, -20]},
            "wals": {},
            "floor": {"color": "blue", "patches": [
                {"name": "home", "color": "black", "circle": {"center": [0, 0], "radius": -1}},
                {"name": "far", "color": "black", "circle": {"center": [50, 0], "radius": 1}},
            ]},
            "start": {"rectangle": {"x": [1, -1], "y": [-1, 1]}},
            "failures": [{"kind": "stop", "share": 2}, {"kind": "loss", "loss": 2}],
            "metrics": {"at_home": {"kind": "robots_on", "patch": "home"}, "odd": {"kind": "odd"}},
            "fitness": "at_hom",
        },
        "robots": 0,
        "robot": {
            "radius": 0.1,
            "drive": {"kind": "differential", "wheel_base": 0.1, "max_speed": 0.2},
            "battery": {"standing": 10, "driving": 5, "charging": {"patch": "home", "seconds": 5}},
            "sensors": [{"kind": "ground", "count": 0}, {"kind": "odd"}],
            "actuators": [{"kind": "odd"}],
        },
        "failures": [{"kind": "stop", "share": 1.5}],
        "stepSize": -1,
    }));
    let places: Vec<&str> = found
        .iter()
        .map(|text| {
            let place = text.strip_prefix("parameter ").unwrap();
            place.split_once(": ").unwrap().0
        })
        .collect();
    let expected = [
        "mission.wals",
        "mission.failures[0].share",
        "mission.failures[1].loss",
        "mission.walls.rectangle[1]",
        "mission.floor.color",
        "mission.floor.patches[0].circle.radius",
        "mission.start.rectangle.x",
        "mission.metrics.odd.kind",
        "stepSize",
        "failures[0].share",
        "robot.battery.charging.seconds",
        "robot.actuators[0].kind",
        "robot.sensors[0].count",
        "robot.sensors[1].kind",
        "robots",
    ];
    assert_eq!(places, expected, "{found:#?}");
    assert_eq!(mistakes(&json!({})), Vec::<String>::new());
    let crowded = mistakes(&json!({"robots": 5000}));
    assert!(crowded[0].starts_with("parameter robots: 5000 robots do not fit"));
}
