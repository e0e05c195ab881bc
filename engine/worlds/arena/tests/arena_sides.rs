//! Sides of a match: kinds of robots with colours and places of their own, captures, restarts, and sums of metrics.
#![allow(clippy::unwrap_used)] // helpers of tests

use serde_json::{Value, json};
use swarmwright_kernels::Arena;
use swarmwright_simulation::{Scene, Side, Simulation};

use super::arena_lanes::{check, check_team};

/// A robot that moves in any direction, with the same sensors for all kinds.
fn robot(sensors: &Value) -> Value {
    json!({"radius": 0.05, "sensors": sensors, "drive": {"kind": "holonomic", "max_speed": 0.5, "max_turn": 0}})
}

fn camera() -> Value {
    json!([
        {"kind": "camera", "range": 3, "colors": ["red", "blue"], "gives": ["count"]},
        {"kind": "range_and_bearing", "range": 3, "gives": ["count"]},
    ])
}

/// Two red hunters in the west, two blue hares in the east of a long hall, each kind in a column.
fn hunt() -> Value {
    json!({
        "walls": {"rectangle": [4, 2]}, "start": {"disc": {"radius": 1}}, "duration": 6,
        "robots": [
            {"name": "hunters", "count": 2, "color": "red", "robot": robot(&camera()),
                "start": {"rectangle": {"x": [-1.5, -1.4], "y": [-0.8, 0.8]}}},
            {"name": "hares", "count": 2, "color": "blue", "robot": robot(&camera()),
                "start": {"rectangle": {"x": [0.5, 0.6], "y": [-0.8, 0.8]}}},
        ],
        "captures": [{"robots": "hares", "by": "hunters", "reach": 0.1}],
        "metrics": {
            "caught": {"kind": "caught", "robots": "hares", "when": "end"},
            "anybody": {"kind": "caught", "share": true, "when": "end"},
            "hunters_fitness": {"kind": "caught", "robots": "hares", "share": true, "when": "mean"},
            "hares_fitness": {"kind": "sum", "offset": 1, "factors": {"hunters_fitness": -1}},
        },
        "sides": {"hunters": {"fitness": "hunters_fitness"}, "hares": {"fitness": "hares_fitness"}},
        "fitness": "hunters_fitness",
    })
}

fn arena(mission: &Value, seed: u64) -> Arena {
    let parameters = json!({"mission": mission, "seed": seed});
    let mut arena = Arena::default();
    arena.reset(parameters.as_object().unwrap()).unwrap();
    arena
}

fn refusal(mission: &Value) -> String {
    let parameters = json!({"mission": mission});
    let refused = Arena::default().reset(parameters.as_object().unwrap());
    refused.unwrap_err().to_string()
}

fn value(arena: &Arena, name: &str) -> f64 {
    let index = arena.description().metrics_named(&[name]).unwrap()[0];
    arena.metrics()[index]
}

/// Positions of a kind of bodies, in the coordinates of the mission.
fn at(scene: &Scene, kind: &str) -> Vec<[f32; 2]> {
    let bodies = scene.bodies.iter().filter(|body| body.kind == kind);
    let [x, y] = scene.origin;
    bodies.map(|body| [body.x + x, body.y + y]).collect()
}

/// Moves each robot by a velocity along the axes of the arena, as parts of the largest.
fn drive(arena: &mut Arena, ways: &[[f32; 2]]) {
    let scene = arena.scene().unwrap();
    let headings = scene.bodies.iter().filter(|body| body.kind == "agent");
    let actuators: Vec<f32> = headings
        .zip(ways)
        .flat_map(|(body, [x, y])| {
            let (sin, cos) = body.heading.unwrap().sin_cos();
            [x * cos + y * sin, y * cos - x * sin, 0.0]
        })
        .collect();
    arena.step(&actuators);
}

fn sensed(arena: &Arena, agent: u32) -> Vec<f32> {
    let mut numbers = vec![0.0; arena.description().sensors];
    arena.sense(agent, &mut numbers);
    numbers
}

#[test]
fn kinds_start_in_places_of_their_own() {
    for seed in 0..20 {
        let robots = at(&arena(&hunt(), seed).scene().unwrap(), "agent");
        for [x, _] in &robots[..2] {
            assert!((-1.5..=-1.4).contains(x), "{x}");
        }
        for [x, _] in &robots[2..] {
            assert!((0.5..=0.6).contains(x), "{x}");
        }
    }
    // Those without a place of their own start in that of the mission.
    let mut mission = hunt();
    mission["robots"][1]
        .as_object_mut()
        .unwrap()
        .remove("start");
    let robots = at(&arena(&mission, 1).scene().unwrap(), "agent");
    assert!(robots[2..].iter().all(|[x, y]| x.hypot(*y) <= 1.0));
}

#[test]
fn hunters_that_stand_catch_nobody() {
    let mut arena = arena(&hunt(), 1);
    while !arena.done() {
        drive(&mut arena, &[[0.0; 2]; 4]);
    }
    for name in ["caught", "anybody", "hunters_fitness"] {
        assert_eq!(value(&arena, name), 0.0);
    }
    assert_eq!(value(&arena, "hares_fitness"), 1.0);
    assert_eq!(arena.fitness(), 0.0);
}

#[test]
fn hares_are_caught_when_a_hunter_is_near_and_stand_from_then_on() {
    for seed in 0..10 {
        let mut arena = arena(&hunt(), seed);
        let mut caught: Vec<Option<[f32; 2]>> = vec![None; 2];
        let (mut share, mut ticks) = (0.0, 1.0);
        while !arena.done() {
            let before = at(&arena.scene().unwrap(), "agent");
            // The first hunter runs to the first hare that is free; hares run south.
            let target = caught.iter().position(Option::is_none).unwrap_or(0);
            let way = [0, 1].map(|axis| before[2 + target][axis] - before[0][axis]);
            let length = way[0].hypot(way[1]);
            let ways = [
                way.map(|part| part / length),
                [0.0; 2],
                [0.0, -0.2],
                [0.0, -0.2],
            ];
            drive(&mut arena, &ways);
            let scene = arena.scene().unwrap();
            let robots = at(&scene, "agent");
            for (hare, caught) in caught.iter_mut().enumerate() {
                let [x, y] = robots[2 + hare];
                let is_close = robots[..2]
                    .iter()
                    .any(|[hx, hy]| (hx - x).hypot(hy - y) < 0.2);
                let stood = (x - before[2 + hare][0]).hypot(y - before[2 + hare][1]);
                match caught {
                    None if is_close => *caught = Some([x, y]),
                    None => assert!(stood > 0.0 || y < -0.9),
                    // It brakes and then stands, unless somebody touches it.
                    Some(at) => {
                        let beside = |other: &[f32; 2]| (other[0] - x).hypot(other[1] - y);
                        let touched =
                            robots.iter().filter(|other| beside(other) < 0.11).count() > 1;
                        assert!(touched || (x - at[0]).hypot(y - at[1]) < 0.02);
                        *at = [x, y];
                    }
                }
                let state = &scene.bodies[2 + hare].state;
                let words = if caught.is_some() {
                    "hares, caught"
                } else {
                    "hares"
                };
                assert_eq!(state, words);
            }
            ticks += 1.0;
            share += caught.iter().flatten().count() as f64 / 2.0;
        }
        let count = caught.iter().flatten().count() as f64;
        assert!(count >= 1.0, "seed {seed}");
        assert_eq!(value(&arena, "caught"), count);
        assert_eq!(value(&arena, "anybody"), count / 4.0);
        assert!((value(&arena, "hunters_fitness") - share / ticks).abs() < 1e-12);
        let both = value(&arena, "hunters_fitness") + value(&arena, "hares_fitness");
        assert!((both - 1.0).abs() < 1e-12);
        assert_eq!(arena.fitness(), value(&arena, "hunters_fitness"));
    }
}

#[test]
fn who_is_caught_is_not_seen_nor_heard() {
    let mut mission = hunt();
    mission["captures"][0]["reach"] = json!(0.0);
    let mut free = arena(&mission, 3);
    // Red robots and blue robots that each sees, and robots that each hears.
    for agent in 0..4 {
        let red = if agent < 2 { 1.0 } else { 2.0 };
        assert_eq!(sensed(&free, agent), [red, 3.0 - red, 3.0]);
    }
    drive(&mut free, &[[0.0; 2]; 4]);
    assert_eq!(sensed(&free, 0), [1.0, 2.0, 3.0]);
    mission["captures"][0]["reach"] = json!(3.0);
    let mut caught = arena(&mission, 3);
    for _ in 0..2 {
        for agent in 0..4 {
            let red = if agent < 2 { 1.0 } else { 2.0 };
            assert_eq!(
                sensed(&caught, agent),
                [red, 0.0, if agent < 2 { 1.0 } else { 2.0 }]
            );
        }
        drive(&mut caught, &[[0.0; 2]; 4]);
    }
    assert_eq!(value(&caught, "caught"), 2.0);
    // Who is caught catches nobody.
    let more = json!({"robots": "hunters", "by": "hares", "reach": 3.0});
    mission["captures"].as_array_mut().unwrap().push(more);
    assert_eq!(value(&arena(&mission, 3), "anybody"), 0.5);
}

#[test]
fn sides_are_told_and_shown_in_their_colours() {
    let arena = arena(&hunt(), 1);
    let side = |name: &'static str, fitness: &'static str| Side {
        name: name.into(),
        groups: vec![name.into()],
        fitness: Some(fitness.into()),
    };
    let expected = [
        side("hunters", "hunters_fitness"),
        side("hares", "hares_fitness"),
    ];
    assert_eq!(arena.sides(), expected, "in the order of the robots");
    let styles = arena.scene().unwrap().styles;
    let looks: Vec<[&str; 4]> = styles
        .iter()
        .map(|style| [&style.kind[..], &style.state, &style.color, &style.shape])
        .collect();
    assert_eq!(
        looks,
        [
            ["agent", "hunters", "#e02020", "circle"],
            ["agent", "hares", "#2848e0", "circle"],
            ["agent", "hares, caught", "#a0b0f0", "circle"],
        ]
    );
    assert_eq!(Arena::default().sides(), []);
    let mut mission = hunt();
    mission["sides"] = json!({"all": {"robots": ["hares", "hunters"]}, "none": {"robots": []}});
    assert!(refusal(&mission).contains("mission.sides.none.robots: an empty list found"));
    mission["robots"]
        .as_array_mut()
        .unwrap()
        .push(json!({"name": "third", "count": 1, "robot": robot(&camera()), "color": "green"}));
    mission["sides"]["none"] = json!({"robots": ["third"]});
    let sides = arena_sides(&mission);
    assert_eq!(sides[0].groups, ["hares", "hunters"]);
    assert_eq!(sides[1].groups, ["third"]);
    assert_eq!(sides[1].fitness, None);
}

fn arena_sides(mission: &Value) -> Vec<Side> {
    arena(mission, 1).sides()
}

/// A pitch with a goal along the whole of both ends, and a robot on either side of the ball.
fn pitch() -> Value {
    json!({
        "walls": {"rectangle": [2, 0.6]}, "start": {"disc": {"radius": 0.1}}, "duration": 12,
        "floor": {"patches": [
            {"name": "west", "rectangle": {"x": [-1, -0.8], "y": [-0.3, 0.3]}, "color": "white"},
            {"name": "east", "rectangle": {"x": [0.8, 1], "y": [-0.3, 0.3]}, "color": "white"},
        ]},
        "objects": [
            {"name": "ball", "radius": 0.08, "mass": 0.05, "friction": 0.02, "center": [0, 0], "color": "green"},
            {"name": "stone", "size": [0.05, 0.05], "mass": 0.1, "center": [0, 0.25], "angle": 30},
        ],
        "robots": [
            {"name": "left", "count": 2, "color": "red", "robot": robot(&camera()),
                "start": {"rectangle": {"x": [-0.5, -0.2], "y": [-0.2, 0.2]}}},
            {"name": "right", "count": 2, "color": "blue", "robot": robot(&camera()),
                "start": {"rectangle": {"x": [0.2, 0.5], "y": [-0.2, 0.2]}}},
        ],
        "restart": {"object": "ball", "on": ["west", "east"]},
        "metrics": {
            "left_goals": {"kind": "objects_on", "object": "ball", "patch": "east"},
            "right_goals": {"kind": "objects_on", "object": "ball", "patch": "west"},
            "left_fitness": {"kind": "sum", "factors": {"left_goals": 1, "right_goals": -1, "order": 0.5}},
        },
        "sides": {"left": {"fitness": "left_fitness"}, "right": {}},
        "fitness": "left_fitness",
    })
}

#[test]
fn all_begin_anew_after_a_goal() {
    let mut arena = arena(&pitch(), 2);
    let first = arena.scene().unwrap();
    let (mut goals, mut returns, mut was_on) = (0.0, 0, false);
    while !arena.done() {
        let before = arena.scene().unwrap();
        let robots = at(&before, "agent");
        let ball = at(&before, "object")[0];
        let mut ways = [[0.0; 2]; 4];
        for (way, [x, y]) in ways[..2].iter_mut().zip(&robots) {
            *way = [1.0, ((ball[1] - y) * 5.0 - 0.2 * x).clamp(-0.5, 0.5)];
        }
        ways[2] = [0.0, 1.0];
        ways[3] = [0.0, -1.0];
        drive(&mut arena, &ways);
        let scene = arena.scene().unwrap();
        let [x, _] = at(&scene, "object")[0];
        if was_on {
            assert_eq!(at(&scene, "agent"), at(&first, "agent"));
            assert_eq!(at(&scene, "object"), at(&first, "object"));
            let heading = |scene: &Scene| scene.bodies[0].heading;
            assert_eq!(heading(&scene), heading(&first));
            assert_eq!(scene.walls, first.walls, "the outlines of objects");
            returns += 1;
        }
        was_on = x.abs() >= 0.8;
        goals += f64::from(u8::from(was_on));
        assert_eq!(value(&arena, "left_goals"), goals);
    }
    assert!(returns >= 2, "{returns}");
    let expected = goals - value(&arena, "right_goals") + 0.5 * value(&arena, "order");
    assert!((value(&arena, "left_fitness") - expected).abs() < 1e-12);
    assert!((arena.fitness() - expected).abs() < 1e-12);
}

/// Robots of two sides on a narrow field, with a flag in the west that red robots bring to the east.
fn field() -> Value {
    let sensors = json!([
        {"kind": "flag"}, {"kind": "camera", "range": 5, "colors": ["red", "blue", "green"], "gives": ["count"]},
    ]);
    json!({
        "walls": {"rectangle": [3, 0.6]}, "start": {"disc": {"radius": 0.1}}, "duration": 20,
        "floor": {"patches": [
            {"name": "west", "circle": {"center": [-1, 0], "radius": 0.2}, "color": "white"},
            {"name": "east", "circle": {"center": [1, 0], "radius": 0.2}, "color": "white"},
        ]},
        "robots": [
            {"name": "red", "count": 2, "color": "red", "robot": robot(&sensors),
                "start": {"rectangle": {"x": [-0.6, -0.4], "y": [-0.2, 0.2]}}},
            {"name": "blue", "count": 1, "color": "blue", "robot": robot(&sensors),
                "start": {"rectangle": {"x": [0.3, 0.4], "y": [0.15, 0.2]}}},
        ],
        "flags": [{"name": "flag", "base": "west", "robots": "red", "home": "east", "lost_to": "blue", "reach": 0.03, "color": "green"}],
        "metrics": {
            "brought": {"kind": "flags_brought", "flag": "flag"},
            "carried": {"kind": "flags_carried", "when": "each_tick"},
        },
        "sides": {"red": {"fitness": "brought"}, "blue": {}},
        "fitness": "brought",
    })
}

/// Drives the first robot to and fro along y = `lane`; the others stand. Returns the arena at the end.
fn to_and_fro(mission: &Value, lane: f32, mut look: impl FnMut(&Arena)) -> Arena {
    let mut arena = arena(mission, 4);
    let mut goal = -1.0;
    while !arena.done() {
        let [x, y] = at(&arena.scene().unwrap(), "agent")[0];
        if (x - goal).abs() < 0.05 {
            goal = -goal;
        }
        let ahead = if (y - lane).abs() < 0.05 {
            (goal - x).signum()
        } else {
            0.0
        };
        drive(&mut arena, &[[ahead, (lane - y) * 5.0], [0.0; 2], [0.0; 2]]);
        look(&arena);
    }
    arena
}

#[test]
fn flags_are_carried_home() {
    let (mut brought, mut carried) = (0.0, 0.0);
    let mut carries = false;
    // The blue robot is in the north, and the red ones pass it in the south.
    let arena = to_and_fro(&field(), -0.18, |arena| {
        let scene = arena.scene().unwrap();
        let [x, y] = at(&scene, "agent")[0];
        let on = |middle: f32| (x - middle).hypot(y) < 0.1999;
        let off = |middle: f32| (x - middle).hypot(y) > 0.2001;
        if carries && on(1.0) {
            (carries, brought) = (false, brought + 1.0);
        } else if !carries && on(-1.0) {
            carries = true;
        } else {
            assert!(off(1.0) || off(-1.0));
        }
        carried += f64::from(u8::from(carries));
        let state = if carries {
            "red, carries a flag"
        } else {
            "red"
        };
        assert_eq!(scene.bodies[0].state, state);
        // It senses that it carries the flag, and the others see its colour.
        assert_eq!(sensed(arena, 0)[0], f32::from(u8::from(carries)));
        assert_eq!(sensed(arena, 1)[0], 0.0);
        let green = if carries { 1.0 } else { 0.0 };
        let seen = sensed(arena, 2);
        assert!(seen[1] <= 2.0 - green && seen[3] <= green, "{seen:?}");
    });
    assert!(brought >= 2.0, "{brought}");
    assert_eq!(value(&arena, "brought"), brought);
    assert_eq!(value(&arena, "carried"), carried);
    assert_eq!(arena.fitness(), brought);
}

#[test]
fn flags_are_lost_to_guards() {
    // It passes the blue robot within its reach.
    let mut mission = field();
    mission["flags"][0]["reach"] = json!(0.6);
    let mut most: f32 = -2.0;
    let lost = to_and_fro(&mission, -0.18, |arena| {
        if sensed(arena, 0)[0] > 0.0 {
            most = most.max(at(&arena.scene().unwrap(), "agent")[0][0]);
        }
    });
    assert_eq!(value(&lost, "brought"), 0.0);
    assert!(
        value(&lost, "carried") > 10.0 && (-0.8..0.2).contains(&most),
        "{most}"
    );
    // Only one carries a flag: the second robot at the base has none.
    mission["robots"][0]["start"] = json!({"disc": {"center": [-1, 0], "radius": 0.15}});
    let arena = self::arena(&mission, 1);
    let carry: Vec<f32> = (0..2).map(|agent| sensed(&arena, agent)[0]).collect();
    assert_eq!(carry, [1.0, 0.0]);
    // Who is caught carries nothing.
    mission["captures"] = json!([{"robots": "red", "by": "blue", "reach": 3}]);
    let arena = self::arena(&mission, 1);
    assert_eq!(sensed(&arena, 0)[0], 0.0);
}

#[test]
fn the_floor_belongs_to_who_was_there_last() {
    let mut mission = hunt();
    mission["walls"] = json!({"rectangle": [4, 0.2]});
    for (kind, x) in [(0, -1.5), (1, 1.5)] {
        mission["robots"][kind]["start"] =
            json!({"rectangle": {"x": [x - 0.1, x + 0.1], "y": [-0.01, 0.01]}});
        mission["robots"][kind]["count"] = json!(1);
    }
    mission["captures"] = json!([]);
    mission["metrics"] = json!({
        "west": {"kind": "painted_share", "robots": "hunters", "cell": 0.2, "when": "end"},
        "east": {"kind": "painted_share", "robots": "hares", "cell": 0.2, "when": "end"},
        "mean": {"kind": "painted_share", "robots": "hunters", "cell": 0.2},
    });
    mission["sides"] = json!({"hunters": {"fitness": "west"}, "hares": {}});
    mission["fitness"] = json!("west");
    mission["duration"] = json!(8);
    let mut arena = arena(&mission, 2);
    // Squares by their number from the west: who was there last.
    let mut owners = [0; 20];
    let (mut sum, mut ticks) = (0.0, 0.0);
    loop {
        let robots = at(&arena.scene().unwrap(), "agent");
        let squares = [0, 1].map(|robot| ((robots[robot][0] + 2.0) / 0.2) as usize);
        if squares[0] != squares[1] {
            owners[squares[0]] = 1;
            owners[squares[1]] = 2;
        }
        let count = |kind: i32| owners.iter().filter(|owner| **owner == kind).count() as f64 / 20.0;
        assert_eq!(
            [value(&arena, "west"), value(&arena, "east")],
            [count(1), count(2)]
        );
        ticks += 1.0;
        sum += count(1);
        if arena.done() {
            break;
        }
        // The hunter drives east, then the hare drives west over what the hunter has painted.
        let first = if ticks < 30.0 { 1.0 } else { -0.1 };
        let second = if ticks < 30.0 { 0.0 } else { -1.0 };
        drive(&mut arena, &[[first, 0.0], [second, 0.0]]);
    }
    assert!((value(&arena, "mean") - sum / ticks).abs() < 1e-12);
    assert!(value(&arena, "east") > 0.3 && value(&arena, "west") > 0.1);
}

#[test]
fn lanes_give_the_same_bits() {
    for mission in ["pursuit", "soccer", "capture_the_flag", "territory"] {
        check_team(&json!({"mission": mission, "duration": 12}));
    }
    let mut goals = field();
    // Both patches are large and overlap, so that robots that wander about bring flags.
    goals["flags"][0]["home"] = json!("west");
    goals["flags"][0]["base"] = json!("east");
    goals["floor"]["patches"][0]["circle"]["radius"] = json!(0.9);
    goals["floor"]["patches"][1]["circle"]["radius"] = json!(1.2);
    goals["robots"][1]["count"] = json!(3);
    goals["robots"][1]["start"] = json!({"rectangle": {"x": [0.2, 0.5], "y": [-0.2, 0.2]}});
    goals["restart"] = json!({"object": "ball", "on": ["west"]});
    goals["objects"] = json!([{"name": "ball", "radius": 0.04, "mass": 0.05, "center": [0, 0.2]}]);
    goals["failures"] = json!([{"kind": "slow", "share": 0.5, "factor": 0.3}]);
    let numbers = check(&json!({"mission": goals}));
    let episodes = numbers.chunks(numbers.len() / 27);
    assert!(
        episodes.clone().any(|episode| episode[1] > 0.0),
        "flags brought"
    );
    assert!(
        episodes.clone().any(|episode| episode[2] > 0.0),
        "flags carried"
    );
    let numbers = check(&json!({"mission": pitch()}));
    // The fitness and ten metrics of each episode: some have goals.
    let goals = numbers
        .chunks(numbers.len() / 27)
        .map(|episode| episode[2] + episode[3]);
    assert!(goals.clone().sum::<f64>() > 5.0 && goals.clone().any(|goals| goals < 1.0));
    let mut mission = hunt();
    mission["captures"][0]["reach"] = json!(0.4);
    mission["failures"] =
        json!([{"kind": "mute", "share": 0.5}, {"kind": "slow", "share": 0.5, "factor": 0.3}]);
    mission["robots"][0]["robot"]["battery"] = json!({"standing": 9, "driving": 3});
    let numbers = check(&json!({"mission": mission, "duration": 10}));
    let caught = numbers.chunks(numbers.len() / 27).map(|episode| episode[2]);
    assert!(caught.clone().any(|caught| caught > 0.0) && caught.clone().any(|caught| caught < 2.0));
}

/// A controller does as well on one side as on the other.
#[test]
fn soccer_is_the_same_from_both_sides() {
    let mission = json!({"mission": "soccer", "duration": 10});
    let groups = arena(&json!("soccer"), 1).groups();
    assert_eq!(groups[0].agents, groups[1].agents);
    assert_eq!(
        groups[0].own_sensor_names.len(),
        groups[1].own_sensor_names.len()
    );
    let numbers = check(&mission);
    assert_eq!(numbers.len() % 27, 0);
    // Where both stand, the left and the right robots see the same on average.
    let mut sums = [[0.0_f64; 2]; 2];
    for seed in 0..200 {
        let arena = arena(&json!("soccer"), seed);
        let scene = arena.scene().unwrap();
        let robots: Vec<_> = scene
            .bodies
            .iter()
            .filter(|body| body.kind == "agent")
            .collect();
        for (agent, robot) in robots.iter().enumerate() {
            let seen = sensed(&arena, agent as u32);
            let (sin, cos) = robot.heading.unwrap().sin_cos();
            // The direction of the ball and of the other goal, along the axes of the arena.
            for (sum, first) in sums[agent / 3].iter_mut().zip([8, 12]) {
                *sum += f64::from(seen[first] * cos - seen[first + 1] * sin);
            }
        }
    }
    for (left, right) in sums[0].iter().zip(sums[1]) {
        let [left, right] = [left / 600.0, right / 600.0];
        assert!(left > 0.5 && right < -0.5, "{left} {right}");
        assert!((left + right).abs() < 0.08, "{left} {right}");
    }
}

#[test]
fn mistakes_name_the_place() {
    let with = |path: &[&str], value: Value| {
        let mut mission = hunt();
        mission["objects"] = json!([{"name": "ball", "radius": 0.1, "mass": 1, "center": [0, 0]}]);
        let mut target = &mut mission;
        for key in path {
            target = match key.parse::<usize>() {
                Ok(index) => &mut target[index],
                Err(_) => &mut target[*key],
            };
        }
        *target = value;
        refusal(&mission)
    };
    let many = vec![json!({"robots": "hares", "by": "hunters", "reach": 0.1}); 17];
    for (refused, expected) in [
        (
            with(&["captures", "0", "by"], json!("hares")),
            "mission.captures[0].by: a kind of robots does not catch itself; name two kinds",
        ),
        (
            with(&["captures", "0", "by"], json!("foxes")),
            "mission.captures[0].by: no kind of robots is named \"foxes\"; available: hunters, hares",
        ),
        (
            with(&["captures", "0", "reach"], json!(-1)),
            "mission.captures[0].reach: -1 found, expected 0 to 1000",
        ),
        (
            with(&["captures"], json!(many)),
            "mission.captures: 17 captures found, at most 16 are possible",
        ),
        (
            with(&["captures"], json!([])),
            "mission.metrics.anybody: the mission has no captures, so nobody is caught",
        ),
        (
            with(&["metrics", "caught", "robots"], json!("foxes")),
            "mission.metrics.caught.robots: no kind of robots is named \"foxes\"",
        ),
        (
            with(&["restart"], json!({"object": "bal", "on": ["east"]})),
            "mission.restart.object: no object is named \"bal\"; available: ball",
        ),
        (
            with(&["restart"], json!({"object": "ball", "on": []})),
            "mission.restart.on: an empty list found, expected at least one patch",
        ),
        (
            with(&["restart"], json!({"object": "ball", "on": ["east"]})),
            "mission.restart.on[0]: no patch of the floor is named \"east\"; available: none",
        ),
        (
            with(
                &["metrics", "hares_fitness", "factors"],
                json!({"caugt": 1}),
            ),
            "mission.metrics.hares_fitness: no metric is named \"caugt\"; available: anybody,",
        ),
        (
            with(
                &["metrics", "hares_fitness", "factors"],
                json!({"hares_fitness": 1}),
            ),
            "mission.metrics.hares_fitness: hares_fitness is a sum itself; name the metrics that it adds up",
        ),
        (
            with(&["metrics", "caught"], json!({"kind": "flags_carried"})),
            "mission.metrics.caught: the mission has no flags",
        ),
        (
            with(
                &["metrics", "caught"],
                json!({"kind": "painted_share", "robots": "foxes", "cell": 0.1}),
            ),
            "mission.metrics.caught.robots: no kind of robots is named \"foxes\"",
        ),
        (
            with(
                &["metrics", "caught"],
                json!({"kind": "painted_share", "robots": "hares", "cell": 0}),
            ),
            "mission.metrics.caught.cell: 0 found, expected a number above 0",
        ),
        (
            with(&["sides"], json!({"hares": {}})),
            "mission.sides: 1 found, expected at least two sides",
        ),
        (
            with(&["sides", "hares", "fitness"], json!("speeed")),
            "mission.sides.hares.fitness: no metric is named \"speeed\"; available: anybody,",
        ),
        (
            with(&["sides", "hares", "robots"], json!(["hares", "hares"])),
            "mission.sides.hares.robots: \"hares\" is already of the side \"hares\"",
        ),
        (
            with(&["sides", "hares", "robots"], json!(["hunters"])),
            "mission.sides.hunters.robots: \"hunters\" is already of the side \"hares\"",
        ),
        (
            with(&["sides", "foxes"], json!({})),
            "mission.sides.foxes: no kind of robots is named \"foxes\"; available: hunters, hares",
        ),
        (
            with(
                &["robots", "1", "start"],
                json!({"disc": {"center": [9, 0], "radius": 1}}),
            ),
            "mission.robots[1].start: lies outside the walls",
        ),
        (
            with(
                &["robots", "1", "robot", "actuators"],
                json!([{"kind": "led", "colors": ["red"]}]),
            ),
            "mission.robots[1].color: robots with LEDs show their colours; leave the field out",
        ),
        (
            with(&["robots", "1", "color"], json!("pink")),
            "mission.robots[1]",
        ),
    ] {
        assert!(refused.contains(expected), "{refused}\n{expected}");
    }
}

#[test]
fn mistakes_of_flags_name_the_place() {
    let with = |field: &str, value: Value| {
        let mut mission = self::field();
        mission["flags"][0][field] = value;
        refusal(&mission)
    };
    let mut twice = field();
    let flag = twice["flags"][0].clone();
    twice["flags"].as_array_mut().unwrap().push(flag);
    let mut other = field();
    other["metrics"]["brought"]["flag"] = json!("flagg");
    for (refused, expected) in [
        (
            with("base", json!("weast")),
            "mission.flags[0].base: no patch of the floor is named \"weast\"; available: west, east",
        ),
        (
            with("home", json!("west")),
            "mission.flags[0].home: base and home must be different patches",
        ),
        (
            with("lost_to", json!("red")),
            "mission.flags[0].lost_to: a kind of robots does not take flags from itself; name two kinds",
        ),
        (
            with("lost_to", json!("green")),
            "mission.flags[0].lost_to: no kind of robots is named \"green\"; available: red, blue",
        ),
        (
            with("reach", json!(2000)),
            "mission.flags[0].reach: 2000 found, expected 0 to 1000",
        ),
        (
            refusal(&twice),
            "mission.flags[1].name: another flag is already named \"flag\"; choose another name",
        ),
        (
            refusal(&other),
            "mission.metrics.brought.flag: no flag is named \"flagg\"; available: flag",
        ),
    ] {
        assert!(refused.contains(expected), "{refused}\n{expected}");
    }
}
