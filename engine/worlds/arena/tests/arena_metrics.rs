//! Metrics of the arena, against what follows from the positions that are shown.
#![allow(clippy::unwrap_used)] // helpers of tests

use serde_json::{Value, json};
use swarmwright_kernels::Arena;
use swarmwright_simulation::Simulation;

/// An arena at the end of a short episode in which all drive ahead.
fn driven(metrics: &Value, robots: u32, seed: u64) -> Arena {
    lasting(2.0, metrics, robots, seed)
}

/// The same of another duration, in seconds.
fn lasting(duration: f64, metrics: &Value, robots: u32, seed: u64) -> Arena {
    let mission = json!({
        "walls": {"rectangle": [4, 3]},
        "floor": {"patches": [
            {"name": "west", "circle": {"center": [-0.6, 0], "radius": 0.1}, "color": "black"},
            {"name": "east", "circle": {"center": [0.6, 0], "radius": 0.1}, "color": "white"},
            {"name": "all", "rectangle": {"x": [-2, 2], "y": [-1.5, 1.5]}, "color": "grey"},
        ]},
        "start": {"rectangle": {"x": [-0.8, 0.8], "y": [-0.6, 0.6]}},
        "metrics": metrics,
        "fitness": {"factors": {}},
    });
    let parameters =
        json!({"mission": mission, "robots": robots, "duration": duration, "seed": seed});
    let mut arena = Arena::default();
    arena.reset(parameters.as_object().unwrap()).unwrap();
    while !arena.done() {
        let actuators = [1.0, 1.0].repeat(arena.acting().len());
        arena.step(&actuators);
    }
    arena
}

/// The value of a metric by its name.
fn value(arena: &Arena, name: &str) -> f64 {
    let index = arena.description().metrics_named(&[name]).unwrap()[0];
    arena.metrics()[index]
}

/// Where robots are in the coordinates of the mission.
fn positions(arena: &Arena) -> Vec<[f64; 2]> {
    let scene = arena.scene().unwrap();
    let agents = scene.bodies.iter().filter(|body| body.kind == "agent");
    let [left, bottom] = scene.origin;
    agents
        .map(|body| [f64::from(body.x + left), f64::from(body.y + bottom)])
        .collect()
}

fn distance(a: [f64; 2], b: [f64; 2]) -> f64 {
    (a[0] - b[0]).hypot(a[1] - b[1])
}

fn mean(values: impl ExactSizeIterator<Item = f64>) -> f64 {
    let count = values.len() as f64;
    values.sum::<f64>() / count
}

#[track_caller]
fn close(a: f64, b: f64, within: f64) {
    assert!((a - b).abs() <= within, "{a}, {b}");
}

/// Groups by repeated joining, as sets of indices.
fn groups(at: &[[f64; 2]], link: f64) -> Vec<usize> {
    let mut group: Vec<usize> = (0..at.len()).collect();
    for _ in 0..at.len() {
        for i in 0..at.len() {
            for j in 0..at.len() {
                if distance(at[i], at[j]) < link {
                    let least = group[i].min(group[j]);
                    (group[i], group[j]) = (least, least);
                }
            }
        }
    }
    group
}

#[test]
fn general_metrics_follow_from_positions() {
    let metrics = json!({
        "group": {"kind": "largest_group", "link": 0.2, "when": "end"},
        "groups": {"kind": "groups", "link": 0.2, "when": "end"},
        "covered": {"kind": "covered_share", "radius": 0.3, "when": "end"},
        "chain": {"kind": "chain_reach", "from": "west", "to": "east", "link": 0.25, "when": "end"},
        "points": {"kind": "shape_deviation", "shape": {"points": [[0.5, 0.5], [-1, 0]], "fixed": true}, "when": "end"},
        "line": {"kind": "shape_deviation", "shape": {"line": [[-1, 0], [1, 0]]}, "when": "end"},
    });
    for seed in 0..30 {
        let count = 2 + seed as u32 % 17;
        let arena = driven(&metrics, count, seed);
        let at = positions(&arena);
        let center = [mean(at.iter().map(|p| p[0])), mean(at.iter().map(|p| p[1]))];
        close(
            value(&arena, "distance_to_center"),
            mean(at.iter().map(|p| distance(*p, center))),
            1e-6,
        );
        let nearest = |index: usize| {
            let others = (0..at.len()).filter(|other| *other != index);
            others
                .map(|other| distance(at[index], at[other]))
                .fold(f64::INFINITY, f64::min)
        };
        close(
            value(&arena, "nearest_distance"),
            mean((0..at.len()).map(nearest)),
            1e-6,
        );
        for (link, largest) in [(0.2, "group"), (0.35, "largest_group")] {
            let groups = groups(&at, link);
            let size = |group: &usize| groups.iter().filter(|other| *other == group).count();
            let most = groups.iter().map(size).max().unwrap();
            close(value(&arena, largest), most as f64, 0.0);
        }
        let mut distinct = groups(&at, 0.2);
        distinct.sort_unstable();
        distinct.dedup();
        close(value(&arena, "groups"), distinct.len() as f64, 0.0);
        let targets = [[0.5, 0.5], [-1.0, 0.0]];
        let near = |from: [f64; 2], to: &[[f64; 2]]| {
            to.iter()
                .map(|to| distance(from, *to))
                .fold(f64::INFINITY, f64::min)
        };
        let there = mean(targets.iter().map(|target| near(*target, &at)));
        let back = mean(at.iter().map(|robot| near(*robot, &targets)));
        close(value(&arena, "points"), (there + back) / 2.0, 1e-6);
        // From the line, moved to the center, no robot is further than from its middle.
        let spread = mean(at.iter().map(|robot| distance(*robot, center)));
        assert!(value(&arena, "line") <= (spread + 1.0) / 2.0);
        // The chain: robots that are linked to the west, and how near they come to the east.
        let mut nodes = vec![[-0.6, 0.0]];
        nodes.extend(&at);
        let groups = groups(&nodes, 0.25);
        let rest = nodes
            .iter()
            .zip(&groups)
            .filter(|(_, group)| **group == groups[0]);
        let rest = rest
            .map(|(node, _)| distance(*node, [0.6, 0.0]))
            .fold(f64::INFINITY, f64::min);
        close(
            value(&arena, "chain"),
            (1.0 - (rest - 0.25) / (1.2 - 0.25)).clamp(0.0, 1.0),
            1e-6,
        );
        let steps = 400;
        let seen = (0..steps * steps * 3 / 4).filter(|cell| {
            let at_axis = |step: i32| (f64::from(step) + 0.5) / f64::from(steps) * 4.0;
            let point = [at_axis(cell % steps) - 2.0, at_axis(cell / steps) - 1.5];
            at.iter().any(|robot| distance(*robot, point) <= 0.3)
        });
        let share = seen.count() as f64 / f64::from(steps * steps * 3 / 4);
        close(value(&arena, "covered"), share, 0.01);
    }
}

#[test]
fn distances_are_limited_one_by_one() {
    let metrics = json!({
        "far": {"kind": "mean_distance", "radius": 1.4, "most": 5},
        "near": {"kind": "mean_distance", "radius": 1.4, "most": 0.3},
        "none": {"kind": "mean_distance", "radius": 1.4, "most": 0.3, "outside": ["all"]},
    });
    let arena = driven(&metrics, 3, 1);
    let robots = positions(&arena);
    let steps = 64;
    let [mut far, mut near] = [0.0; 2];
    for ring in 0..steps {
        for place in 0..steps {
            let radius = 1.4 * (f64::from(ring) + 0.5) / f64::from(steps);
            let angle = 2.0 * std::f64::consts::PI * (f64::from(place) + 0.5) / f64::from(steps);
            let point = [radius * angle.cos(), radius * angle.sin()];
            let least = robots
                .iter()
                .map(|robot| distance(point, *robot))
                .fold(5.0, f64::min);
            far += least / f64::from(steps * steps);
            near += least.min(0.3) / f64::from(steps * steps);
        }
    }
    assert!(far > 0.3, "most points are further away from all robots");
    close(value(&arena, "far"), far, 1e-4);
    close(value(&arena, "near"), near, 1e-4);
    close(value(&arena, "none"), 0.3, 1e-6);
}

#[test]
fn the_area_of_the_largest_group_is_that_of_its_robots() {
    let metrics = json!({
        "area": {"kind": "largest_group_area", "link": 0.13, "disc": 0.1, "within": 1},
        "group": {"kind": "largest_group", "link": 0.13, "when": "end"},
    });
    for (robots, seeds) in [(12, 10), (80, 2)] {
        for seed in 0..seeds {
            let arena = driven(&metrics, robots, seed);
            let at = positions(&arena);
            let group = groups(&at, 0.13);
            let members = |of: &usize| group.iter().filter(|other| *other == of).count();
            // The first one on ties.
            let first = (0..at.len()).rev().max_by_key(members).unwrap();
            let largest: Vec<[f64; 2]> = (0..at.len())
                .filter(|index| group[*index] == first)
                .map(|index| at[index])
                .collect();
            assert_eq!(value(&arena, "group"), largest.len() as f64);
            let middle = |cell: i32| (f64::from(cell) + 0.5) * 0.02 - 1.0;
            let covered = (0..100)
                .flat_map(|row| (0..100).map(move |column| [middle(row), middle(column)]))
                .filter(|point| {
                    let near = |robot: &[f64; 2]| distance(*point, *robot) <= 0.1;
                    distance(*point, [0.0; 2]) < 1.0 && largest.iter().any(near)
                });
            let area = covered.count() as f64 * 0.02 * 0.02;
            close(value(&arena, "area"), area, 0.002);
        }
    }
}

#[test]
fn metrics_so_far_are_those_of_an_episode_that_ends_now() {
    let metrics = json!({
        "order": {"kind": "order", "when": "end"},
        "speed": {"kind": "speed", "when": "end"},
        "mean_speed": {"kind": "speed", "when": "mean"},
        "covered": {"kind": "covered_share", "radius": 0.1, "when": "end"},
        "east": {"kind": "robots_on", "patch": "east", "when": "end", "share": true},
        "ticks_east": {"kind": "robots_on", "patch": "east"},
        "most": {"kind": "most_robots_on", "patches": ["east", "west"], "when": "end"},
        "boxes": {"kind": "objects_on", "patch": "north", "when": "end"},
        "away": {"kind": "object_distance", "patch": "east", "when": "end"},
        "until": {"kind": "time_until", "patch": "east", "at_least": 0.5},
        "crossings": {"kind": "crossings_south", "patch": "north"},
        "area": {"kind": "largest_group_area", "link": 0.35, "disc": 0.1, "within": 1},
        "distance": {"kind": "mean_distance", "radius": 1, "most": 2, "outside": ["east"]},
        "inside": {"kind": "mean_distance_inside", "patch": "north", "most": 2},
        "rim": {"kind": "mean_distance_rim", "patch": "east", "near": 0.2, "most": 1},
    });
    let begin = |duration: f64| {
        let mission = json!({
            "walls": {"rectangle": [4, 3]},
            "floor": {"patches": [
                {"name": "west", "circle": {"center": [-0.6, 0], "radius": 0.3}, "color": "black"},
                {"name": "east", "circle": {"center": [0.6, 0], "radius": 0.3}, "color": "white"},
                {"name": "north", "rectangle": {"x": [-1, 1], "y": [0, 1]}, "color": 0.5},
            ]},
            "objects": [{"name": "box", "mass": 0.2, "radius": 0.05, "center": [0.1, 0.1]}],
            "start": {"rectangle": {"x": [-0.8, 0.8], "y": [-0.6, 0.6]}},
            "metrics": metrics,
            "fitness": {"offset": 1.9, "factors": {"distance": -1, "rim": -1, "order": 10, "mean_speed": 2}},
        });
        let parameters = json!({"mission": mission, "robots": 12, "duration": duration, "seed": 4});
        let mut arena = Arena::default();
        arena.reset(parameters.as_object().unwrap()).unwrap();
        arena
    };
    let step = |arena: &mut Arena| arena.step(&[1.0, 0.9].repeat(arena.acting().len()));
    let found = |arena: &Arena| -> Vec<u64> {
        let fitness = [arena.fitness()];
        let numbers = fitness.into_iter().chain(arena.metrics());
        numbers.map(f64::to_bits).collect()
    };
    let (mut watched, mut never_asked) = (begin(2.0), begin(2.0));
    let mut different = 0;
    for tick in 1..=20 {
        let mut short = begin(f64::from(tick) / 10.0);
        while !short.done() {
            step(&mut short);
        }
        assert_eq!(found(&watched), found(&short), "tick {tick}");
        different += usize::from(tick < 20 && watched.fitness() < 10.0);
        step(&mut watched);
        step(&mut never_asked);
    }
    assert!(different > 10, "the order counts before the end, too");
    assert!(watched.done());
    assert_eq!(found(&watched), found(&never_asked));
}

#[test]
fn order_and_speeds_belong_together() {
    for seed in 0..20 {
        let arena = driven(&json!({}), 3, seed);
        // All drive at 0.12 m/s, each with 5 % noise on both wheels, but for those that touch.
        let (order, speed) = (value(&arena, "order"), value(&arena, "speed"));
        assert!((0.0..=1.0).contains(&order), "{order}");
        assert!((0.06..0.14).contains(&speed), "{speed}");
        close(value(&arena, "group_speed"), order * speed, 0.04);
    }
    let alone = driven(&json!({}), 1, 3);
    close(value(&alone, "order"), 1.0, 1e-6);
    assert_eq!(value(&alone, "nearest_distance"), 0.0);
    assert_eq!(value(&alone, "distance_to_center"), 0.0);
    assert_eq!(value(&alone, "largest_group"), 1.0);
    close(value(&alone, "group_speed"), value(&alone, "speed"), 1e-9);
}

#[test]
fn sums_and_means_belong_together() {
    let kinds = ["order", "speed", "nearest_distance", "distance_to_center"];
    let mut metrics = json!({});
    for kind in kinds {
        for when in ["each_tick", "mean", "end"] {
            metrics[format!("{kind}_{when}")] = json!({"kind": kind, "when": when});
        }
    }
    metrics["on"] = json!({"kind": "robots_on", "patch": "west"});
    metrics["on_mean"] = json!({"kind": "robots_on", "patch": "west", "when": "mean"});
    let arena = driven(&metrics, 12, 5);
    for kind in kinds {
        let of = |when: &str| value(&arena, &format!("{kind}_{when}"));
        close(of("each_tick") / 20.0, of("mean"), 1e-12);
        assert_eq!(of("end"), value(&arena, kind));
    }
    close(value(&arena, "on") / 20.0, value(&arena, "on_mean"), 1e-12);
}

#[test]
fn values_at_a_time_are_those_of_an_episode_that_ends_then() {
    let mut metrics = json!({"west": {"kind": "robots_on", "patch": "west", "when": {"at": 0.7}}});
    let kinds = ["order", "distance_to_center", "nearest_distance"];
    for kind in kinds {
        for at in [0.0, 0.7, 2.0] {
            metrics[format!("{kind}_{at}").replace('.', "_")] =
                json!({"kind": kind, "when": {"at": at}});
        }
    }
    let arena = driven(&metrics, 12, 5);
    let short = lasting(
        0.7,
        &json!({"west": {"kind": "robots_on", "patch": "west", "when": "end"}}),
        12,
        5,
    );
    for kind in kinds {
        assert_eq!(value(&arena, &format!("{kind}_0_7")), value(&short, kind));
        assert_eq!(value(&arena, &format!("{kind}_2")), value(&arena, kind));
        assert_ne!(value(&arena, &format!("{kind}_0")), value(&arena, kind));
    }
    assert_eq!(value(&arena, "west"), value(&short, "west"));
}

#[test]
fn squares_that_were_visited_stay_visited() {
    let metrics = json!({"fine": {"kind": "visited_share", "cell": 0.05}, "coarse": {"kind": "visited_share", "cell": 1}});
    for seed in 0..10 {
        let arena = driven(&metrics, 1, seed);
        // 2 s at 0.12 m/s are 0.23 m: 5 to 9 of 80 x 60 squares.
        let squares = value(&arena, "fine") * 4800.0;
        assert!((4.9..=10.1).contains(&squares), "{squares}");
        assert_eq!(squares, squares.round());
        let coarse = value(&arena, "coarse") * 12.0;
        assert!((0.9..=3.1).contains(&coarse), "{coarse}");
    }
}

#[test]
fn formations_are_found_where_they_are() {
    // Robots stand still: the deviation from the places where they stand is 0.
    let still = |metrics: &Value| {
        let mission = json!({"walls": {"rectangle": [4, 4]}, "start": {"disc": {"radius": 1}},
            "metrics": metrics, "fitness": {"factors": {}}});
        let parameters = json!({"mission": mission, "robots": 7, "duration": 0.1, "seed": 11});
        let mut arena = Arena::default();
        arena.reset(parameters.as_object().unwrap()).unwrap();
        arena
    };
    let at = positions(&still(&json!({})));
    let moved: Vec<_> = at.iter().map(|[x, y]| [x + 0.3, y - 0.2]).collect();
    let turned: Vec<_> = at.iter().map(|[x, y]| [0.5 - y, *x]).collect();
    let kind = |points: &Value, fixed: bool, turned: bool| {
        json!({"kind": "shape_deviation", "when": "end",
            "shape": {"points": points, "fixed": fixed, "turned": turned}})
    };
    let arena = still(&json!({
        "fixed": kind(&json!(at), true, false),
        "moved": kind(&json!(moved), false, false),
        "away": kind(&json!(moved), true, false),
        "turned": kind(&json!(turned), false, true),
        "askew": kind(&json!(turned), false, false),
    }));
    close(value(&arena, "fixed"), 0.0, 1e-6);
    close(value(&arena, "moved"), 0.0, 1e-6);
    close(value(&arena, "turned"), 0.0, 1e-6);
    assert!(value(&arena, "away") > 0.1 && value(&arena, "askew") > 0.1);
    // Turned by any angle, it is as near.
    for degrees in [1.0_f64, 4.9, 5.0, 87.3, 185.0] {
        let (sin, cos) = degrees.to_radians().sin_cos();
        let rotated: Vec<_> = at
            .iter()
            .map(|[x, y]| [cos * x - sin * y, sin * x + cos * y])
            .collect();
        let arena = still(&json!({"rotated": kind(&json!(rotated), false, true)}));
        close(value(&arena, "rotated"), 0.0, 1e-3);
    }
}

/// Points so near to each other along lines from corner to corner that distances to them are those to the lines.
fn dense(corners: &[[f64; 2]]) -> Vec<[f64; 2]> {
    let total: f64 = corners
        .windows(2)
        .map(|ends| distance(ends[0], ends[1]))
        .sum();
    let points = corners.windows(2).flat_map(|ends| {
        let count = (20_000.0 * distance(ends[0], ends[1]) / total) as u32;
        (0..count).map(move |point| {
            let part = (f64::from(point) + 0.5) / f64::from(count);
            [0, 1].map(|axis| ends[0][axis] + (ends[1][axis] - ends[0][axis]) * part)
        })
    });
    points.collect()
}

#[test]
fn deviation_from_outlines_is_that_of_all_their_points() {
    let (square, triangle) = (
        [[-1.0, -0.6], [1.0, -0.6], [1.0, 0.8], [-1.0, 0.8]],
        [[0.0, 0.0], [2.0, 0.0], [0.0, 1.0]],
    );
    let circle = (0..=360_u32).map(|degrees| {
        let (sin, cos) = f64::from(degrees).to_radians().sin_cos();
        [0.7 * cos, 0.7 * sin]
    });
    let circle = dense(&circle.collect::<Vec<_>>());
    let closed = |corners: &[[f64; 2]]| dense(&[corners, &corners[..1]].concat());
    let kind = |shape: Value| json!({"kind": "shape_deviation", "shape": shape, "when": "end"});
    let of = |walls: [f64; 2], start: Value, robots: u32, shapes: &Value| {
        let mission = json!({"walls": {"rectangle": walls}, "start": {"rectangle": start}, "metrics": shapes,
            "fitness": {"factors": {}}});
        let parameters =
            json!({"mission": mission, "robots": robots, "duration": 0.1, "seed": robots});
        let mut arena = Arena::default();
        arena.reset(parameters.as_object().unwrap()).unwrap();
        arena
    };
    let expected = |at: &[[f64; 2]], points: &[[f64; 2]]| {
        let near = |from: &[f64; 2], to: &[[f64; 2]]| {
            let distances = to.iter().map(|to| distance(*from, *to));
            distances.fold(f64::INFINITY, f64::min)
        };
        let there = mean(points.iter().map(|point| near(point, at)));
        (there + mean(at.iter().map(|robot| near(robot, points)))) / 2.0
    };
    for robots in [1, 5, 40, 100] {
        let arena = of(
            [4.0, 4.0],
            json!({"x": [-1.5, 1.5], "y": [-1.5, 1.5]}),
            robots,
            &json!({
                "circle": kind(json!({"circle": 0.7})),
                "square": kind(json!({"polygon": square, "fixed": true})),
                "triangle": kind(json!({"polygon": triangle})),
                "point": kind(json!({"line": [[1, 1], [1, 1]], "fixed": true})),
            }),
        );
        let at = positions(&arena);
        let middle = [0, 1].map(|axis| mean(at.iter().map(|robot| robot[axis])));
        let moved = |points: &[[f64; 2]]| {
            let own = [0, 1].map(|axis| mean(points.iter().map(|point| point[axis])));
            let moved = points
                .iter()
                .map(|point| [0, 1].map(|axis| point[axis] - own[axis] + middle[axis]));
            expected(&at, &moved.collect::<Vec<_>>())
        };
        close(value(&arena, "circle"), moved(&circle), 2e-3);
        close(
            value(&arena, "square"),
            expected(&at, &closed(&square)),
            2e-3,
        );
        close(value(&arena, "triangle"), moved(&closed(&triangle)), 2e-3);
        close(value(&arena, "point"), expected(&at, &[[1.0, 1.0]]), 1e-6);
    }
    // A long line on which robots stand: their distance from it is none, and not that from the nearest of some points.
    let line = [[-20.0, 0.0], [20.0, 0.0]];
    let arena = of(
        [42.0, 1.0],
        json!({"x": [-20, 20], "y": [0, 0.0001]}),
        300,
        &json!({"line": kind(json!({"line": line, "fixed": true}))}),
    );
    let expected = expected(&positions(&arena), &dense(&line));
    close(value(&arena, "line"), expected, 0.02 * expected);
}

#[test]
fn order_is_at_most_1() {
    let robot = json!({"radius": 0.035, "drive": {"kind": "holonomic", "max_speed": 0.1, "max_turn": 90},
        "sensors": [{"kind": "compass"}]});
    let mission = json!({"walls": {"rectangle": [4, 4]}, "start": {"disc": {"radius": 1}}, "fitness": "order"});
    for seed in 0..200 {
        let parameters =
            json!({"mission": mission, "robot": robot, "robots": 1, "duration": 1, "seed": seed});
        let mut arena = Arena::default();
        arena.reset(parameters.as_object().unwrap()).unwrap();
        assert!(value(&arena, "order") <= 1.0, "{seed}");
    }
}

#[test]
fn time_until_robots_are_on_a_patch() {
    let until =
        |bound: &str, share: f64| json!({"kind": "time_until", "patch": "west", bound: share});
    let metrics = json!({
        "all": until("at_least", 1.0), "most": until("at_least", 0.7), "none": until("at_most", 0.0),
        "always": until("at_most", 1.0), "few": until("at_most", 0.3),
    });
    for seed in 0..40 {
        // All drive ahead: to the circle, or out of it. Wide enough that some do either.
        let mission = json!({
            "walls": {"rectangle": [2, 2]},
            "floor": {"patches": [{"name": "west", "circle": {"center": [-0.1, 0], "radius": 0.3}, "color": "black"}]},
            "start": {"disc": {"center": [-0.1, 0], "radius": 0.35}}, "metrics": metrics, "fitness": "all",
        });
        let parameters = json!({"mission": mission, "robots": 10, "duration": 6, "seed": seed});
        let mut arena = Arena::default();
        arena.reset(parameters.as_object().unwrap()).unwrap();
        let on = |arena: &Arena| {
            let scene = arena.scene().unwrap();
            let middle = [scene.width / 2.0 - 0.1, scene.height / 2.0];
            let agents = scene.bodies.iter().filter(|body| body.kind == "agent");
            agents
                .filter(|body| (body.x - middle[0]).hypot(body.y - middle[1]) <= 0.3)
                .count()
        };
        let mut counts = vec![on(&arena)];
        while !arena.done() {
            arena.step(&[1.0, 1.0].repeat(arena.acting().len()));
            counts.push(on(&arena));
        }
        assert_eq!(counts.len(), 60);
        for (name, least, most) in [
            ("all", 10, 10),
            ("most", 7, 10),
            ("none", 0, 0),
            ("few", 0, 3),
            ("always", 0, 10),
        ] {
            let first = counts
                .iter()
                .position(|count| (least..=most).contains(count));
            close(value(&arena, name), first.unwrap_or(60) as f64 / 10.0, 0.0);
        }
    }
}

/// The values of two metrics for `spot`, a patch beside the origin, and positions tick by tick.
fn beside(color: &str, metric: &str) -> (f64, Vec<Vec<[f64; 2]>>) {
    let mission = json!({
        "walls": {"rectangle": [4, 3]},
        "floor": {"patches": [
            {"name": "spot", "circle": {"center": [0.6, 0.35], "radius": 0.2}, "color": color},
        ]},
        "start": {"rectangle": {"x": [-0.4, 0.35], "y": [-0.4, 0.9]}},
        "metrics": {"counted": {"kind": metric, "patch": "spot"}},
        "fitness": "counted",
    });
    let parameters = json!({"mission": mission, "robots": 12, "duration": 12, "seed": 3});
    let mut arena = Arena::default();
    arena.reset(parameters.as_object().unwrap()).unwrap();
    let mut ticks = vec![positions(&arena)];
    while !arena.done() {
        // Some drive in circles of several sizes, some ahead; one stands.
        let wheels = (0..12).flat_map(|robot| match robot {
            0 => [0.0, 0.0],
            1..6 => [1.0, 1.0],
            _ => [1.0, robot as f32 / 12.0],
        });
        arena.step(&wheels.collect::<Vec<f32>>());
        ticks.push(positions(&arena));
    }
    (value(&arena, "counted"), ticks)
}

#[test]
fn the_wrong_half_is_on_the_other_side_of_the_patch() {
    for (color, side) in [("black", -1.0), ("white", 1.0)] {
        let (counted, ticks) = beside(color, "robots_in_wrong_half");
        let wrong = |at: &[f64; 2]| (at[1] - 0.35) * side > 0.0;
        let counts = ticks.iter().flatten();
        let expected = counts.filter(|at| wrong(at)).count() as f64;
        // Positions in a scene are rounded.
        close(counted, expected, 2.0);
        assert!(expected > 100.0);
    }
}

#[test]
fn robots_are_to_move_until_one_has_found_the_spot_and_to_stand_afterwards() {
    let (counted, ticks) = beside("white", "stop_errors");
    let on = |at: &[f64; 2]| distance(*at, [0.6, 0.35]) <= 0.2;
    let (mut found, mut expected) = (false, 0.0);
    let mut before = vec![[0.0; 2]; 12];
    let mut one_axis = 0;
    for at in &ticks {
        let after = found;
        for (now, old) in at.iter().zip(&before) {
            let ways = [0, 1].map(|axis| (now[axis] - old[axis]).abs());
            let stands = ways.iter().all(|way| *way < 0.005);
            let moves = ways.iter().all(|way| *way > 0.005);
            one_axis += usize::from(!stands && !moves);
            expected += match after {
                true => f64::from(u8::from(moves)),
                false => 1.0 + f64::from(u8::from(stands && !on(now))),
            };
            found |= on(now);
        }
        before.clone_from(at);
    }
    assert!(found && one_axis > 100, "{one_axis}");
    close(counted, expected, 8.0);
}
