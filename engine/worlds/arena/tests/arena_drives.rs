//! Kinds of robots with different drives, and messages of different lengths.
#![allow(clippy::unwrap_used)] // helpers of tests

use proptest::prelude::*;
use serde_json::{Value, json};
use swarmwright_controllers::Architecture;
use swarmwright_kernels::Arena;
use swarmwright_simulation::{Block, Means, Simulation};

use super::arena_lanes::check;

fn arena(parameters: &Value) -> Arena {
    let mut arena = Arena::default();
    arena.reset(parameters.as_object().unwrap()).unwrap();
    arena
}

/// Of all bits that controllers get in an episode and that metrics are, FNV-1a.
fn digest(parameters: &Value) -> u64 {
    let mut arena = arena(parameters);
    let mut digest = 0xcbf2_9ce4_8422_2325_u64;
    let mut add = |bits: u64| digest = (digest ^ bits).wrapping_mul(0x0100_0000_01b3);
    let description = arena.description();
    let mut sensors = vec![0.0; description.sensors];
    let mut tick = 0;
    while !arena.acting().is_empty() {
        let robots = arena.acting().to_vec();
        for robot in &robots {
            arena.sense(*robot, &mut sensors);
            sensors
                .iter()
                .for_each(|number| add(number.to_bits().into()));
        }
        let actuators: Vec<f32> = (0..robots.len() * description.actuators)
            .map(|index| ((index * 7 + tick * 3) % 11) as f32 / 5.0 - 1.0)
            .collect();
        arena.step(&actuators);
        tick += 1;
    }
    arena
        .metrics()
        .iter()
        .for_each(|metric| add(metric.to_bits()));
    digest
}

#[test]
fn swarms_without_different_drives_keep_their_bits() {
    let wheels = |robot: Value| {
        let mut robot = robot;
        robot["radius"] = json!(0.04);
        robot["drive"] =
            json!({"kind": "differential", "wheel_base": 0.1, "max_speed": 0.3, "noise": 0.05});
        robot["battery"] = json!({"standing": 9, "driving": 3});
        robot
    };
    let message = json!({"kind": "message", "numbers": 2});
    let hears = json!({"kind": "range_and_bearing", "range": 0.8, "loss": 0.3, "gives": ["count", "message"]});
    let kinds = json!([
        {"name": "a", "count": 5, "robot": wheels(json!({"sensors": [hears, {"kind": "encoders", "noise": 0.1}],
            "actuators": [message, {"kind": "led", "colors": ["red", "blue"]}, {"kind": "gripper"}]}))},
        {"name": "b", "count": 4, "robot": wheels(json!({"sensors": [hears, {"kind": "battery"}, {"kind": "proximity", "count": 3,
            "range": 0.2}], "actuators": [message, {"kind": "led", "colors": ["blue"]}]}))},
    ]);
    let failures = json!([{"kind": "slow", "share": 0.5, "factor": 0.4, "at": 0.9}, {"kind": "mute", "share": 0.3}]);
    let swarm = |robots: Value, robot: Value| {
        let mut parameters =
            json!({"robots": robots, "duration": 6, "seed": 9, "failures": failures});
        if !robot.is_null() {
            parameters["robot"] = robot;
        }
        digest(&parameters)
    };
    let found = [
        swarm(json!(9), json!("e-puck-rm1.1")),
        swarm(json!(9), json!("kilobot")),
        swarm(json!(9), json!("point")),
        swarm(json!(9), json!("turtlebot3")),
        swarm(
            json!([{"robot": "e-puck-rm1.1", "count": 5}, {"robot": "foot-bot", "count": 4}]),
            Value::Null,
        ),
        swarm(kinds, Value::Null),
    ];
    let before = [
        8903418398074428463,
        8413550130165428602,
        13644948721383335458,
        7002426567113123995,
        5746017994848662469,
        12421828625112638995,
    ];
    assert_eq!(found, before);
}

fn differential() -> Value {
    json!({"kind": "differential", "wheel_base": 0.1, "max_speed": 0.3})
}

fn holonomic() -> Value {
    json!({"kind": "holonomic", "max_speed": 0.2, "max_turn": 180})
}

fn car() -> Value {
    json!({"kind": "car", "wheel_base": 0.1, "max_speed": 0.4, "max_steering": 30})
}

/// A robot of a kind, `more` beside its body and its drive.
fn kind(name: &str, count: usize, drive: &Value, more: &Value) -> Value {
    let mut robot = json!({"radius": 0.03, "drive": drive, "sensors": [{"kind": "compass"}]});
    for (key, value) in more.as_object().unwrap() {
        robot[key] = value.clone();
    }
    json!({"name": name, "count": count, "robot": robot})
}

fn mission() -> Value {
    json!({"walls": {"rectangle": [8, 8]}, "start": {"rectangle": {"x": [-2, 2], "y": [-2, 2]}}, "fitness": "order"})
}

/// One robot with each of the drives.
fn three(more: &Value) -> Value {
    json!({"mission": mission(), "seed": 3, "robots": [
        kind("wheels", 1, &differential(), more), kind("float", 1, &holonomic(), more), kind("car", 1, &car(), more),
    ]})
}

fn sensed(arena: &Arena, agent: u32) -> Vec<f32> {
    let mut sensors = vec![0.0; arena.description().sensors];
    arena.sense(agent, &mut sensors);
    sensors
}

/// Where robots are: x, y and heading.
fn poses(arena: &Arena) -> Vec<[f32; 3]> {
    let bodies = arena.scene().unwrap().bodies;
    let pose = |body: &swarmwright_simulation::Body| [body.x, body.y, body.heading.unwrap()];
    bodies.iter().map(pose).collect()
}

/// The place of each drive in a row of `three`.
const OWN: [std::ops::Range<usize>; 3] = [0..2, 2..5, 5..7];

#[test]
fn the_same_drives_share_their_actuators_and_others_have_their_own() {
    let names = |robots: &Value| arena(&json!({"robots": robots})).actuator_names();
    let mixed = json!([
        {"robot": "e-puck-rm1.1", "count": 2}, {"robot": "point", "count": 2}, {"robot": "foot-bot", "count": 2},
        {"robot": "kilobot", "count": 2}, kind("car", 1, &car(), &json!({"actuators": [{"kind": "led", "colors": ["red"]}]})),
    ]);
    assert_eq!(
        names(&mixed),
        [
            "e-puck-rm1.1 and foot-bot and kilobot left wheel",
            "e-puck-rm1.1 and foot-bot and kilobot right wheel",
            "point ahead",
            "point left",
            "point turn",
            "car speed",
            "car steering",
            "led red",
            "kilobot message 0"
        ]
    );
    let same = json!([{"robot": "e-puck-rm1.1", "count": 2}, {"robot": "turtlebot3", "count": 2}]);
    assert_eq!(names(&same), ["left wheel", "right wheel"]);
    // Groups have the rows of all.
    let groups = arena(&json!({"robots": mixed})).groups();
    let shapes = groups
        .iter()
        .map(|group| (&group.name[..], group.actuators));
    assert_eq!(
        shapes.collect::<Vec<_>>(),
        ["e-puck-rm1.1", "point", "foot-bot", "kilobot", "car"].map(|name| (name, 9))
    );
}

#[test]
fn each_drive_follows_its_own_actuators() {
    let mut swarm = arena(&three(&json!({})));
    let rows = [
        [1.0, 1.0, 0.0, 0.0, 0.0, 0.0, 0.0],
        [0.0, 0.0, 0.0, 0.5, 0.0, 0.0, 0.0],
        [0.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0],
    ]
    .concat();
    for _ in 0..5 {
        swarm.step(&rows);
    }
    let before = poses(&swarm);
    swarm.step(&rows);
    let after = poses(&swarm);
    // Ahead and to the left in a tick.
    let moved = |robot: usize| {
        let ([x, y, heading], [to_x, to_y, _]) = (before[robot], after[robot]);
        let (dx, dy) = (to_x - x, to_y - y);
        let (cos, sin) = (heading.cos(), heading.sin());
        [dx * cos + dy * sin, dy * cos - dx * sin]
    };
    for (robot, expected) in [[0.03, 0.0], [0.0, 0.01], [0.04, 0.0]]
        .into_iter()
        .enumerate()
    {
        let found = moved(robot);
        assert!(
            (found[0] - expected[0]).hypot(found[1] - expected[1]) < 1e-3,
            "{robot}: {found:?}, {expected:?}"
        );
    }
}

#[test]
fn actuators_of_other_drives_change_nothing() {
    let more = json!({
        "sensors": [{"kind": "compass"}, {"kind": "encoders"}, {"kind": "battery"}],
        "battery": {"standing": 60, "driving": 2},
    });
    let run = |others: f32, own: f32| {
        let mut swarm = arena(&three(&more));
        let mut told = vec![others; 21];
        for (robot, place) in OWN.iter().enumerate() {
            told[robot * 7..][place.clone()].fill(own);
        }
        (0..12).for_each(|_| swarm.step(&told));
        let rows: Vec<Vec<f32>> = (0..3).map(|robot| sensed(&swarm, robot)).collect();
        (poses(&swarm), rows)
    };
    assert_eq!(run(0.0, 0.7), run(-0.9, 0.7));
    let start = poses(&arena(&three(&more)));
    let (standing, rows) = run(1.0, 0.0);
    assert_eq!(standing, start);
    assert!(rows.iter().all(|row| row[4] > 0.97), "{rows:?}");
    // Encoders are those of the drive; the battery is used up by what the robot's drive is told.
    let (_, rows) = run(0.0, 0.5);
    let names = arena(&three(&more)).sensor_names();
    assert_eq!(
        names[2..9],
        [
            "left wheel encoder",
            "right wheel encoder",
            "battery",
            "ahead encoder",
            "left encoder",
            "turn encoder",
            "speed encoder"
        ]
    );
    for (row, own) in rows.iter().zip([2..4, 5..8, 8..10]) {
        for (place, number) in row.iter().enumerate() {
            if own.contains(&place) {
                assert_eq!(*number, 0.5, "{row:?}");
            } else if place == 4 {
                let left = 1.0 - 1.2 * (0.5 / 60.0 + 0.5 / 2.0);
                assert!((number - left).abs() < 1e-4, "{number}, {left}");
            } else if place > 1 {
                assert_eq!(*number, 0.0, "{row:?}");
            }
        }
    }
}

#[test]
fn robots_that_fail_stand_whatever_their_drive() {
    let mut parameters = three(&json!({}));
    parameters["failures"] = json!([{"kind": "stop", "share": 1}]);
    let mut swarm = arena(&parameters);
    let before = poses(&swarm);
    (0..5).for_each(|_| swarm.step(&[1.0; 21]));
    assert_eq!(poses(&swarm), before);
}

/// Robots that stand close together and hear each other, each kind with so many values of a message.
fn talking(kinds: &[(usize, usize)]) -> Arena {
    let drives = [differential(), holonomic(), car()];
    let kinds = kinds.iter().enumerate().map(|(index, (count, numbers))| {
        let hears = json!({"kind": "range_and_bearing", "range": 7, "gives": ["count", "message"],
            "radio": {"line_of_sight": false}});
        let mut more = json!({"sensors": [hears]});
        if *numbers > 0 {
            more["actuators"] = json!([{"kind": "message", "numbers": numbers}]);
        }
        kind(
            &format!("sends {numbers}"),
            *count,
            &drives[index % 3],
            &more,
        )
    });
    arena(&json!({"mission": mission(), "robots": kinds.collect::<Vec<_>>()}))
}

#[test]
fn values_are_means_of_the_messages_that_have_them() {
    let mut swarm = talking(&[(2, 1), (1, 3), (1, 0), (1, 2)]);
    assert_eq!(
        swarm.sensor_names(),
        ["messages heard", "message 0", "message 1", "message 2"]
    );
    assert_eq!(
        swarm.actuator_names()[7..],
        [
            "sends 1 and sends 3 and sends 2 message 0",
            "sends 3 and sends 2 message 1",
            "sends 3 message 2"
        ]
    );
    let rows = [
        [0.25, 9.0, 9.0],
        [0.5, 9.0, 9.0],
        [1.0, -0.5, 0.75],
        [9.0, 9.0, 9.0],
        [-0.5, 0.25, 9.0],
    ];
    let told: Vec<f32> = rows
        .iter()
        .flat_map(|message| [&[0.0; 7][..], message].concat())
        .collect();
    swarm.step(&told);
    for (robot, expected) in [
        [4.0, 1.0 / 3.0, -0.125, 0.75],
        [4.0, 0.25, -0.125, 0.75],
        [4.0, 0.25 / 3.0, 0.25, 0.0],
        [4.0, 0.3125, -0.125, 0.75],
        [4.0, 1.75 / 3.0, -0.5, 0.75],
    ]
    .into_iter()
    .enumerate()
    {
        let found = sensed(&swarm, robot as u32);
        let close = found
            .iter()
            .zip(expected)
            .all(|(a, b)| (a - b).abs() < 1e-6);
        assert!(close, "{robot}: {found:?}, {expected:?}");
    }
    // A robot that sends nothing senses what the only other one sends.
    let mut pair = talking(&[(1, 0), (1, 2)]);
    pair.step(&[[0.0; 7], [0.0, 0.0, 0.0, 0.0, 0.0, 0.5, -1.0]].concat());
    assert_eq!(sensed(&pair, 0), [1.0, 0.5, -1.0]);
    assert_eq!(sensed(&pair, 1), [1.0, 0.0, 0.0]);
}

#[test]
fn messages_need_a_kind_that_sends_them() {
    let hears = json!({"sensors": [{"kind": "compass"}, {"kind": "range_and_bearing", "range": 1, "gives": ["count", "message"]}]});
    let sends = json!({"sensors": [{"kind": "range_and_bearing", "range": 1, "gives": ["count"]}, {"kind": "light", "count": 2}],
        "actuators": [{"kind": "message", "numbers": 2}]});
    let refusal = |robots: Value| {
        let parameters = json!({"robots": robots});
        let refused = Arena::default().reset(parameters.as_object().unwrap());
        refused.unwrap_err().to_string()
    };
    let kinds = json!([
        kind("a", 1, &car(), &json!({})),
        kind("b", 1, &differential(), &hears)
    ]);
    assert!(
        refusal(kinds.clone())
            .contains("robots[1].robot.sensors[1].gives[1]: no message is sent; add an actuator"),
        "{}",
        refusal(kinds)
    );
    let kinds = json!([
        kind("a", 1, &car(), &sends),
        kind("b", 1, &differential(), &hears)
    ]);
    let swarm = arena(&json!({"robots": kinds}));
    assert_eq!(
        swarm.sensor_names(),
        [
            "messages heard",
            "light 0",
            "light 1",
            "compass x",
            "compass y",
            "message 0",
            "message 1"
        ]
    );
}

/// A kind with one of the drives, so many values of a message, and some of sensors and actuators.
fn some_kind(
    index: usize,
    (drive, numbers, parts, count): (usize, usize, [bool; 6], usize),
    sent: bool,
) -> Value {
    let [hears, encoders, battery, light, led, gripper] = parts;
    let mut drive = [differential(), holonomic(), car()][drive].clone();
    drive["noise"] = json!(0.1);
    let (mut sensors, mut actuators) = (vec![json!({"kind": "compass", "noise": 4})], Vec::new());
    if numbers > 0 || hears {
        let gives: &[&str] = if hears && sent {
            &["count", "message"]
        } else {
            &["attraction"]
        };
        sensors.push(json!({"kind": "range_and_bearing", "range": 0.4 + 0.1 * index as f64, "loss": 0.2, "gives": gives}));
    }
    for (present, sensor) in [
        (encoders, json!({"kind": "encoders", "noise": 0.1})),
        (battery, json!({"kind": "battery", "noise": 0.05})),
        (light, json!({"kind": "light", "count": 3, "noise": 0.1})),
        (
            !light,
            json!({"kind": "proximity", "count": 4, "range": 0.2, "noise": 0.1}),
        ),
    ] {
        sensors.extend(present.then_some(sensor));
    }
    for (present, actuator) in [
        (numbers > 0, json!({"kind": "message", "numbers": numbers})),
        (led, json!({"kind": "led", "colors": ["red", "blue"]})),
        (gripper, json!({"kind": "gripper"})),
    ] {
        actuators.extend(present.then_some(actuator));
    }
    let mut more = json!({"sensors": sensors, "actuators": actuators});
    if battery {
        more["battery"] = json!({"standing": 5, "driving": 2});
    }
    kind(&format!("kind {index}"), count, &drive, &more)
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(16))]

    #[test]
    fn mixtures_have_the_same_bits_in_lanes(
        kinds in proptest::collection::vec((0..3usize, 0..4usize, any::<[bool; 6]>(), 1..4usize), 2..5),
    ) {
        let sent = kinds.iter().any(|(_, numbers, ..)| *numbers > 0);
        let kinds = kinds.into_iter().enumerate().map(|(index, kind)| some_kind(index, kind, sent));
        let mut mission = mission();
        mission["start"] = json!({"disc": {"radius": 0.5}});
        mission["lights"] = json!([{"at": [1, 0, 0.3], "intensity": 2}]);
        mission["objects"] = json!([{"name": "ball", "radius": 0.06, "mass": 0.1, "count": 2, "start": {"disc": {"radius": 0.6}}}]);
        let failures = json!([
            {"kind": "stop", "share": 0.4, "at": 1, "until": 1.5}, {"kind": "slow", "share": 0.5, "factor": 0.4},
            {"kind": "mute", "share": 0.3, "at": 0.5},
        ]);
        check(&json!({"mission": mission, "robots": kinds.collect::<Vec<_>>(), "duration": 2, "failures": failures}));
    }
}

#[test]
fn a_team_with_the_same_controller_in_each_group_is_that_controller() {
    let parameters = json!({"mission": mission(), "duration": 3, "robots": [
        {"robot": "kilobot", "count": 3}, {"robot": "point", "count": 2}, kind("car", 2, &car(), &json!({})),
    ]});
    let parameters = parameters.as_object().unwrap();
    let description = Arena::default().described(parameters).unwrap();
    let one = json!({"kind": "layered", "version": 1, "hidden": [3], "activation": "tanh", "output_range": [-1, 1],
        "sensors": description.sensors, "actuators": description.actuators});
    let groups = [("kilobot", 3), ("point", 2), ("car", 2)]
        .map(|(name, agents)| json!({"name": name, "agents": agents, "controller": one}));
    let run = |architecture: &Value, times: usize| {
        let architecture = Architecture::from_json(&architecture.to_string()).unwrap();
        let length = architecture.weight_count() / times;
        let genomes: Vec<f32> = (0..8)
            .flat_map(|candidate| {
                let weight =
                    |index: usize| (((index + candidate * 31) * 37 % 101) as f32 - 50.0) / 40.0;
                (0..length).map(weight).collect::<Vec<_>>().repeat(times)
            })
            .collect();
        let block = Block {
            architecture: &architecture,
            genomes: &genomes,
            parameters,
            seeds: &[1, 2, 3],
            metrics: &[0],
            stop: None,
        };
        let found = Arena::default().evaluate(&block, Means::default());
        found.unwrap().unwrap()
    };
    let team = json!({"version": 1, "kind": "team", "groups": groups});
    let found = run(&team, 3);
    assert_eq!(found, run(&one, 1));
    assert!(found.iter().any(|number| *number > 0.0));
}
