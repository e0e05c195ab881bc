//! Swarms with robots of several kinds.
#![allow(clippy::unwrap_used)] // helpers of tests

use serde_json::{Value, json};
use swarmwright_kernels::Arena;
use swarmwright_simulation::Simulation;

/// A robot with these sensors; all that have the same number of them fit together.
fn robot(radius: f64, mass: f64, max_speed: f64, sensors: &Value) -> Value {
    json!({"radius": radius, "mass": mass, "sensors": sensors,
        "drive": {"kind": "holonomic", "max_speed": max_speed, "max_turn": 0}})
}

fn nearest() -> Value {
    json!([{"kind": "proximity", "count": 8, "range": 0.5, "response": [0, 1, 0]}])
}

fn mission(start: &Value) -> Value {
    json!({"walls": {"rectangle": [6, 4]}, "start": start, "fitness": "order"})
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

fn drive_east(arena: &mut Arena, speeds: &[f32], ticks: usize) {
    for _ in 0..ticks {
        let scene = arena.scene().unwrap();
        let headings = scene.bodies.iter().filter_map(|body| body.heading);
        let actuators: Vec<f32> = headings
            .zip(speeds)
            .flat_map(|(heading, speed)| [heading.cos() * speed, -heading.sin() * speed, 0.0])
            .collect();
        arena.step(&actuators);
    }
}

#[test]
fn kinds_have_their_own_bodies_and_looks() {
    let kinds = json!([
        {"robot": robot(0.1, 2.0, 0.3, &nearest()), "count": 3, "name": "large"},
        {"robot": robot(0.03, 0.2, 0.1, &nearest()), "count": 5},
    ]);
    let start = json!({"rectangle": {"x": [-1, 1], "y": [-1, 1]}});
    let mut arena = arena(&json!({"mission": mission(&start), "robots": kinds}));
    assert_eq!(arena.acting().len(), 8);
    let before = arena.scene().unwrap().bodies;
    let radii: Vec<f32> = before.iter().map(|body| body.radius).collect();
    assert_eq!(radii, [0.1, 0.1, 0.1, 0.03, 0.03, 0.03, 0.03, 0.03]);
    let states: Vec<&str> = before.iter().map(|body| body.state.as_ref()).collect();
    assert_eq!(states[2..4], ["large", "robot 1"]);
    // No robot overlaps another one.
    for (index, a) in before.iter().enumerate() {
        for b in &before[index + 1..] {
            assert!((a.x - b.x).hypot(a.y - b.y) >= a.radius + b.radius - 1e-6);
        }
    }
    // Each drives as fast as its kind does.
    let speeds = [1.0; 8];
    drive_east(&mut arena, &speeds, 8);
    let middle = arena.scene().unwrap().bodies;
    drive_east(&mut arena, &speeds, 1);
    let after = arena.scene().unwrap().bodies;
    let fastest = |from: usize, to: usize| {
        let ways = (from..to).map(|index| (after[index].x - middle[index].x) * 10.0);
        ways.fold(0.0, f32::max)
    };
    assert!((fastest(0, 3) - 0.3).abs() < 0.003, "{}", fastest(0, 3));
    // A small one that a large one pushes is faster.
    assert!(fastest(3, 8) > 0.099, "{}", fastest(3, 8));
}

#[test]
fn rays_see_each_kind_in_its_size() {
    // Two robots side by side: each sees the rim of the other.
    let kinds = json!([
        {"robot": robot(0.1, 1.0, 0.1, &nearest()), "count": 1, "name": "large"},
        {"robot": robot(0.03, 1.0, 0.1, &nearest()), "count": 1, "name": "small"},
    ]);
    let start = json!({"rectangle": {"x": [-0.3, 0.3], "y": [-0.001, 0.001]}});
    let mut seen = 0;
    for seed in 0..40 {
        let arena = arena(&json!({"mission": mission(&start), "robots": kinds, "seed": seed}));
        let scene = arena.scene().unwrap();
        let bodies = &scene.bodies;
        let apart = (bodies[0].x - bodies[1].x).hypot(bodies[0].y - bodies[1].y);
        for (agent, other) in [(0, 1), (1, 0)] {
            let mut sensors = [0.0; 8];
            arena.sense(agent as u32, &mut sensors);
            let nearest = sensors.iter().copied().filter(|reading| *reading > 0.0);
            let nearest = nearest.fold(f32::INFINITY, f32::min);
            let rim = apart - bodies[agent].radius - bodies[other].radius;
            if nearest < f32::INFINITY {
                seen += 1;
                assert!(nearest > rim - 1e-3, "{nearest}, {rim}");
                // A ray that meets the disc at all meets it at most a radius beyond its rim.
                assert!(
                    nearest < rim + bodies[other].radius + 1e-3,
                    "{nearest}, {rim}"
                );
            }
        }
        for ray in &scene.rays {
            let mut sensors = [0.0; 8];
            arena.sense(ray.body, &mut sensors);
            let reading = ray.reading.unwrap();
            assert!(sensors.iter().any(|sensor| (sensor - reading).abs() < 1e-4));
        }
    }
    assert!(seen > 40, "{seen}");
}

#[test]
fn messages_count_from_rim_to_rim() {
    let sensors = json!([{"kind": "range_and_bearing", "range": 2, "gives": ["attraction"]}]);
    let kinds = json!([
        {"robot": robot(0.1, 1.0, 0.1, &sensors), "count": 1, "name": "large"},
        {"robot": robot(0.03, 1.0, 0.1, &sensors), "count": 1, "name": "small"},
    ]);
    let start = json!({"rectangle": {"x": [-0.1, 0.1], "y": [-0.1, 0.1]}});
    for seed in 0..20 {
        let arena = arena(&json!({"mission": mission(&start), "robots": kinds, "seed": seed}));
        let bodies = arena.scene().unwrap().bodies;
        for (agent, other) in [(0, 1), (1, 0)] {
            let [body, sender] = [agent, other].map(|index: usize| &bodies[index]);
            let way = [sender.x - body.x, sender.y - body.y];
            let far = way[0].hypot(way[1]);
            let expected = 1.0 / (1.0 + 100.0 * (far - 0.13)) / far;
            let (sin, cos) = body.heading.unwrap().sin_cos();
            let ahead = (way[0] * cos + way[1] * sin) * expected;
            let left = (way[1] * cos - way[0] * sin) * expected;
            let mut heard = [0.0; 2];
            arena.sense(agent as u32, &mut heard);
            assert!((heard[0] - ahead).abs() < 1e-3, "{heard:?}, {ahead}");
            assert!((heard[1] - left).abs() < 1e-3, "{heard:?}, {left}");
        }
    }
}

#[test]
fn robots_hide_lamps_whatever_else_others_sense() {
    let seen = |more: &Value, seed: u64| {
        let mut sensors = vec![json!({"kind": "light", "count": 4, "reach": 10})];
        sensors.extend(more.as_array().unwrap().iter().cloned());
        let mut tall = robot(0.05, 1.0, 0.1, &json!(sensors));
        tall["height"] = json!(0.2);
        let start = json!({"rectangle": {"x": [-2.5, 0], "y": [-0.03, 0.03]}});
        let mut mission = mission(&start);
        mission["lights"] = json!([{"at": [2, 0, 0.3], "intensity": 3}]);
        let arena = arena(&json!({"mission": mission, "robots": 2, "robot": tall, "seed": seed}));
        [0, 1].map(|agent| {
            let mut sensors = vec![0.0; arena.description().sensors];
            arena.sense(agent, &mut sensors);
            sensors[..4].to_vec()
        })
    };
    let mut hidden = 0;
    for seed in 0..40 {
        let alone = seen(&json!([]), seed);
        let all = seen(
            &json!([{"kind": "neighbours", "range": 9, "gives": ["count"]}]),
            seed,
        );
        assert_eq!(alone, all, "seed {seed}");
        let dark = |sensors: &Vec<f32>| sensors.iter().all(|reading| *reading <= 0.0);
        hidden += alone.iter().filter(|sensors| dark(sensors)).count();
    }
    assert!((20..=40).contains(&hidden), "{hidden}");
}

#[test]
fn rays_see_what_a_robot_is_pressed_to() {
    let sensors = json!([{"kind": "proximity", "count": 24, "range": 0.2}]);
    let robot = robot(0.1, 1.0, 0.5, &sensors);
    let start = json!({"rectangle": {"x": [2, 2.8], "y": [-1, 1]}});
    for seed in 0..5 {
        let mut arena =
            arena(&json!({"mission": mission(&start), "robots": 1, "robot": robot, "seed": seed}));
        drive_east(&mut arena, &[1.0], 60);
        let scene = arena.scene().unwrap();
        let ahead = 3.0 - (scene.bodies[0].x - scene.width / 2.0);
        assert!(ahead < 0.1, "{ahead}");
        let mut sensors = [0.0; 24];
        arena.sense(0, &mut sensors);
        for (ray, reading) in sensors.iter().enumerate() {
            let to_wall = scene.bodies[0].heading.unwrap() + (ray as f32 * 15.0).to_radians();
            let gap = ahead / to_wall.cos() - 0.1;
            if (0.0..0.15).contains(&gap) {
                let expected = 1.0 - gap / 0.2;
                assert!(
                    (reading - expected).abs() < 0.05,
                    "{ray}: {reading}, {expected}"
                );
            }
        }
        let drawn: Vec<f32> = scene.rays.iter().filter_map(|ray| ray.reading).collect();
        for (drawn, reading) in drawn.iter().zip(sensors) {
            assert!((drawn - reading).abs() < 1e-4, "{drawn}, {reading}");
        }
    }
}

#[test]
fn the_heavier_of_two_goes_on() {
    // Both push against each other; forces are mass times acceleration.
    let kinds = json!([
        {"robot": robot(0.05, 2.0, 0.2, &nearest()), "count": 1, "name": "heavy"},
        {"robot": robot(0.05, 0.5, 0.2, &nearest()), "count": 1, "name": "light"},
    ]);
    let start = json!({"rectangle": {"x": [-0.2, 0.2], "y": [-0.001, 0.001]}});
    let seed = (0..100).find(|seed| {
        let arena = arena(&json!({"mission": mission(&start), "robots": kinds, "seed": seed}));
        let bodies = arena.scene().unwrap().bodies;
        bodies[0].x < bodies[1].x
    });
    let mut arena =
        arena(&json!({"mission": mission(&start), "robots": kinds, "seed": seed.unwrap()}));
    drive_east(&mut arena, &[1.0, -1.0], 30);
    let before = arena.scene().unwrap().bodies;
    drive_east(&mut arena, &[1.0, -1.0], 10);
    let after = arena.scene().unwrap().bodies;
    for index in 0..2 {
        let speed = after[index].x - before[index].x;
        assert!(speed > 0.1, "{index}: {speed}");
    }
}

#[test]
fn a_list_of_one_kind_is_that_kind() {
    let run = |parameters: Value| {
        let mut arena = arena(&parameters);
        for tick in 0..30 {
            let actuators: Vec<f32> = (0..40)
                .map(|index| ((index * 7 + tick) % 11) as f32 / 5.0 - 1.0)
                .collect();
            arena.step(&actuators);
        }
        let bodies = arena.scene().unwrap().bodies;
        let mut sensors = vec![0.0; 24];
        arena.sense(3, &mut sensors);
        let places: Vec<(f32, f32)> = bodies.iter().map(|body| (body.x, body.y)).collect();
        (places, sensors)
    };
    let several = json!([{"robot": "e-puck-rm1.1", "count": 20}]);
    assert_eq!(run(json!({"robots": several})), run(json!({"robots": 20})));
    // Two kinds that are the same but for their names do not differ either.
    let several = json!([
        {"robot": "e-puck-rm1.1", "count": 13, "name": "a"},
        {"robot": "e-puck-rm1.1", "count": 7, "name": "b"},
    ]);
    assert_eq!(run(json!({"robots": several})), run(json!({"robots": 20})));
}

#[test]
fn mistakes_name_the_kind() {
    let e_puck = |count: i64| json!({"robot": "e-puck-rm1.1", "count": count});
    let cases = [
        (
            json!({"robots": []}),
            "robots: 0 kinds found, expected 1 to 16",
        ),
        (
            json!({"robots": [e_puck(0)]}),
            "robots[0].count: 0 found, expected 1 to 100000",
        ),
        (
            json!({"robots": [e_puck(3), e_puck(4)]}),
            "robots[1].name: another kind is already named \"e-puck-rm1.1\"; choose another name",
        ),
        (
            json!({"robots": [e_puck(3), {"robot": "r2d2", "count": 1}]}),
            "robots[1].robot: \"r2d2\" found, expected the name of a robot",
        ),
        (
            json!({"robots": [{"robot": "e-puck-rm1.1", "name": "", "count": 2}]}),
            "robots[0].name: an empty name found",
        ),
        (
            json!({"robots": [{"robot": "e-puck-rm1.1"}]}),
            "robots[0]: missing field `count`",
        ),
        (
            json!({"robots": [e_puck(3)], "robot": "foot-bot"}),
            "robot: robots lists kinds with a robot each",
        ),
        (
            json!({"robots": "many"}),
            "robots: \"many\" found, expected 1 to 100000, or a list",
        ),
    ];
    for (parameters, expected) in cases {
        let message = refusal(&parameters);
        assert!(message.contains(expected), "{message:?} lacks {expected:?}");
    }
    let mut mission = mission(&json!({"disc": {"radius": 1}}));
    mission["robots"] = json!([e_puck(3), {"robot": "e-puck-rm1.1", "name": "b", "count": 2}]);
    let message = refusal(&json!({"mission": mission, "robots": 7}));
    assert!(
        message.contains("robots: 7 found, but the mission has 2 kinds of robots"),
        "{message}"
    );
    // A model for all, and the mission's kinds.
    assert_eq!(
        arena(&json!({"mission": mission, "robot": "kilobot"}))
            .acting()
            .len(),
        5
    );
    assert_eq!(arena(&json!({"mission": mission})).acting().len(), 5);
}

#[test]
fn metrics_and_failures_know_the_kinds() {
    let kinds = json!([
        {"robot": "e-puck-rm1.1", "count": 6, "name": "a"},
        {"robot": "e-puck-rm1.1", "count": 4, "name": "b"},
    ]);
    let mut mission = mission(&json!({"rectangle": {"x": [-1, 1], "y": [-1, 1]}}));
    mission["floor"] = json!({"patches": [{"name": "all", "rectangle": {"x": [-3, 3], "y": [-2, 2]}, "color": 0}]});
    mission["robots"] = kinds;
    mission["failures"] = json!([{"kind": "stop", "share": 0.5, "robots": "b"}]);
    mission["metrics"] = json!({
        "a": {"kind": "robots_on", "patch": "all", "robots": "a", "when": "end"},
        "share": {"kind": "robots_on", "patch": "all", "robots": "b", "when": "end", "share": true},
        "both": {"kind": "robots_on", "patch": "all", "when": "end"},
    });
    let mut stopped = Vec::new();
    for seed in 0..10 {
        let parameters = json!({"mission": mission, "duration": 0.5, "seed": seed});
        let mut arena = arena(&parameters);
        let before = arena.scene().unwrap().bodies;
        while !arena.acting().is_empty() {
            arena.step(&[1.0; 20]);
        }
        let after = arena.scene().unwrap().bodies;
        let still: Vec<usize> = (0..10)
            .filter(|robot| before[*robot].heading == after[*robot].heading)
            .collect();
        assert_eq!(still.len(), 2, "{still:?}");
        assert!(still.iter().all(|robot| *robot >= 6), "{still:?}");
        stopped.extend(still);
        let names = arena.description().metrics;
        let values = arena.metrics();
        let value =
            |name: &str| values[names.iter().position(|metric| metric.name == name).unwrap()];
        assert_eq!(
            [value("a"), value("share"), value("both")],
            [6.0, 1.0, 10.0]
        );
    }
    assert!((6..10).all(|robot| stopped.contains(&robot)), "by the seed");
    let mut wrong = mission.clone();
    wrong["metrics"]["a"]["robots"] = json!("c");
    let message = refusal(&json!({"mission": wrong}));
    assert!(
        message.contains(
            "mission.metrics.a.robots: no kind of robots is named \"c\"; available: a, b"
        ),
        "{message}"
    );
    let failures = json!([{"kind": "blind", "share": 1, "robots": "d"}]);
    let message = refusal(&json!({"mission": mission, "failures": failures}));
    assert!(
        message.contains("failures[0].robots: no kind of robots is named \"d\""),
        "{message}"
    );
    // Without a list there are no kinds to name.
    let message = refusal(&json!({"mission": mission, "robot": "e-puck-rm1.1"}));
    assert!(message.contains("available: none"), "{message}");
}

/// A robot on wheels with these sensors, and LEDs of these colours.
fn on_wheels(radius: f64, sensors: &Value, colors: &Value) -> Value {
    let mut robot = json!({"radius": radius, "sensors": sensors,
        "drive": {"kind": "differential", "wheel_base": 0.05, "max_speed": 0.2, "noise": 0.1}});
    if !colors.is_null() {
        robot["actuators"] = json!([{"kind": "led", "colors": colors}]);
    }
    robot
}

fn sensed(arena: &Arena, agent: u32) -> Vec<f32> {
    let mut sensors = vec![0.0; arena.description().sensors];
    arena.sense(agent, &mut sensors);
    sensors
}

#[test]
fn kinds_with_other_sensors_share_those_that_are_the_same() {
    let light = json!({"kind": "light", "count": 4, "noise": 0.1});
    let near = json!({"kind": "proximity", "count": 6, "range": 0.3, "noise": 0.1});
    let scout = json!([near, light, {"kind": "ground"}]);
    let carrier = json!([
        {"kind": "range_and_bearing", "range": 1, "loss": 0.3, "gives": ["count", "attraction"]},
        light,
        {"kind": "proximity", "angles": [0, 20], "range": 0.1},
        {"kind": "battery"},
    ]);
    let swarm = |of_scouts: &Value, of_carriers: &Value| {
        let with_battery = |radius: f64, sensors: &Value| {
            let mut made = on_wheels(radius, sensors, &Value::Null);
            made["battery"] = json!({"standing": 60, "driving": 30});
            made
        };
        let mission = json!({"walls": {"rectangle": [2, 2]}, "fitness": "order",
            "start": {"rectangle": {"x": [-0.4, 0.4], "y": [-0.4, 0.4]}},
            "floor": {"color": "black"}, "lights": [{"at": [1, 0, 0.3], "intensity": 2}]});
        arena(&json!({"mission": mission, "robots": [
            {"name": "scout", "count": 3, "robot": with_battery(0.04, of_scouts)},
            {"name": "carrier", "count": 2, "robot": with_battery(0.08, of_carriers)},
        ]}))
    };
    let (mut both, mut scouts, mut carriers) = (
        swarm(&scout, &carrier),
        swarm(&scout, &scout),
        swarm(&carrier, &carrier),
    );
    let names = both.sensor_names();
    assert_eq!(names.len(), 6 + 4 + 1 + 3 + 2 + 1);
    assert_eq!(
        names[..11].iter().map(String::as_str).collect::<Vec<_>>(),
        [
            "scout proximity 0",
            "scout proximity 1",
            "scout proximity 2",
            "scout proximity 3",
            "scout proximity 4",
            "scout proximity 5",
            "light 0",
            "light 1",
            "light 2",
            "light 3",
            "ground 0"
        ]
    );
    assert_eq!(
        names[11..],
        [
            "messages heard",
            "attraction x",
            "attraction y",
            "carrier proximity 0",
            "carrier proximity 1",
            "battery"
        ]
    );
    assert_eq!(both.actuator_names(), ["left wheel", "right wheel"]);
    for tick in 0..60 {
        for agent in 0..3 {
            let found = sensed(&both, agent);
            assert_eq!(found[..11], sensed(&scouts, agent), "{tick} {agent}");
            assert_eq!(found[11..], [0.0, 0.0, 0.0, 0.0, 0.0, 1.0]);
        }
        for agent in 3..5 {
            let (found, alone) = (sensed(&both, agent), sensed(&carriers, agent));
            assert_eq!(found[..6], [0.0; 6]);
            assert_eq!(found[6..10], alone[3..7]);
            assert_eq!(found[10], 0.5, "neither black nor white");
            // Scouts do not send.
            assert!(found[11] <= 1.0 && found[11] <= alone[0], "{found:?}");
            assert_eq!(found[14..], alone[7..]);
        }
        let told: Vec<f32> = (0..10)
            .map(|at| ((tick * 3 + at * 5) % 9) as f32 / 4.0 - 1.0)
            .collect();
        for one in [&mut both, &mut scouts, &mut carriers] {
            one.step(&told);
        }
    }
    // Built-in robots with other numbers of everything.
    let mixed = arena(
        &json!({"robots": [{"robot": "e-puck-rm1.1", "count": 4}, {"robot": "foot-bot", "count": 2}]}),
    );
    assert_eq!(mixed.description().sensors, 8 + 8 + 3 + 1 + 4 + 24 + 24 + 4);
    assert_eq!(mixed.description().actuators, 2);
}

#[test]
fn kinds_with_other_lamps_ignore_what_they_lack() {
    let camera = |range: f64| json!([{"kind": "camera", "range": range, "colors": ["red", "blue"], "gives": ["count"]}]);
    let mission = json!({"walls": {"rectangle": [2, 2]}, "fitness": "order",
        "start": {"rectangle": {"x": [-0.8, 0.8], "y": [-0.8, 0.8]}}});
    let mut swarm = arena(&json!({"mission": mission, "robots": [
        {"name": "signal", "count": 1, "robot": on_wheels(0.03, &camera(3.0), &json!(["red", "blue"]))},
        {"name": "dark", "count": 1, "robot": on_wheels(0.03, &camera(3.0), &Value::Null)},
        {"name": "beacon", "count": 1, "robot": on_wheels(0.03, &camera(3.0), &json!(["blue"]))},
    ]}));
    assert_eq!(
        swarm.actuator_names(),
        [
            "left wheel",
            "right wheel",
            "signal led red",
            "signal led blue",
            "beacon led blue"
        ]
    );
    // All are told the same; each shows what it has.
    let row = [0.0, 0.0, 1.0, 0.5, 1.0];
    swarm.step(&[row, row, row].concat());
    assert_eq!(sensed(&swarm, 1), [1.0, 1.0]);
    assert_eq!(sensed(&swarm, 0), [0.0, 1.0]);
    assert_eq!(sensed(&swarm, 2), [1.0, 0.0]);
    let row = [0.0, 0.0, 0.2, 0.5, -1.0];
    swarm.step(&[row, row, row].concat());
    assert_eq!(sensed(&swarm, 1), [0.0, 1.0]);
    assert_eq!(sensed(&swarm, 0), [0.0, 0.0]);
}
