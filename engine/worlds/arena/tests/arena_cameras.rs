//! LEDs, and cameras that see them.
#![allow(clippy::unwrap_used)] // helpers of tests

use serde_json::{Value, json};
use swarmwright_kernels::Arena;
use swarmwright_simulation::Simulation;

const RADIUS: f64 = 0.05;
const RANGE: f64 = 1.5;

/// Robots that show cyan or red, with a compass.
fn robot(camera: &Value) -> Value {
    json!({
        "radius": RADIUS, "drive": {"kind": "differential", "wheel_base": 0.08, "max_speed": 0.2},
        "sensors": [{"kind": "compass"}, camera],
        "actuators": [{"kind": "led", "colors": ["cyan", "red"]}],
    })
}

fn camera(gives: &[&str]) -> Value {
    json!({"kind": "camera", "range": RANGE, "colors": ["red", "cyan"], "gives": gives})
}

/// Robots around a box in the middle, 0.1 m by 1.2 m.
fn arena(robot: &Value, robots: u32, lights: &Value, seed: u64) -> Arena {
    let mission = json!({
        "walls": {"rectangle": [3, 3]}, "lights": lights,
        "obstacles": [{"center": [0, 0], "size": [0.1, 1.2]}],
        "start": {"rectangle": {"x": [-1.4, 1.4], "y": [-1.4, 1.4]}}, "fitness": "order",
    });
    let parameters = json!({"mission": mission, "robot": robot, "robots": robots, "seed": seed});
    let mut arena = Arena::default();
    arena.reset(parameters.as_object().unwrap()).unwrap();
    arena
}

fn sensed(arena: &Arena, agent: usize) -> Vec<f64> {
    let mut numbers = vec![0.0; arena.description().sensors];
    arena.sense(agent as u32, &mut numbers);
    numbers.into_iter().map(f64::from).collect()
}

/// Where robots are, and the colours of their LEDs.
fn agents(arena: &Arena) -> Vec<([f64; 2], String)> {
    let scene = arena.scene().unwrap();
    let [low_x, low_y] = [scene.width / 2.0, scene.height / 2.0];
    let of = |kind: &'static str| scene.bodies.iter().filter(move |body| body.kind == kind);
    let mut leds = of("led");
    of("agent")
        .map(|body| {
            let at = [f64::from(body.x - low_x), f64::from(body.y - low_y)];
            let lit = leds.next().map(|led| {
                assert_eq!([led.x, led.y], [body.x, body.y]);
                led.state.to_string()
            });
            (at, lit.unwrap_or_default())
        })
        .collect()
}

/// Whether the line between two points meets the box.
fn behind_box(a: [f64; 2], b: [f64; 2]) -> bool {
    // The part of the line within each pair of sides.
    let (mut first, mut last) = (0.0_f64, 1.0_f64);
    for (axis, half) in [(0, 0.05), (1, 0.6)] {
        let (from, way) = (a[axis], b[axis] - a[axis]);
        let (s, t) = ((-half - from) / way, (half - from) / way);
        first = first.max(s.min(t));
        last = last.min(s.max(t));
    }
    first < last
}

/// Whether something stands in the line from one point to another that is seen.
fn hidden(at: &[[f64; 2]], viewer: usize, to: [f64; 2]) -> bool {
    let from = at[viewer];
    let way = [to[0] - from[0], to[1] - from[1]];
    let far = way[0].hypot(way[1]);
    let third = |other: &[f64; 2]| {
        let [x, y] = [other[0] - from[0], other[1] - from[1]];
        let (along, aside) = (
            (x * way[0] + y * way[1]) / far,
            (x * way[1] - y * way[0]) / far,
        );
        along > 0.0 && x.hypot(y) < far - 1e-6 && aside.abs() < RADIUS
    };
    behind_box(from, to) || at.iter().any(third)
}

/// What a robot sees of things of a colour: count, seen, attraction and direction, in its frame.
fn expected(targets: &[[f64; 2]], [cos, sin]: [f64; 2], from: [f64; 2], rims: f64) -> [f64; 6] {
    let mut sum = [0.0; 2];
    for target in targets {
        let [x, y] = [target[0] - from[0], target[1] - from[1]];
        let far = x.hypot(y);
        let weight = 1.0 / (1.0 + (100.0 * (far - rims)).max(0.0)) / far;
        sum[0] += (x * cos + y * sin) * weight;
        sum[1] += (y * cos - x * sin) * weight;
    }
    let length = sum[0].hypot(sum[1]);
    let [x, y] = sum.map(|part| if length > 0.0 { part / length } else { 0.0 });
    let count = targets.len() as f64;
    [count, count.min(1.0), sum[0], sum[1], x, y]
}

#[track_caller]
fn all_close(a: &[f64], b: &[f64], within: f64) {
    assert_eq!(a.len(), b.len());
    for (left, right) in a.iter().zip(b) {
        assert!((left - right).abs() <= within, "{a:?}, {b:?}");
    }
}

#[test]
fn colours_are_seen_where_nothing_stands_between() {
    let gives = ["count", "seen", "attraction", "direction"];
    let (mut seen, mut hid) = (0, 0);
    for seed in 0..20 {
        let mut arena = arena(&robot(&camera(&gives)), 12, &json!([]), seed);
        assert_eq!(arena.actuator_names()[2..], ["led cyan", "led red"]);
        assert_eq!(arena.sensor_names()[2..4], ["red count", "red seen"]);
        assert_eq!(arena.sensor_names().len(), arena.description().sensors);
        // At the start no robot shows a colour.
        assert!((0..12).all(|agent| {
            sensed(&arena, agent)[2..]
                .iter()
                .all(|number| *number == 0.0)
        }));
        // None, cyan and red by turns.
        let shows = [
            [0.0, 0.0, -0.5, 0.0],
            [0.0, 0.0, 0.7, 0.2],
            [0.0, 0.0, -1.0, 0.1],
        ];
        let told: Vec<f32> = (0..12).flat_map(|agent| shows[agent % 3]).collect();
        arena.step(&told);
        let scene = arena.scene().unwrap();
        assert_eq!(scene.styles.len(), 3, "two colours, and off");
        let (at, states): (Vec<_>, Vec<_>) = agents(&arena).into_iter().unzip();
        for agent in 0..12 {
            assert_eq!(states[agent], ["", "cyan", "red"][agent % 3]);
            let numbers = sensed(&arena, agent);
            let turn = [numbers[0], -numbers[1]];
            for (first, color) in [(2, 2), (8, 1)] {
                let near = (0..12).filter(|other| {
                    let [x, y] = [at[*other][0] - at[agent][0], at[*other][1] - at[agent][1]];
                    *other != agent && other % 3 == color && x.hypot(y) < RANGE
                });
                let near: Vec<_> = near.map(|other| at[other]).collect();
                let visible: Vec<_> = near
                    .iter()
                    .copied()
                    .filter(|to| !hidden(&at, agent, *to))
                    .collect();
                hid += near.len() - visible.len();
                seen += visible.len();
                let found = &numbers[first..first + 6];
                all_close(
                    found,
                    &expected(&visible, turn, at[agent], 2.0 * RADIUS),
                    1e-4,
                );
            }
        }
    }
    assert!(seen > 500 && hid > 100, "{seen} seen, {hid} hidden");
}

#[test]
fn the_colour_with_the_largest_number_above_0_is_shown() {
    let cases = [
        ([0.2, 0.7], "red"),
        ([0.7, 0.2], "cyan"),
        ([0.5, 0.5], "cyan"),
        ([-1.0, -0.1], ""),
        ([0.0, 0.0], ""),
        ([0.0, 1e-6], "red"),
    ];
    let mut arena = arena(&robot(&camera(&["count"])), 1, &json!([]), 1);
    for ([cyan, red], expected) in cases {
        arena.step(&[0.0, 0.0, cyan, red]);
        assert_eq!(agents(&arena)[0].1, expected);
    }
}

#[test]
fn lamps_with_a_colour_are_seen_also_when_they_are_off() {
    let lights = json!([
        {"at": [1.2, 1.2, 0.4], "intensity": 0, "color": "red"}, {"at": [-1.2, 0, 0.4], "intensity": 1, "color": "cyan"},
        {"at": [-1.2, -1, 0.4], "intensity": 1}, {"at": [0, -1, 0.4], "intensity": 2, "color": "yellow"},
    ]);
    let mut seen = [0; 2];
    for seed in 0..40 {
        let gives = ["count", "seen", "attraction", "direction"];
        let arena = arena(&robot(&camera(&gives)), 3, &lights, seed);
        let at: Vec<_> = agents(&arena).into_iter().map(|(at, _)| at).collect();
        for agent in 0..3 {
            let numbers = sensed(&arena, agent);
            let turn = [numbers[0], -numbers[1]];
            for (index, lamp) in [[1.2, 1.2], [-1.2, 0.0]].into_iter().enumerate() {
                let far = (lamp[0] - at[agent][0]).hypot(lamp[1] - at[agent][1]);
                let visible = far < RANGE && !hidden(&at, agent, lamp);
                let things = if visible { &[lamp][..] } else { &[] };
                seen[index] += things.len();
                let found = &numbers[2 + 6 * index..][..6];
                all_close(found, &expected(things, turn, at[agent], RADIUS), 1e-4);
            }
        }
    }
    assert!(seen.iter().all(|seen| (10..110).contains(seen)), "{seen:?}");
    let scene = arena(&robot(&camera(&["count"])), 1, &lights, 0)
        .scene()
        .unwrap();
    let shining: Vec<f32> = scene.lights.iter().map(|light| light.intensity).collect();
    assert_eq!(shining, [1.0, 1.0, 2.0], "one that is off sheds no light");
    let lamps = scene.bodies.iter().filter(|body| body.kind == "lamp");
    let lamps: Vec<_> = lamps.map(|body| &body.state[..]).collect();
    assert_eq!(lamps, ["red", "cyan", "yellow"]);
}

#[test]
fn lit_robots_keep_their_kind_and_what_fails_in_scenes() {
    let lights = json!({"kind": "led", "colors": ["red"]});
    let model = |radius: f64| {
        json!({"radius": radius, "drive": {"kind": "differential", "wheel_base": 0.05, "max_speed": 0.1},
            "sensors": [{"kind": "proximity", "count": 4, "range": 3}], "actuators": [lights]})
    };
    let parameters = json!({
        "mission": {"walls": {"rectangle": [3, 3]}, "start": {"disc": {"radius": 1}}, "fitness": "order"},
        "robots": [{"name": "scout", "count": 2, "robot": model(0.03)}, {"name": "base", "count": 1, "robot": model(0.06)}],
        "failures": [{"kind": "stop", "share": 1, "robots": "base"}],
    });
    let mut arena = Arena::default();
    arena.reset(parameters.as_object().unwrap()).unwrap();
    let before = arena.scene().unwrap();
    arena.step(&[0.0, 0.0, 1.0, 0.0, 0.0, -1.0, 0.0, 0.0, 1.0]);
    let scene = arena.scene().unwrap();
    let states = |scene: &swarmwright_simulation::Scene| -> Vec<String> {
        let bodies = scene.bodies.iter();
        bodies
            .map(|body| format!("{} {}", body.kind, body.state))
            .collect()
    };
    assert_eq!(before.bodies.len(), scene.bodies.len());
    let robots = ["agent scout", "agent scout", "agent base, stopped"];
    assert_eq!(
        states(&before),
        [&robots[..], &["led ", "led ", "led "]].concat()
    );
    assert_eq!(
        states(&scene),
        [&robots[..], &["led red", "led ", "led red"]].concat()
    );
    // Rays end in the arena.
    for ray in &scene.rays {
        let body = &scene.bodies[ray.body as usize];
        let (sin, cos) = (body.heading.unwrap() + ray.angle).sin_cos();
        let far = ray.start + ray.length;
        let end = [
            body.x + far * cos + scene.origin[0],
            body.y + far * sin + scene.origin[1],
        ];
        assert!(end.iter().all(|at| at.abs() < 1.5 + 1e-4), "{end:?}");
    }
}

#[test]
fn directions_are_off_by_at_most_the_noise() {
    let mut noisy = camera(&["direction"]);
    noisy["noise"] = json!(20);
    let mut most = 0.0_f64;
    for seed in 0..100 {
        let turned = [camera(&["direction"]), noisy.clone()].map(|camera| {
            let mut arena = arena(&robot(&camera), 2, &json!([]), seed);
            arena.step(&[0.0, 0.0, 0.0, 1.0].repeat(2));
            let numbers = sensed(&arena, 0);
            (numbers[2].hypot(numbers[3]) > 0.5).then(|| numbers[3].atan2(numbers[2]).to_degrees())
        });
        let [plain, noisy] = turned;
        assert_eq!(plain.is_some(), noisy.is_some());
        if let (Some(plain), Some(noisy)) = (plain, noisy) {
            let off = (noisy - plain + 540.0).rem_euclid(360.0) - 180.0;
            most = most.max(off.abs());
        }
    }
    assert!((12.0..=20.01).contains(&most), "{most}");
}

#[test]
fn mistakes_name_the_place() {
    let refusal = |sensor: Value, colors: Value| {
        let mut robot = robot(&sensor);
        robot["actuators"][0]["colors"] = colors;
        let parameters = json!({"robot": robot});
        let refused = Arena::default().reset(parameters.as_object().unwrap());
        refused.unwrap_err().to_string()
    };
    let with = |key: &str, value: Value| {
        let mut camera = camera(&["count"]);
        camera[key] = value;
        refusal(camera, json!(["red"]))
    };
    let cases = [
        (
            with("range", json!(0)),
            "robot.sensors[1].range: 0 found, expected 0.001 to 1000",
        ),
        (with("noise", json!(-1)), "robot.sensors[1].noise: -1 found"),
        (
            with("colors", json!([])),
            "robot.sensors[1].colors: expected at least one",
        ),
        (
            with("colors", json!(["red", "orange"])),
            "\"orange\" found, expected one of \"red\", \"green\", \"blue\", \"cyan\", \"magenta\", \"yellow\"",
        ),
        (
            with("gives", json!(["seen", "seen"])),
            "robot.sensors[1].gives[1]: occurs twice",
        ),
        (
            refusal(camera(&["count"]), json!(["red", "blue", "red"])),
            "robot.actuators[0].colors[2]: occurs twice",
        ),
        (
            refusal(camera(&["count"]), json!([])),
            "robot.actuators[0].colors: expected at least one",
        ),
    ];
    for (message, expected) in cases {
        assert!(message.contains(expected), "{message:?} lacks {expected:?}");
    }
}

/// Spots in front of a side: a tenth of a metre apart.
fn spots(from: [f64; 2], way: [f64; 2], count: usize) -> Vec<[f64; 2]> {
    let at = |index: usize| 0.05 + 0.1 * index as f64;
    let spot = |index: usize| [from[0] + at(index) * way[0], from[1] + at(index) * way[1]];
    (0..count).map(spot).collect()
}

fn painted(robots: u32, seed: u64) -> Arena {
    let mission = json!({
        "walls": {"rectangle": [3, 3], "colors": [
            {"side": 0, "color": "red"}, {"side": 1, "from": 0.5, "to": 1.5, "color": "cyan"}]},
        "obstacles": [{"center": [0, 0], "size": [0.1, 1.2], "color": "cyan"}],
        "objects": [{"name": "ball", "radius": 0.1, "mass": 1, "center": [0.9, 0.9], "color": "red"},
            {"name": "bar", "size": [0.3, 0.05], "mass": 1, "center": [0.9, 0.6]}],
        "start": {"rectangle": {"x": [-1.4, 1.4], "y": [-1.4, 1.4]}}, "fitness": "order",
    });
    let model = robot(&camera(&["count", "seen", "attraction", "direction"]));
    let parameters = json!({"mission": mission, "robot": model, "robots": robots, "seed": seed});
    let mut arena = Arena::default();
    arena.reset(parameters.as_object().unwrap()).unwrap();
    arena
}

#[test]
fn walls_and_objects_are_seen_in_their_colours() {
    let floor = -1.5 + 0.001;
    let bottom = spots([-1.5, floor], [1.0, 0.0], 30);
    let right = spots([1.499, -1.0], [0.0, 1.0], 10);
    let faces = [
        spots([0.051, -0.6], [0.0, 1.0], 12),
        spots([-0.051, -0.6], [0.0, 1.0], 12),
        vec![[0.0, 0.601], [0.0, -0.601]],
    ];
    let (ball, bar) = ([0.9, 0.9], ([0.75, 0.575], [1.05, 0.625]));
    // Whether the line passes an object that is not the one that is looked at.
    let behind = |from: [f64; 2], to: [f64; 2], to_ball: bool| {
        let way = [to[0] - from[0], to[1] - from[1]];
        let (mut first, mut last) = (0.0_f64, 1.0_f64);
        for axis in 0..2 {
            let (low, high) = ([bar.0[axis], bar.1[axis]][0], bar.1[axis]);
            let (s, t) = (
                (low - from[axis]) / way[axis],
                (high - from[axis]) / way[axis],
            );
            first = first.max(s.min(t));
            last = last.min(s.max(t));
        }
        let far = way[0].hypot(way[1]);
        let [x, y] = [ball[0] - from[0], ball[1] - from[1]];
        let (along, aside) = (
            (x * way[0] + y * way[1]) / far,
            (x * way[1] - y * way[0]) / far,
        );
        let passes = aside.abs() < 0.1 && along > 0.0 && along < far;
        first < last || (!to_ball && passes)
    };
    let (mut walls, mut balls, mut hid) = (0, 0, 0);
    for seed in 0..12 {
        let arena = painted(8, seed);
        let at: Vec<[f64; 2]> = agents(&arena).into_iter().map(|(at, _)| at).collect();
        for agent in 0..8 {
            let found = sensed(&arena, agent);
            let near = |to: &[f64; 2], to_ball: bool| {
                let far = (to[0] - at[agent][0]).hypot(to[1] - at[agent][1]);
                let seen = !hidden(&at, agent, *to) && !behind(at[agent], *to, to_ball);
                far < RANGE && seen
            };
            let cyan = right.iter().chain(faces.iter().flatten());
            let cyan: Vec<[f64; 2]> = cyan.filter(|spot| near(spot, false)).copied().collect();
            let heading = [found[0], -found[1]];
            all_close(
                &found[8..],
                &expected(&cyan, heading, at[agent], RADIUS),
                3e-4,
            );
            let red: Vec<[f64; 2]> = bottom
                .iter()
                .filter(|spot| near(spot, false))
                .copied()
                .collect();
            let seen = expected(&red, heading, at[agent], RADIUS);
            let sees_ball = near(&ball, true);
            let of_ball = expected(&[ball], heading, at[agent], RADIUS + 0.1);
            let part = f64::from(u8::from(sees_ball));
            for (number, index) in [(0, 2), (2, 4), (3, 5)] {
                let sum = seen[number] + part * of_ball[number];
                assert!(
                    (found[index] - sum).abs() < 3e-4,
                    "{seed} {agent}: {found:?}, {sum}"
                );
            }
            walls += red.len() + cyan.len();
            balls += usize::from(sees_ball);
            hid += 30 + 10 + 26 - red.len() - cyan.len();
        }
    }
    assert!(
        walls > 500 && balls > 10 && hid > 500,
        "{walls} {balls} {hid}"
    );
    let scene = painted(1, 0).scene().unwrap();
    let of = |kind: &str, state: &str| {
        let same = |body: &&swarmwright_simulation::Body| body.kind == kind && body.state == state;
        scene.bodies.iter().filter(same).count()
    };
    assert_eq!(
        [
            of("wall", "red"),
            of("wall", "cyan"),
            of("object", "red"),
            of("object", "")
        ],
        [30, 36, 1, 1]
    );
    let style = |kind: &str| {
        scene
            .styles
            .iter()
            .any(|style| style.kind == kind && style.state == "red")
    };
    assert!(style("wall") && style("object") && !style("lamp"));
    // Together the lines of a colour are as long as what has it.
    let length = |state: &str| -> f32 {
        let walls = scene.bodies.iter().filter(|body| body.kind == "wall");
        let lines = walls.filter(|body| body.state == state);
        lines.map(|line| 2.0 * line.radius).sum()
    };
    assert!((length("red") - 3.0).abs() < 1e-4, "{}", length("red"));
    assert!((length("cyan") - 3.6).abs() < 1e-4, "{}", length("cyan"));
    let below = scene.bodies.iter().find(|body| body.kind == "wall");
    assert_eq!(below.unwrap().heading, Some(0.0));
}

#[test]
fn colours_of_walls_are_checked() {
    let refusal = |colors: Value, size: f64| {
        let mission = json!({"walls": {"rectangle": [size, size], "colors": colors},
            "start": {"disc": {"radius": 0.8}}, "fitness": "order"});
        let parameters = json!({"mission": mission});
        let refused = Arena::default().reset(parameters.as_object().unwrap());
        refused.unwrap_err().to_string()
    };
    for (colors, size, expected) in [
        (
            json!([{"side": 4, "color": "red"}]),
            2.0,
            "walls.colors[0].side: 4 found, but the walls have the sides 0 to 3",
        ),
        (
            json!([{"side": 1, "color": "red"}, {"side": 1, "color": "red", "from": 1, "to": 2.5}]),
            2.0,
            "walls.colors[1]: from 1 to 2.5 found, expected metres along the side, 0 to 2",
        ),
        (
            json!([{"side": 1, "color": "red", "from": 1, "to": 0.5}]),
            2.0,
            "from 1 to 0.5 found",
        ),
        (
            json!([{"side": 1, "color": "pink"}]),
            2.0,
            "walls.colors[0].color: \"pink\" found, expected one of \"red\"",
        ),
        (
            json!([{"side": 1, "color": "red"}]),
            200.0,
            "walls.colors: 2000 coloured spots found",
        ),
    ] {
        let message = refusal(colors, size);
        assert!(message.contains(expected), "{message:?} lacks {expected:?}");
    }
}
