//! Refused messages: the warnings for the user, and their number.

use crate::common;

use std::time::Instant;

use common::{Alone, SEEDS, tool_in_mode, tool_that_measures, tool_with, work};
use serde_json::{Value, json};
use swarmwright_pool::{Mode, Scheduler};
use swarmwright_protocol::{Evaluated, F64s, ToTool};

fn alone(machine: Scheduler, now: Instant) -> Alone {
    let mut tool = Alone {
        machine,
        now,
        said: Vec::new(),
        warnings: Vec::new(),
    };
    tool.pass(0);
    tool
}

fn told(tool: &Alone, words: &str) -> usize {
    let warnings = tool.warnings.iter().filter(|text| text.contains(words));
    warnings.count()
}

#[test]
fn an_answer_that_was_refused_is_not_no_server() {
    let mut tool = Alone::new(work(1, &SEEDS));
    assert!(tool.machine.found_nothing());
    assert!(tool.machine.describe().ends_with("no server answered"));
    tool.hear("server", &json!({"server": "4"}));
    assert!(!tool.machine.found_nothing());
    let described = tool.machine.describe();
    assert!(described.contains("which was refused"), "{described}");
}

#[test]
fn what_a_server_announces_in_a_wrong_type_is_told_once_and_the_number_that_is_missing_alone() {
    let now = Instant::now();
    let machine = tool_with(Mode::Stepwise, "a", 0, now, |config| {
        (config.demand.sensors, config.demand.actuators) = (None, None);
    });
    let mut tool = alone(machine, now);
    let announced = json!({"version": 1, "modes": ["stepwise"], "sensors": "2", "actuators": 1, "instance": "a"});
    for _ in 0..2 {
        tool.answer(4, Some(&announced));
    }
    let words = "server 4: capabilities.swarmwright: \"sensors\" is \"2\" (a string), expected an integer from 1";
    assert_eq!(told(&tool, words), 1, "{:?}", tool.warnings);
    assert_eq!(tool.machine.sizes(), None);
    assert_eq!(tool.machine.unknown_size(), Some("sensors"));
    // The experiment may give a number that a server does not announce.
    let machine = tool_with(Mode::Stepwise, "a", 0, now, |config| {
        (config.demand.sensors, config.demand.actuators) = (Some(2), None);
    });
    let mut tool = alone(machine, now);
    tool.answer(4, Some(&announced));
    assert_eq!(tool.machine.sizes(), Some((2, 1)));
}

#[test]
fn another_version_of_the_announcement_is_told_once() {
    let mut tool = Alone::new(work(1, &SEEDS));
    for _ in 0..2 {
        tool.answer(
            4,
            Some(&json!({"version": 2, "modes": ["offloaded"], "instance": "a"})),
        );
    }
    assert_eq!(
        told(
            &tool,
            "server 4: capabilities.swarmwright: \"version\" is 2"
        ),
        1
    );
    assert!(tool.machine.has_server());
}

#[test]
fn an_answer_to_a_request_that_was_never_sent_is_told_once() {
    let now = Instant::now();
    let mut tool = alone(tool_in_mode(Mode::Offloaded, "a", 5, now), now);
    for request in [4, 900, 901] {
        let answer = ToTool::Evaluated(Evaluated {
            version: 1,
            request,
            server: 4,
            fitness: F64s(vec![1.0]),
            ..evaluated()
        });
        let now = tool.now;
        tool.machine
            .receive("swarmwright/v1/tool/a", &answer.encode(), false, now);
        tool.collect();
    }
    let words = "server 4 to request 4, which this tool has not sent";
    assert_eq!(told(&tool, words), 1, "{:?}", tool.warnings);
    assert_eq!(told(&tool, "has not sent"), 1, "{:?}", tool.warnings);
}

/// Creates an answer without results.
fn evaluated() -> Evaluated {
    Evaluated {
        version: 1,
        request: 0,
        server: 0,
        fitness: F64s(Vec::new()),
        metrics: std::collections::BTreeMap::new(),
        failed: Vec::new(),
        error: None,
        seconds: 0.0,
    }
}

#[test]
fn of_many_ways_in_which_a_key_is_wrong_a_few_are_told_and_the_others_counted() {
    let mut tool = Alone::new(work(1, &SEEDS));
    for number in 0..50 {
        let text = format!("x{number}");
        tool.hear(
            "sensor",
            &json!({"simulation_hash": "00", "agent": text, "sensor": [1]}),
        );
        tool.hear(
            "sensor",
            &json!({"simulation_hash": "00", "agent": 0, "sensor": text}),
        );
    }
    for key in ["\"agent\"", "\"sensor\""] {
        let found = told(&tool, key);
        assert!((1..=5).contains(&found), "{found}: {:?}", tool.warnings);
    }
    let counted = tool.machine.take_repeated();
    assert_eq!(counted.len(), 2, "{counted:?}");
    assert!(
        counted
            .iter()
            .all(|text| text.contains("of the same kind: "))
    );
}

#[test]
fn a_metric_of_a_wrong_type_is_not_said_to_be_missing() {
    let now = Instant::now();
    for (metrics, words) in [
        (
            json!({"spread": "3"}),
            "\"metrics.spread\": \"3\" (a string) found, expected a number",
        ),
        (json!({}), "the metric spread is missing from the result"),
    ] {
        let mut tool = alone(
            tool_that_measures(&["spread"], Mode::Stepwise, "a", 0, now),
            now,
        );
        tool.machine.submit(work(1, &SEEDS), now);
        tool.pass(0);
        let announced: Value = json!({"version": 1, "modes": ["stepwise"], "metrics": ["spread"]});
        tool.answer(4, Some(&announced));
        tool.pass(100);
        let hash = tool.last("control");
        tool.hear(
            "fitness",
            &json!({"simulation_hash": hash, "fitness": 1, "metrics": metrics}),
        );
        let errors: Vec<String> = tool
            .machine
            .take_journal()
            .into_iter()
            .filter_map(|(attempt, _)| attempt.error)
            .collect();
        assert!(errors.len() == 1 && errors[0].contains(words), "{errors:?}");
    }
}
