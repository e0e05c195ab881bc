//! Which parameters are refused, and how it is said.
#![allow(clippy::unwrap_used, clippy::panic)] // helpers of tests

use serde_json::{Value, json};
use swarmwright_worlds::{Minisim, ParameterReader, Simulation, create, describe, titles};

fn reset(document: &Value) -> Result<Minisim, String> {
    let mut simulation = Minisim::default();
    let result = simulation.reset(document.as_object().unwrap());
    result.map(|()| simulation).map_err(|e| e.to_string())
}

#[test]
fn refuses_with_the_parameter_and_the_cure() {
    for (document, parts) in [
        (
            json!({"mapWidth": "13"}),
            [
                "parameter mapWidth",
                "\"13\" (a string) found, expected a whole number",
            ],
        ),
        (
            json!({"mapWidth": 0}),
            ["parameter mapWidth", "from 1 to 1000000"],
        ),
        (
            json!({"mapHeight": -7}),
            ["parameter mapHeight", "-7 found"],
        ),
        (
            json!({"mapHeight": 7.5}),
            ["parameter mapHeight", "whole number"],
        ),
        (
            json!({"mapHeight": null}),
            ["parameter mapHeight", "null found"],
        ),
        (
            json!({"mapWidth": true}),
            ["parameter mapWidth", "true found"],
        ),
        (
            json!({"mapWidth": 1e300}),
            ["parameter mapWidth", "whole number"],
        ),
        (
            json!({"numAgents": 0}),
            ["parameter numAgents", "from 1 to 100000"],
        ),
        (
            json!({"numAgents": 100_001}),
            ["parameter numAgents", "from 1 to 100000"],
        ),
        (
            json!({"numDefenders": -1}),
            ["parameter numDefenders", "from 0 to 100000"],
        ),
        (
            json!({"speedAgents": -0.1}),
            ["parameter speedAgents", "at least 0"],
        ),
        (
            json!({"speedAgents": 1e39}),
            ["parameter speedAgents", "finite"],
        ),
        (
            json!({"speedDefenders": [1]}),
            ["parameter speedDefenders", "[1] found"],
        ),
        (
            json!({"agents": []}),
            ["parameter agents", "at least one position"],
        ),
        (json!({"agents": 3}), ["parameter agents", "[[x, y], ..]"]),
        (
            json!({"agents": [[1, 2], [3]]}),
            ["parameter agents[1]", "[x, y] of two numbers"],
        ),
        (
            json!({"agents": [[1, 2, 3]]}),
            ["parameter agents[0]", "[1,2,3] found"],
        ),
        (
            json!({"agents": [[1, "2"]]}),
            ["parameter agents[0]", "two numbers"],
        ),
        (
            json!({"agents": [[13.5, 2]]}),
            ["parameter agents[0]", "inside the map, [0, 0] to [13, 7]"],
        ),
        (
            json!({"defenders": [[1, -0.5]]}),
            ["parameter defenders[0]", "inside the map"],
        ),
        (
            json!({"agents": [[1, 2]], "numAgents": 2}),
            ["parameter agents", "1 positions found, but numAgents is 2"],
        ),
        (
            json!({"defenders": [], "numDefenders": 1}),
            ["parameter defenders", "numDefenders is 1"],
        ),
        (
            json!({"goal": [14, 0]}),
            ["parameter goal", "inside the map"],
        ),
        (json!({"goal": "east"}), ["parameter goal", "[x, y]"]),
        (
            json!({"helloMessage": 5}),
            ["parameter helloMessage", "expected a string"],
        ),
        (json!({"stepSize": -1}), ["parameter stepSize", "from 0 to"]),
        (json!({"maxSteps": 0}), ["parameter maxSteps", "from 1 to"]),
        (
            json!({"maxSteps": "many"}),
            ["parameter maxSteps", "a string"],
        ),
        (
            json!({"captureRadius": -1}),
            ["parameter captureRadius", "at least 0"],
        ),
        (
            json!({"goalRadius": {}}),
            ["parameter goalRadius", "{} found"],
        ),
        (
            json!({"placement": "anywhere"}),
            ["parameter placement", "one of \"fixed\", \"random\""],
        ),
        (
            json!({"seed": 1.5}),
            ["parameter seed", "whole number of at most 64 bits"],
        ),
    ] {
        let message = reset(&document).unwrap_err();
        for part in parts {
            assert!(
                message.contains(part),
                "{document}: {message:?} lacks {part:?}"
            );
        }
    }
}

#[test]
fn accepts_what_means_the_same() {
    let scene = |document| reset(&document).unwrap().scene().unwrap();
    let example = scene(json!({}));
    for document in [
        json!({"mapWidth": 13.0, "mapHeight": 7.0, "numAgents": 1.0, "maxSteps": 15.0}),
        json!({"agents": [[0.5, 3.5]], "defenders": [[8, 3.5]]}),
        json!({"goal": [12.5, 3.5], "captureRadius": 0.5, "goalRadius": 0.5, "placement": "fixed", "seed": 0}),
        json!({"unknown": {"to": "this simulation"}}),
    ] {
        assert_eq!(scene(document.clone()), example, "{document}");
    }
    let length = |document, kind| {
        scene(document)
            .bodies
            .iter()
            .filter(|b| b.kind == kind)
            .count()
    };
    assert_eq!(
        length(json!({"agents": [[1, 1], [2, 2]]}), "agent"),
        2,
        "numAgents follows the list"
    );
    assert_eq!(length(json!({"defenders": []}), "defender"), 0);
    for seed in [json!(-1), json!(u64::MAX)] {
        assert_eq!(
            scene(json!({"placement": "random", "seed": seed})),
            scene(json!({"placement": "random", "seed": -1}))
        );
    }
}

#[test]
fn the_largest_swarm_is_possible() {
    let mut swarm =
        reset(&json!({"numAgents": 100_000, "mapHeight": 1000, "maxSteps": 1})).unwrap();
    swarm.step(&vec![0.0; 100_000]);
    assert!(swarm.acting().is_empty() && swarm.fitness() < 0.0);
}

#[test]
fn a_refused_reset_does_not_break_the_next_one() {
    let mut simulation = Minisim::default();
    simulation
        .reset(json!({"maxSteps": 0}).as_object().unwrap())
        .unwrap_err();
    simulation
        .reset(json!({"maxSteps": 1}).as_object().unwrap())
        .unwrap();
    simulation.step(&[0.0]);
    assert!(simulation.acting().is_empty());
}

#[test]
fn every_built_in_simulation_describes_itself() {
    let titles = titles();
    assert!(titles.is_sorted() && titles.contains(&"minisim"));
    assert!(create("minisym").is_none() && describe("minisym", None).is_none());
    for title in titles {
        let simulation = create(title).unwrap();
        let text = simulation.description();
        assert_eq!(text.title, title);
        assert!(!simulation.acting().is_empty(), "{title} is at a start");
        let description = describe(title, None).unwrap().unwrap();
        assert_eq!(
            description["sensors"].as_u64().unwrap(),
            text.sensors as u64
        );
        for (names, count) in [
            ("sensor_names", text.sensors),
            ("actuator_names", text.actuators),
            ("sensor_units", text.sensors),
            ("actuator_units", text.actuators),
        ] {
            assert_eq!(
                description[names].as_array().unwrap().len(),
                count,
                "{title}"
            );
        }
        // The defaults, given, are what is used when they are left out.
        let mut defaults = serde_json::Map::new();
        for (name, info) in description["parameters"].as_object().unwrap() {
            assert!(
                !info["description"].as_str().unwrap().is_empty(),
                "{title}: {name}"
            );
            if !info["default"].is_null() {
                defaults.insert(name.clone(), info["default"].clone());
            }
        }
        let (mut given, mut left_out) = (create(title).unwrap(), create(title).unwrap());
        given.reset(&defaults).unwrap();
        left_out.reset(&serde_json::Map::new()).unwrap();
        assert_eq!(given.scene(), left_out.scene(), "{title}");
        assert_eq!(simulation.scene(), left_out.scene(), "{title}");
    }
}

#[test]
fn reads_numbers_of_any_range_for_other_languages() {
    let document = json!({
        "n": 13.0, "far": -9_007_199_254_740_993_i64, "x": 0.1, "on": true, "list": [1, 2.5], "word": "a", "big": 1e39
    });
    let read = ParameterReader::new(document.as_object().unwrap());
    assert_eq!(read.whole("n", 0, 20), Ok(Some(13)));
    assert_eq!(
        read.whole("far", i64::MIN, 0),
        Ok(Some(-9_007_199_254_740_993))
    );
    assert_eq!(read.number("x", 0.0, 1.0), Ok(Some(0.1)));
    assert_eq!(read.single("x", 0.0, 1.0), Ok(Some(0.1)));
    assert_eq!(read.flag("on"), Ok(Some(true)));
    assert_eq!(
        read.numbers("list", 0..=2, 0.0, 3.0),
        Ok(Some(vec![1.0, 2.5]))
    );
    assert_eq!(read.whole("absent", 0, 1), Ok(None));
    assert_eq!(read.number("absent", 0.0, 1.0), Ok(None));
    assert_eq!(read.numbers("absent", 1..=1, 0.0, 1.0), Ok(None));
    assert_eq!(read.flag("absent"), Ok(None));

    let infinite = f64::INFINITY;
    for (refused, words) in [
        (
            read.whole("n", 0, 12).map(drop),
            "13.0 found, expected a whole number from 0 to 12",
        ),
        (
            read.number("x", 0.5, 1.0).map(drop),
            "0.1 found, expected a number from 0.5 to 1",
        ),
        (
            read.number("word", 0.5, infinite).map(drop),
            "\"a\" (a string) found, expected a finite number of at least 0.5",
        ),
        (
            read.number("x", -infinite, 0.0).map(drop),
            "0.1 found, expected a finite number of at most 0",
        ),
        (
            read.single("big", f32::NEG_INFINITY, f32::INFINITY)
                .map(drop),
            "1e+39 found, expected a finite number",
        ),
        (
            read.flag("n").map(drop),
            "13.0 found, expected true or false",
        ),
        (
            read.numbers("list", 3..=usize::MAX, 0.0, 3.0).map(drop),
            "2 numbers found, expected at least 3",
        ),
        (
            read.numbers("list", 0..=1, 0.0, 3.0).map(drop),
            "2 numbers found, expected at most 1",
        ),
        (
            read.numbers("list", 3..=4, 0.0, 3.0).map(drop),
            "2 numbers found, expected 3 to 4",
        ),
        (
            read.numbers("list", 0..=2, 0.0, 2.0).map(drop),
            "2.5 found, expected a number from 0 to 2",
        ),
        (
            read.numbers("x", 0..=2, 0.0, 2.0).map(drop),
            "0.1 found, expected a list of numbers",
        ),
    ] {
        assert_eq!(refused.map_err(|error| error.reason), Err(words.to_owned()));
    }
}
