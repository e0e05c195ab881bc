//! Objects that robots push: what physics demands, and the same bits in lanes.
#![allow(clippy::unwrap_used)] // helpers of tests

use serde_json::{Value, json};
use swarmwright_kernels::Arena;
use swarmwright_simulation::Simulation;

/// Robots that drive as they are told, without noise.
fn exact() -> Value {
    json!({"radius": 0.035, "mass": 0.4,
        "drive": {"kind": "holonomic", "max_speed": 0.12, "max_turn": 0},
        "sensors": [{"kind": "proximity", "count": 8, "range": 0.3, "response": [0, 1, 0]}]})
}

/// A hall with objects, robots in a narrow start, and metrics of all objects.
fn mission(objects: &Value, start: &Value) -> Value {
    json!({
        "walls": {"rectangle": [3, 2]}, "robots": 1, "robot": exact(), "objects": objects,
        "floor": {"patches": [{"name": "goal", "circle": {"center": [0, 0], "radius": 0.2}, "color": "white"}]},
        "start": start,
        "metrics": {
            "far": {"kind": "object_distance", "patch": "goal", "when": "end"},
            "on": {"kind": "objects_on", "patch": "goal", "when": "end"},
        },
        "fitness": "far",
    })
}

fn arena(parameters: &Value) -> Arena {
    let mut arena = Arena::default();
    arena.reset(parameters.as_object().unwrap()).unwrap();
    arena
}

/// Where the objects are: the middle of the arena is 0, 0.
fn objects(arena: &Arena) -> Vec<[f32; 2]> {
    let scene = arena.scene().unwrap();
    let bodies = scene.bodies.iter().filter(|body| body.kind == "object");
    bodies
        .map(|body| [body.x - scene.width / 2.0, body.y - scene.height / 2.0])
        .collect()
}

fn robots(arena: &Arena) -> Vec<[f32; 2]> {
    let scene = arena.scene().unwrap();
    let bodies = scene.bodies.iter().filter(|body| body.kind == "agent");
    bodies
        .map(|body| [body.x - scene.width / 2.0, body.y - scene.height / 2.0])
        .collect()
}

/// Corners of all objects.
fn rims(arena: &Arena, count: usize) -> Vec<Vec<[f32; 2]>> {
    let scene = arena.scene().unwrap();
    let walls = &scene.walls[scene.walls.len() - count..];
    let shift = |[x, y]: [f32; 2]| [x - scene.width / 2.0, y - scene.height / 2.0];
    let shifted = |points: &[[f32; 2]]| points.iter().copied().map(shift).collect();
    walls.iter().map(|wall| shifted(&wall.points)).collect()
}

/// All robots drive along x, whatever they look at.
fn drive_east(arena: &mut Arena, ticks: usize) {
    for _ in 0..ticks {
        let scene = arena.scene().unwrap();
        let headings = scene.bodies.iter().filter_map(|body| body.heading);
        let actuators: Vec<f32> = headings
            .flat_map(|heading| [heading.cos(), -heading.sin(), 0.0])
            .collect();
        arena.step(&actuators);
    }
}

/// How far robots that stand side by side west of a box get it in 10 s.
fn pushed(count: u32, mass: f32, friction: f32) -> f32 {
    let object = json!([{"name": "load", "size": [0.2, 0.6], "center": [0, 0], "mass": mass, "friction": friction}]);
    // One above the other: each has a strip of its own.
    let height = 0.08 * count as f32;
    let mut mission = mission(
        &object,
        &json!({"rectangle": {"x": [-0.3, -0.15], "y": [-height / 2.0, height / 2.0]}}),
    );
    mission["robots"] = json!(count);
    let mut arena = arena(&json!({"mission": mission, "duration": 20}));
    drive_east(&mut arena, 100);
    objects(&arena)[0][0]
}

#[test]
fn as_many_robots_as_friction_demands_move_an_object() {
    // A robot pushes with 0.4 kg x 3.75 m/s^2 = 1.5 N. Friction of 2 kg x 9.81 m/s^2 x 0.12 = 2.35 N.
    let one = pushed(1, 2.0, 0.12);
    assert!(one.abs() < 0.002, "{one}");
    let two = pushed(2, 2.0, 0.12);
    assert!(two > 0.5, "{two}");
    // 4.1 N: three.
    let two = pushed(2, 2.0, 0.21);
    assert!(two.abs() < 0.003, "{two}");
    let three = pushed(3, 2.0, 0.21);
    assert!(three > 0.3, "{three}");
}

/// Where points are beside the walls, metres: positive outside.
fn beyond_walls(points: &[[f32; 2]]) -> f32 {
    let beyond = |[x, y]: &[f32; 2]| (x.abs() - 1.5).max(y.abs() - 1.0);
    points.iter().map(beyond).fold(f32::NEG_INFINITY, f32::max)
}

/// How deep the corners of polygons that are convex lie in each other, metres; 0 where they do not.
fn overlap(a: &[[f32; 2]], b: &[[f32; 2]]) -> f32 {
    let depth = |[x, y]: [f32; 2], of: &[[f32; 2]]| {
        (0..of.len())
            .map(|index| {
                let ([ax, ay], [bx, by]) = (of[index], of[(index + 1) % of.len()]);
                let left = (bx - ax) * (y - ay) - (by - ay) * (x - ax);
                left / (bx - ax).hypot(by - ay)
            })
            .fold(f32::INFINITY, f32::min)
    };
    let inside = |points: &[[f32; 2]], of: &[[f32; 2]]| {
        points
            .iter()
            .map(|point| depth(*point, of))
            .fold(0.0, f32::max)
    };
    inside(a, b).max(inside(b, a))
}

fn many_objects(seed: u64) -> Value {
    let objects = json!([
        {"name": "disc", "radius": 0.1, "mass": 0.5, "friction": 0.1, "count": 3,
            "start": {"rectangle": {"x": [-1.2, 1.2], "y": [-0.7, 0.7]}}},
        {"name": "box", "size": [0.3, 0.12], "mass": 0.4, "friction": 0.15, "count": 4,
            "start": {"rectangle": {"x": [-1.2, 1.2], "y": [-0.7, 0.7]}}},
        {"name": "bar", "size": [0.6, 0.05], "mass": 0.3, "friction": 0.1, "center": [0, 0.3], "angle": 20},
    ]);
    let start = json!({"rectangle": {"x": [-1.4, 1.4], "y": [-0.9, 0.9]}});
    let mut mission = mission(&objects, &start);
    mission["obstacles"] = json!([{"center": [0.6, -0.4], "size": [0.3, 0.06], "angle": 30}]);
    mission["robots"] = json!(12);
    json!({"mission": mission, "duration": 30, "seed": seed})
}

#[test]
fn nothing_is_pushed_through_walls_or_through_anything_else() {
    let (mut moved, mut deepest) = (0.0_f32, 0.0_f32);
    for seed in 0..4 {
        let mut arena = arena(&many_objects(seed));
        let before = objects(&arena);
        for tick in 0..200 {
            // All in one direction for a time, so that they press objects against walls.
            let angle = (tick / 40) as f32 * 1.3 + seed as f32;
            let scene = arena.scene().unwrap();
            let headings = scene.bodies.iter().filter_map(|body| body.heading);
            let actuators: Vec<f32> = headings
                .flat_map(|heading| [(angle - heading).cos(), (angle - heading).sin(), 0.0])
                .collect();
            arena.step(&actuators);
            let rims = rims(&arena, 8);
            let shapes = arena.scene().unwrap().walls.len() - 8;
            assert_eq!(shapes, 2, "the walls and the obstacle");
            for (index, rim) in rims.iter().enumerate() {
                let beyond = beyond_walls(rim);
                assert!(beyond < 0.001, "{beyond} m beyond, {seed}, {tick}");
                for other in &rims[index + 1..] {
                    deepest = deepest.max(overlap(rim, other));
                }
                for [x, y] in robots(&arena) {
                    let disc: Vec<[f32; 2]> = (0..32)
                        .map(|part| part as f32 / 32.0 * std::f32::consts::TAU)
                        .map(|turn| [x + 0.035 * turn.cos(), y + 0.035 * turn.sin()])
                        .collect();
                    deepest = deepest.max(overlap(rim, &disc));
                }
            }
            let scene = arena.scene().unwrap();
            let shift = |[x, y]: [f32; 2]| [x - scene.width / 2.0, y - scene.height / 2.0];
            let obstacle = scene.walls[1].points.iter().copied().map(shift);
            let obstacle: Vec<[f32; 2]> = obstacle.collect();
            for rim in &rims {
                deepest = deepest.max(overlap(rim, &obstacle));
            }
        }
        for (from, to) in before.iter().zip(objects(&arena)) {
            moved = moved.max((from[0] - to[0]).hypot(from[1] - to[1]));
        }
    }
    assert!(deepest < 0.002, "{deepest} m into each other");
    assert!(moved > 0.5, "{moved}");
}

#[test]
fn a_push_keeps_momentum_and_loses_energy() {
    // A robot that hits a disc with hardly any friction: both go on at the speed of the common momentum, the drive adds
    // what it can.
    let object =
        json!([{"name": "disc", "radius": 0.1, "center": [0, 0], "mass": 0.8, "friction": 0.001}]);
    let start = json!({"rectangle": {"x": [-0.2, -0.19], "y": [-0.0001, 0.0001]}});
    let mut arena = arena(&json!({"mission": mission(&object, &start), "duration": 20}));
    let (mut speeds, mut before) = (Vec::new(), objects(&arena)[0][0]);
    for _ in 0..20 {
        drive_east(&mut arena, 1);
        let now = objects(&arena)[0][0];
        speeds.push((now - before) * 10.0);
        before = now;
    }
    // Hardly faster than the robot drives, 0.12 m/s: few passes over drives and contacts leave a few percent.
    assert!(speeds.iter().all(|speed| *speed < 0.126), "{speeds:?}");
    assert!(speeds[19] > 0.112, "{speeds:?}");
    // The robot stops: the disc glides on, slowed down by 0.00981 m/s^2.
    let mut ways = Vec::new();
    for _ in 0..20 {
        arena.step(&[0.0; 3]);
        let now = objects(&arena)[0][0];
        ways.push((now - before) * 10.0);
        before = now;
    }
    for pair in ways.windows(2) {
        assert!((pair[0] - pair[1] - 0.000981).abs() < 2e-4, "{ways:?}");
    }
}

#[test]
fn friction_stops_an_object_and_what_is_pushed_beside_its_middle_turns() {
    let object = json!([{"name": "bar", "size": [0.1, 0.6], "center": [0, 0], "mass": 0.3, "friction": 0.2}]);
    let start = json!({"rectangle": {"x": [-0.12, -0.1], "y": [0.2, 0.25]}});
    let mut arena = arena(&json!({"mission": mission(&object, &start), "duration": 20}));
    let upright = rims(&arena, 1);
    drive_east(&mut arena, 20);
    let rim = rims(&arena, 1)[0].clone();
    let along = (rim[2][0] - rim[1][0]).atan2(rim[2][1] - rim[1][1]);
    assert!(along > 0.2, "it turns clockwise: {along}, {rim:?}");
    for _ in 0..3 {
        arena.step(&[0.0; 3]);
    }
    let still = rims(&arena, 1);
    assert_ne!(still, upright);
    for _ in 0..50 {
        arena.step(&[0.0; 3]);
    }
    let after = rims(&arena, 1);
    for (before, after) in still[0].iter().zip(&after[0]) {
        let way = (before[0] - after[0]).hypot(before[1] - after[1]);
        assert!(way < 2e-4, "only what overlaps is pushed apart: {way} m");
    }
    for _ in 0..3 {
        arena.step(&[0.0; 3]);
    }
    assert_eq!(rims(&arena, 1), after, "nothing pushes");
}

#[test]
fn objects_are_seen_and_hide_what_is_behind_them() {
    // A robot 0.3 m west of the middle of each object, which looks east.
    for (object, expected) in [
        (json!({"radius": 0.1}), 0.3 - 0.1 - 0.035),
        (json!({"size": [0.1, 0.4]}), 0.3 - 0.05 - 0.035),
        (
            json!({"size": [0.2, 0.2], "angle": 45}),
            0.3 - 0.02_f32.sqrt() - 0.035,
        ),
    ] {
        let mut object = object;
        object["name"] = json!("thing");
        object["mass"] = json!(1);
        object["center"] = json!([0, 0]);
        let start = json!({"rectangle": {"x": [-0.3, -0.2999], "y": [-0.0001, 0.0001]}});
        let arena = arena(&json!({"mission": mission(&json!([object]), &start)}));
        let mut sensors = [0.0; 8];
        arena.sense(0, &mut sensors);
        let nearest = sensors.iter().copied().filter(|reading| *reading > 0.0);
        let nearest = nearest.fold(f32::INFINITY, f32::min);
        // The ray that is nearest to the east is up to 22.5 degrees off it.
        assert!(
            nearest > expected - 0.001 && nearest < 0.3,
            "{object}: {sensors:?}, {expected}"
        );
        let scene = arena.scene().unwrap();
        for (ray, reading) in scene.rays.iter().zip(sensors) {
            assert!((ray.reading.unwrap() - reading).abs() < 1e-4);
        }
    }
    // Two robots with a box between them neither hear each other nor see the lamp behind it.
    let robot = json!({"radius": 0.035, "drive": {"kind": "differential", "wheel_base": 0.05, "max_speed": 0.1},
        "sensors": [{"kind": "light", "count": 4, "reach": 5}, {"kind": "range_and_bearing", "range": 1, "gives": ["count"]}]});
    let read = |objects: Value| {
        let mut mission = mission(
            &objects,
            &json!({"rectangle": {"x": [-0.4, 0.4], "y": [-0.04, 0.04]}}),
        );
        mission["robot"] = robot.clone();
        mission["robots"] = json!(2);
        mission["metrics"] = json!({});
        mission["fitness"] = json!("order");
        mission["lights"] = json!([{"at": [1.4, 0, 0.2], "intensity": 5}]);
        // A seed for which one is west and one is east of the box.
        let seed = (0..200)
            .find(|seed| {
                let arena = arena(&json!({"mission": mission, "seed": seed}));
                let robots = robots(&arena);
                robots[0][0] < -0.2 && robots[1][0] > 0.2
            })
            .unwrap();
        let arena = arena(&json!({"mission": mission, "seed": seed}));
        let mut sensors = [[0.0; 5]; 2];
        arena.sense(0, &mut sensors[0]);
        arena.sense(1, &mut sensors[1]);
        let light = |row: [f32; 5]| row[..4].iter().sum::<f32>();
        (
            [sensors[0][4], sensors[1][4]],
            light(sensors[0]),
            light(sensors[1]),
        )
    };
    let open = read(json!([]));
    assert_eq!(open.0, [1.0, 1.0]);
    assert!(
        open.1 > 0.0,
        "one robot beside another does not hide the lamp: {open:?}"
    );
    let closed = read(
        json!([{"name": "box", "size": [0.1, 0.5], "center": [0, 0], "mass": 1, "height": 0.15}]),
    );
    assert_eq!(closed.0, [0.0, 0.0]);
    assert_eq!(closed.1, 0.0);
    assert!(closed.2 > 0.0);
    // A low one hides no lamp, but messages.
    let low = read(
        json!([{"name": "box", "size": [0.1, 0.5], "center": [0, 0], "mass": 1, "height": 0.001}]),
    );
    assert_eq!(low.0, [0.0, 0.0]);
    assert!(low.1 > 0.0);
}

#[test]
fn metrics_follow_from_where_objects_are() {
    let object = json!([{"name": "near", "radius": 0.05, "center": [0.1, 0], "mass": 1},
        {"name": "far", "size": [0.1, 0.1], "center": [1, 0], "mass": 1}]);
    let start = json!({"rectangle": {"x": [-1.4, -1], "y": [-0.5, 0.5]}});
    let mut mission = mission(&object, &start);
    for (name, metric) in [
        (
            "a",
            json!({"kind": "object_distance", "patch": "goal", "object": "far"}),
        ),
        (
            "b",
            json!({"kind": "objects_on", "patch": "goal", "share": true, "when": "mean"}),
        ),
        (
            "c",
            json!({"kind": "objects_on", "patch": "goal", "object": "near"}),
        ),
        (
            "d",
            json!({"kind": "objects_on", "patch": "goal", "object": "far", "when": "mean"}),
        ),
    ] {
        mission["metrics"][name] = metric;
    }
    let mut arena = arena(&json!({"mission": mission, "duration": 0.5}));
    while !arena.acting().is_empty() {
        arena.step(&[0.0; 3]);
    }
    let metrics = arena.metrics();
    let names = arena.description().metrics;
    let value = |name: &str| metrics[names.iter().position(|metric| metric.name == name).unwrap()];
    assert_eq!(value("a"), 1.0);
    assert_eq!(value("b"), 0.5);
    // Five ticks: the start, and 0.1 to 0.4 s.
    assert_eq!(value("c"), 5.0);
    assert_eq!(value("d"), 0.0);
    assert!((value("far") - 0.55).abs() < 1e-6);
    assert_eq!(value("on"), 1.0);
}

#[test]
fn the_same_seed_gives_the_same_episode_and_others_other_places() {
    let run = |seed: u64| {
        let mut arena = arena(&many_objects(seed));
        let start = objects(&arena);
        drive_east(&mut arena, 40);
        (start, objects(&arena), robots(&arena))
    };
    assert_eq!(run(3), run(3));
    assert_ne!(run(3).0[..7], run(4).0[..7]);
    assert_eq!(run(3).0[7], run(4).0[7], "a center is fixed");
    // None overlaps another, a wall or a robot at the start.
    for seed in 0..20 {
        let arena = arena(&many_objects(seed));
        let rims = rims(&arena, 8);
        for (index, rim) in rims.iter().enumerate() {
            assert!(beyond_walls(rim) < 1e-5);
            assert!(
                rims[index + 1..]
                    .iter()
                    .all(|other| overlap(rim, other) < 1e-5)
            );
        }
    }
}
