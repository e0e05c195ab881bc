//! Lanes, threads and one episode at a time give the same fitness and the same metrics, to the bit.
#![allow(clippy::unwrap_used)] // helpers of tests

use proptest::prelude::*;
use serde_json::{Map, Value, json};
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};
use swarmwright_controllers::{Architecture, ControllerError};
use swarmwright_lanes::Level;
use swarmwright_worlds::{Block, Means, RolloutError, create, described, evaluate};

/// All ways of evaluating a block agree with the plain one; returns its fitness.
pub(super) fn check(
    title: &str,
    architecture: &Value,
    parameters: &Value,
    genomes: &[f32],
    seeds: &[u64],
) -> Vec<f64> {
    let architecture = Architecture::from_json(&architecture.to_string()).unwrap();
    let length = architecture.weight_count();
    let candidates = genomes.len() / length;
    let parameters: Map<String, Value> = parameters.as_object().unwrap().clone();
    let count = described(title, &parameters)
        .unwrap()
        .unwrap()
        .metrics
        .len();
    // In another order than they are announced in.
    let metrics: Vec<usize> = (0..count).rev().collect();
    let run = |metrics, means| {
        let block = Block {
            architecture: &architecture,
            genomes: &genomes[..candidates * length],
            parameters: &parameters,
            seeds,
            metrics,
            stop: None,
        };
        evaluate(title, &block, means).unwrap().unwrap()
    };
    let one_by_one = Means {
        level: None,
        threads: 1,
    };
    let measured = run(&metrics, one_by_one);
    let numbers = 1 + metrics.len();
    let plain: Vec<f64> = measured.iter().copied().step_by(numbers).collect();
    assert_eq!(plain.len(), candidates * seeds.len());
    for level in Level::available() {
        for threads in [1, 2] {
            let means = Means {
                level: Some(level),
                threads,
            };
            let bits = |values: &[f64]| {
                values
                    .iter()
                    .map(|value| value.to_bits())
                    .collect::<Vec<_>>()
            };
            let way = format!("{} with {threads} threads", level.name());
            assert_eq!(bits(&run(&[], means)), bits(&plain), "{way}");
            assert_eq!(bits(&run(&metrics, means)), bits(&measured), "{way}");
        }
    }
    plain
}

pub(super) fn network(sensors: usize, actuators: usize) -> impl Strategy<Value = Value> {
    let layered = (prop::collection::vec(1usize..5, 0..3), prop::sample::select(vec!["tanh", "relu", "sigmoid", "clamp", "linear"]))
        .prop_map(|(hidden, activation)| json!({"kind": "layered", "hidden": hidden, "activation": activation}));
    let meshed = (0usize..4, 1u32..4, prop::sample::select(vec!["tanh", "clamp", "relu", "sigmoid"])).prop_map(
        |(hidden, iterations, activation)| {
            json!({"kind": "fully_meshed", "hidden": hidden, "iterations": iterations, "activation": activation})
        },
    );
    let network = (
        prop_oneof![layered, meshed],
        prop::sample::select(vec![[-1, 1], [0, 1]]),
    )
        .prop_map(|(mut network, range)| {
            network["output_range"] = json!(range);
            network
        });
    let evostick = Just(json!({"kind": "evostick"}));
    let hebbian = (0usize..4, 1u32..4).prop_map(
        |(hidden, iterations)| json!({"kind": "hebbian", "hidden": hidden, "iterations": iterations}),
    );
    let hears = prop::collection::vec(0..sensors + actuators, 0..6);
    let neat = (prop::collection::vec(hears, actuators..actuators + 3), 1u32..4).prop_map(
        |(sources, iterations)| json!({"kind": "neat", "sources": sources, "iterations": iterations}),
    );
    (prop_oneof![6 => network.boxed(), 2 => machine(sensors).boxed(), 1 => evostick, 1 => hebbian, 1 => neat])
        .prop_map(move |mut controller| {
            for (key, value) in [
                ("version", 1),
                ("sensors", sensors),
                ("actuators", actuators),
            ] {
                controller[key] = json!(value);
            }
            controller
        })
}

/// A machine that looks at some of the sensors.
fn machine(sensors: usize) -> impl Strategy<Value = Value> {
    let cut = prop::sample::select(vec![vec![], vec![], vec![0.0], vec![-0.3, 0.4]]);
    (1usize..4, prop::collection::vec(cut, sensors)).prop_map(|(states, mut thresholds)| {
        // As many as leave several machines among the weights.
        let mut looked_at = 0;
        for of_one in &mut thresholds {
            looked_at += usize::from(!of_one.is_empty());
            if looked_at > 3 {
                of_one.clear();
            }
        }
        json!({"kind": "mealy_fsm", "states": states, "thresholds": thresholds})
    })
}

pub(super) fn weights() -> impl Strategy<Value = Vec<f32>> {
    prop::collection::vec(
        prop_oneof![8 => -3.0f32..3.0, 1 => Just(0.0f32), 1 => -1e20f32..1e20],
        300..900,
    )
}

pub(super) fn minisim() -> impl Strategy<Value = Value> {
    let bodies = (
        1u32..12,
        prop_oneof![4 => 0u32..6, 1 => 30u32..40],
        any::<bool>(),
    );
    let world = (1u32..60, 1u32..60, 0.0f32..4.0, 0.0f32..2.0);
    (bodies, world, 1u32..25, 0.0f32..1.5, 0.0f32..1.5).prop_map(
        |((agents, defenders, random), (width, height, fast, slow), steps, capture, goal)| {
            json!({"numAgents": agents, "numDefenders": defenders, "placement": if random { "random" } else { "fixed" },
                "mapWidth": width, "mapHeight": height, "speedAgents": fast, "speedDefenders": slow, "maxSteps": steps,
                "captureRadius": capture, "goalRadius": goal})
        },
    )
}

pub(super) fn emergency_exit() -> impl Strategy<Value = Value> {
    let sizes = (1u32..12, 1u32..6, 0u32..20, 4u32..24);
    (sizes, 1u32..30, any::<bool>(), 0u32..3).prop_map(|((agents, exits, blockades, side), steps, together, more)| {
        let agents = agents.min(side).min(side * side - exits - blockades.min(side));
        json!({"numAgents": agents, "numExits": exits, "numBlockades": blockades.min(side), "width": side,
            "height": side + more, "steps": steps, "update": if together { "simultaneous" } else { "sequential" }})
    })
}

pub(super) fn arena() -> impl Strategy<Value = Value> {
    // One at a time, more than 48 robots are sorted into cells.
    let robots = prop_oneof![6 => 1u32..24, 1 => 44u32..70];
    let missions = [
        "aac",
        "cfa",
        "sca",
        "directional_gate",
        "guided_shelter",
        "flocking",
        "area_coverage",
        "formation",
        "emergency_exit",
    ];
    let mission = prop_oneof![
        4 => prop::sample::select(missions.to_vec()).prop_map(|name| json!(name)),
        1 => Just(measured()),
    ];
    (robots, 0.1f64..12.0, mission).prop_map(
        |(robots, duration, mission)| json!({"robots": robots, "duration": duration, "mission": mission}),
    )
}

/// A mission in an arena with a corner that points inwards, with metrics of many kinds.
fn measured() -> Value {
    json!({
        "walls": {"corners": [[-1.5, -1.5], [1.5, -1.5], [1.5, 1.5], [0.2, 0.3], [-1.5, 1.5]]},
        "obstacles": [{"center": [0.8, -0.8], "size": [0.3, 0.1], "angle": 30}],
        "floor": {"patches": [
            {"name": "west", "circle": {"center": [-1, -1], "radius": 0.2}, "color": "black"},
            {"name": "east", "rectangle": {"x": [0.8, 1.2], "y": [-1.4, -1]}, "color": "random"},
        ]},
        "start": {"rectangle": {"x": [-1.4, 1.4], "y": [-1.4, 0.2]}},
        "metrics": {
            "a": {"kind": "order"},
            "b": {"kind": "group_speed", "link": 0.4, "when": "each_tick"},
            "c": {"kind": "nearest_distance"},
            "d": {"kind": "largest_group", "link": 0.3, "share": true},
            "e": {"kind": "groups", "link": 0.3, "when": "end"},
            "f": {"kind": "covered_share", "radius": 0.2, "when": "end"},
            "g": {"kind": "visited_share", "cell": 0.2},
            "h": {"kind": "shape_deviation", "shape": {"line": [[0, 0], [1, 0]], "turned": true}, "when": "end"},
            "i": {"kind": "chain_reach", "from": "west", "to": "east", "link": 0.4},
            "j": {"kind": "distance_to_center"},
            "k": {"kind": "robots_on", "patch": "west", "when": "mean"},
            "l": {"kind": "time_until", "patch": "west", "at_least": 0.2},
            "m": {"kind": "time_until", "patch": "west", "at_most": 0.1},
        },
        "fitness": {"offset": 1, "factors": {"a": 1, "g": 10, "speed": -1}},
    })
}

/// Robots of other kinds, with all their sensors and a network that fits.
fn composed() -> impl Strategy<Value = (Value, Value)> {
    let of = |robot: Value, sensors: usize, actuators: usize| {
        (Just(robot), network(sensors, actuators)).boxed()
    };
    let own = |drive: Value| {
        json!({
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
        })
    };
    let wheels = json!({"kind": "differential", "wheel_base": 0.1, "max_speed": 0.4, "noise": 0.1});
    let holonomic = json!({"kind": "holonomic", "max_speed": 0.3, "max_turn": 200, "noise": 0.05});
    let car = json!({"kind": "car", "wheel_base": 0.1, "max_speed": 0.3, "max_steering": 40, "noise": 0.05});
    let shared = 2 + 3 + 5 + 3 + 2 + 7 + 2;
    prop_oneof![
        of(own(wheels), shared + 2, 5),
        of(own(holonomic), shared + 3, 6),
        of(own(car), shared + 2, 5),
        of(json!("foot-bot"), 57, 2),
        of(json!("kilobot"), 4, 3),
        of(json!("point"), 9, 3),
        of(json!("turtlebot3"), 40, 2),
    ]
}

/// Stadium: the field of FREVO's result files.
fn stadium() -> Value {
    let path = concat!(
        env!("CARGO_MANIFEST_DIR"),
        "/../../../tests/data/frevo/stadium.json"
    );
    serde_json::from_str(&std::fs::read_to_string(path).unwrap()).unwrap()
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(48))]

    #[test]
    fn minisim_is_the_same_however_it_is_computed(
        network in network(4, 1), parameters in minisim(), genomes in weights(), first in any::<u32>(), episodes in 1u64..5,
    ) {
        let seeds: Vec<u64> = (0..episodes).map(|episode| u64::from(first) + episode).collect();
        check("minisim", &network, &parameters, &genomes, &seeds);
    }

    #[test]
    fn emergency_exit_is_the_same_however_it_is_computed(
        network in network(10, 2), parameters in emergency_exit(), genomes in weights(), first in any::<u32>(), episodes in 1u64..5,
    ) {
        let seeds: Vec<u64> = (0..episodes).map(|episode| u64::from(first) + episode).collect();
        check("emergency_exit", &network, &parameters, &genomes, &seeds);
    }

    #[test]
    fn arena_is_the_same_however_it_is_computed(
        network in network(24, 2), parameters in arena(), genomes in weights(), first in any::<u32>(), episodes in 1u64..5,
    ) {
        let seeds: Vec<u64> = (0..episodes).map(|episode| u64::from(first) + episode).collect();
        check("arena", &network, &parameters, &genomes, &seeds);
    }

    #[test]
    fn robots_of_other_kinds_are_the_same_however_they_are_computed(
        (robot, network) in composed(), genomes in weights(), seed in any::<u32>(), robots in 2u32..9, duration in 0.1f64..8.0,
    ) {
        // Begin within the episode, and befall a robot at least.
        let at = |part: f64| (duration * 10.0 * part).floor() / 10.0;
        let share = |share: f64| share.max(0.5 / f64::from(robots));
        let failures = json!([
            {"kind": "stop", "share": share(0.3), "at": at(0.3), "until": at(0.3) + 2.0},
            {"kind": "slow", "share": share(0.5), "factor": 0.4, "at": at(0.1)},
            {"kind": "blind", "share": share(0.2), "at": at(0.4)},
            {"kind": "mute", "share": share(0.3)},
            {"kind": "loss", "loss": 0.5, "at": at(0.6)},
        ]);
        let mut parameters = json!({"mission": "aac", "robot": robot, "robots": robots, "duration": duration});
        if seed % 2 == 0 {
            parameters["failures"] = failures;
        }
        check("arena", &network, &parameters, &genomes, &[u64::from(seed), u64::from(seed) + 1]);
    }

    #[test]
    fn stadium_is_the_same_however_it_is_computed(
        network in network(10, 2), genomes in weights(), together in any::<bool>(), steps in 1u32..60,
    ) {
        let parameters = json!({"field": stadium(), "steps": steps, "update": if together { "simultaneous" } else { "sequential" }});
        check("emergency_exit", &network, &parameters, &genomes, &[0]);
    }
}

#[test]
fn blocks_of_any_size_are_filled_and_none_is_empty() {
    let network = json!({"version": 1, "kind": "layered", "sensors": 4, "actuators": 1, "hidden": [],
        "activation": "tanh", "output_range": [-1, 1]});
    for candidates in [0, 1, 3, 15, 16, 17, 100] {
        let genomes: Vec<f32> = (0..candidates * 5)
            .map(|index| (index as f32 * 0.7).sin())
            .collect();
        for episodes in 0..3 {
            let seeds: Vec<u64> = (0..episodes).collect();
            let fitness = check(
                "minisim",
                &network,
                &json!({"placement": "random"}),
                &genomes,
                &seeds,
            );
            assert_eq!(fitness.len(), candidates * seeds.len());
        }
    }
}

#[test]
fn the_first_weight_that_is_not_finite_is_named() {
    let network = json!({"version": 1, "kind": "layered", "sensors": 4, "actuators": 1, "hidden": [],
        "activation": "tanh", "output_range": [-1, 1]});
    let architecture = Architecture::from_json(&network.to_string()).unwrap();
    let parameters = json!({"maxSteps": 3}).as_object().unwrap().clone();
    for (candidate, index, value) in [
        (0, 0, f32::NAN),
        (63, 4, f32::INFINITY),
        (199, 2, f32::NEG_INFINITY),
    ] {
        let mut genomes = vec![0.5; 200 * 5];
        genomes[candidate * 5 + index] = value;
        genomes[199 * 5 + 4] = f32::NAN;
        for (seeds, threads) in [(&[1][..], 1), (&[1, 2, 3], 1), (&[1], 2), (&[1, 2, 3], 2)] {
            for level in Level::available() {
                let block = Block {
                    architecture: &architecture,
                    genomes: &genomes,
                    parameters: &parameters,
                    seeds,
                    metrics: &[],
                    stop: None,
                };
                let level = Some(level);
                let error = evaluate("minisim", &block, Means { level, threads })
                    .unwrap()
                    .unwrap_err();
                let source = ControllerError::WeightValue { index };
                assert_eq!(error, RolloutError::Weights { candidate, source });
            }
        }
    }
}

/// A fully meshed network for Emergency Exit, and genomes for it.
fn meshed(candidates: usize) -> (Value, Vec<f32>) {
    let network = json!({"version": 1, "kind": "fully_meshed", "sensors": 10, "actuators": 2, "hidden": 2,
        "iterations": 2, "activation": "clamp", "output_range": [0, 1]});
    let genomes = (0..candidates * 60)
        .map(|index| 2.0 * (index as f32 * 0.7).sin())
        .collect();
    (network, genomes)
}

#[test]
fn fields_of_any_shape_hold_their_agents() {
    let (network, genomes) = meshed(20);
    for (width, height) in [(1, 1), (1, 13), (2, 6), (3, 7), (13, 1), (31, 12)] {
        let cells: Vec<[u32; 2]> = (0..height)
            .flat_map(|y| (0..width).map(move |x| [x, y]))
            .collect();
        let every = |n: usize| cells.iter().step_by(n).collect::<Vec<_>>();
        for update in ["sequential", "simultaneous"] {
            let field =
                json!({"width": width, "height": height, "agents": every(3), "exits": every(7)});
            let parameters = json!({"field": field, "steps": 15, "update": update});
            check("emergency_exit", &network, &parameters, &genomes, &[0]);
        }
    }
}

#[test]
fn a_crowd_walks_as_one_by_one() {
    let (network, genomes) = meshed(18);
    let agents: Vec<[u32; 2]> = (0..70)
        .flat_map(|y| (0..70).map(move |x| [x, y]))
        .filter(|[x, y]| (x + 2 * y) % 8 != 0)
        .collect();
    // So many that vectors do not lie side by side.
    assert!(agents.len() > 4096);
    let some = json!([[3, 60], [69, 0]]);
    let many: Vec<[u32; 2]> = (0..350)
        .map(|exit| [exit % 70, 7 + 11 * (exit / 70)])
        .collect();
    for (exits, update) in [
        (&some, "sequential"),
        (&json!(many), "sequential"),
        (&json!(many), "simultaneous"),
    ] {
        let field = json!({"width": 70, "height": 70, "agents": agents, "exits": exits});
        let parameters = json!({"field": field, "steps": 4, "update": update});
        check("emergency_exit", &network, &parameters, &genomes, &[0]);
    }
}

/// A field with an exit in every `spacing`-th column and row, in an order of their own; between four of them are ties.
fn lattice_of_exits() -> impl Strategy<Value = Value> {
    let sides = (20usize..45, 20usize..45);
    (sides, 2usize..7, 0usize..4, 5usize..12, any::<u64>()).prop_map(
        |((width, height), spacing, twice, agents, order)| {
            let cells: Vec<[usize; 2]> = (0..width * height)
                .map(|index| [index % width, index / width])
                .collect();
            let mut exits: Vec<_> = cells
                .iter()
                .filter(|[x, y]| x % spacing + y % spacing == 0)
                .collect();
            exits.sort_by_key(|[x, y]| ((x * 1000 + y) as u64 + 1).wrapping_mul(order | 1));
            // The same cell once more does not count.
            exits.extend_from_within(..twice);
            let agents: Vec<_> = cells.iter().step_by(agents).collect();
            json!({"width": width, "height": height, "agents": agents, "exits": exits})
        },
    )
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(24))]

    #[test]
    fn the_nearest_of_many_exits_is_the_same_in_lanes(
        field in lattice_of_exits(), steps in 1u32..15, update in prop::sample::select(vec!["sequential", "simultaneous"])
    ) {
        let (network, genomes) = meshed(35);
        let parameters = json!({"field": field, "steps": steps, "update": update});
        check("emergency_exit", &network, &parameters, &genomes, &[0]);
    }

    /// Each episode has exits of its own, more than a byte counts.
    #[test]
    fn exits_of_random_fields_are_the_same_in_lanes(exits in 240u32..400, first in any::<u32>()) {
        let (network, genomes) = meshed(7);
        let parameters = json!({"width": 50, "height": 50, "numAgents": 40, "numExits": exits, "numBlockades": 100, "steps": 12});
        let seeds: Vec<u64> = (0..3).map(|episode| u64::from(first) + episode).collect();
        check("emergency_exit", &network, &parameters, &genomes, &seeds);
    }
}

/// At the borders where a number of an exit takes a byte more, the last exit is the nearest one of some agents.
#[test]
fn as_many_exits_as_a_number_holds_and_one_more() {
    let (network, genomes) = meshed(17);
    let mut seen = Vec::new();
    for exits in [0x100usize, 0x101, 0x1_0000, 0x1_0001] {
        let side = if exits > 0x200 { 300 } else { 60 };
        // The last exits lie in the upper rows, where the agents are.
        let field = json!({
            "width": side, "height": side,
            "agents": (0..side / 3).map(|x| [3 * x, 1]).collect::<Vec<_>>(),
            "exits": (0..exits).map(|index| {
                let cell = exits - 1 - index;
                [cell % side, 3 + cell / side]
            }).collect::<Vec<_>>(),
        });
        let parameters = json!({"field": field, "steps": 6});
        seen.push(check(
            "emergency_exit",
            &network,
            &parameters,
            &genomes,
            &[0],
        ));
    }
    assert!(seen.iter().flatten().any(|fitness| *fitness != seen[0][0]));
}

#[test]
fn what_was_prepared_for_one_block_is_not_used_for_another() {
    let (network, genomes) = meshed(3);
    let small = json!({"width": 9, "height": 9, "numAgents": 5, "numBlockades": 9, "steps": 20});
    let mut short = small.clone();
    short["steps"] = json!(1);
    let field = json!({"width": 4, "height": 3, "agents": [[0, 0], [1, 1]], "exits": [[3, 2]]});
    let given = json!({"field": field});
    let mut seen = Vec::new();
    for parameters in [&small, &short, &given, &small, &given] {
        for seeds in [[1, 2], [7, 8]] {
            seen.push(check(
                "emergency_exit",
                &network,
                parameters,
                &genomes,
                &seeds,
            ));
        }
    }
    assert_ne!(seen[0], seen[1]);
    assert_ne!(seen[0], seen[2]);
    assert_eq!(seen[0], seen[6]);
    assert_eq!(seen[1], seen[7]);
    assert_eq!(seen[4], seen[9]);
}

/// Robots that push each other for long: what differs in the last bit of a position soon differs in all. The fitness is a mean
/// of distances to them.
#[test]
fn arenas_full_of_robots_are_the_same_however_they_are_computed() {
    let network = json!({"kind": "evostick", "version": 1, "sensors": 24, "actuators": 2});
    let weight = |index: u32| (index.wrapping_mul(2_654_435_769) >> 8) as f32 / 4_194_304.0 - 2.0;
    let genomes: Vec<f32> = (0..20 * 50).map(weight).collect();
    for (robots, duration, gain) in [(40, 25.0, 1.0), (20, 40.0, 3.0)] {
        let parameters = json!({"robots": robots, "duration": duration, "mission": "cfa"});
        let genomes: Vec<f32> = genomes.iter().map(|weight| weight * gain).collect();
        let fitness = check("arena", &network, &parameters, &genomes, &[1, 2]);
        assert!(fitness.iter().any(|one| *one != fitness[0]));
    }
}

/// Ten million steps of many agents would take many minutes.
#[test]
fn what_is_not_wanted_any_more_ends_within_a_step() {
    let cases = [
        (
            "minisim",
            json!({"maxSteps": 10_000_000, "numAgents": 100, "numDefenders": 0, "speedAgents": 0}),
        ),
        ("emergency_exit", json!({"steps": 10_000_000})),
        ("arena", json!({"duration": 26_000, "robots": 60})),
    ];
    for (title, parameters) in cases {
        let description = create(title).unwrap().description();
        let text = json!({
            "version": 1, "kind": "layered", "sensors": description.sensors, "actuators": description.actuators,
            "hidden": [3], "activation": "tanh", "output_range": [-1, 1]
        });
        let architecture = Architecture::from_json(&text.to_string()).unwrap();
        let genomes = vec![0.0; 100 * architecture.weight_count()];
        let parameters = parameters.as_object().unwrap().clone();
        for level in [None, Some(Level::best())] {
            let stop = AtomicBool::new(false);
            let block = Block {
                architecture: &architecture,
                genomes: &genomes,
                parameters: &parameters,
                seeds: &[1, 2],
                metrics: &[],
                stop: Some(&stop),
            };
            let means = Means { level, threads: 2 };
            let began = Instant::now();
            std::thread::scope(|scope| {
                scope.spawn(|| {
                    std::thread::sleep(Duration::from_millis(200));
                    stop.store(true, Ordering::Relaxed);
                });
                let results = evaluate(title, &block, means).unwrap().unwrap();
                assert_eq!(results.len(), 200);
            });
            let took = began.elapsed();
            assert!(
                took > Duration::from_millis(190),
                "{title}: had no time to begin: {took:?}"
            );
            assert!(
                took < Duration::from_secs(5),
                "{title} by {level:?}: {took:?}"
            );
        }
    }
}
