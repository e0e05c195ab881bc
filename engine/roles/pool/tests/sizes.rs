//! Servers that announce different numbers of sensors or actuators for one simulation.

use crate::common;

use std::time::Instant;

use common::{Alone, SEEDS, tool_with, work};
use serde_json::{Value, json};
use swarmwright_pool::Mode;

/// Creates a tool whose experiment does not give the numbers of sensors and actuators.
fn tool() -> Alone {
    let now = Instant::now();
    let machine = tool_with(Mode::Stepwise, "a", 0, now, |config| {
        (config.demand.sensors, config.demand.actuators) = (None, None);
    });
    let mut tool = Alone {
        machine,
        now,
        said: Vec::new(),
        warnings: Vec::new(),
    };
    tool.pass(0);
    tool
}

fn announced(instance: &str, sensors: u64, actuators: u64) -> Value {
    json!({"version": 1, "modes": ["stepwise"], "instance": instance, "sensors": sensors, "actuators": actuators})
}

/// Returns the servers that have work.
fn used(tool: &Alone) -> Vec<u64> {
    (1..9)
        .filter(|id| !tool.machine.has_nothing_on(*id))
        .collect()
}

fn submit(tool: &mut Alone) {
    let now = tool.now;
    tool.machine.submit(work(7, &SEEDS), now);
    tool.collect();
    tool.pass(40);
}

#[test]
fn servers_that_differ_from_most_are_not_used_and_named() {
    let mut tool = tool();
    tool.answer(1, Some(&announced("a", 3, 1)));
    tool.answer(2, Some(&announced("b", 2, 1)));
    tool.answer(3, Some(&announced("c", 2, 1)));
    // A server that announces no numbers is accepted.
    tool.answer(4, None);
    submit(&mut tool);
    assert_eq!(used(&tool), [2, 3, 4]);
    assert_eq!(tool.machine.sizes(), Some((2, 1)));
    let told = "server 1 is not used: it announces 3 sensors, but this run has 2, as announced by server 2";
    assert!(
        tool.warnings.len() == 1 && tool.warnings[0].starts_with(told),
        "{:?}",
        tool.warnings
    );
    assert!(
        tool.machine
            .describe()
            .contains("server 1: announces 3 sensors"),
        "{}",
        tool.machine.describe()
    );
}

#[test]
fn a_server_that_comes_later_differs_from_those_of_the_run() {
    let mut tool = tool();
    tool.answer(1, Some(&announced("a", 2, 1)));
    submit(&mut tool);
    tool.reconnect();
    tool.pass(100);
    for _ in 0..2 {
        tool.answer(2, Some(&announced("b", 2, 4)));
    }
    assert!(!tool.machine.has_server());
    let told = "server 2 answered, but announces 4 actuators, but this run has 1, as announced by server 1";
    let told = tool.warnings.iter().filter(|text| text.starts_with(told));
    assert_eq!(told.count(), 1, "{:?}", tool.warnings);
    tool.answer(3, Some(&announced("c", 2, 1)));
    assert!(tool.machine.has_server());
}

#[test]
fn the_first_server_of_a_run_says_how_many_there_are() {
    let mut tool = tool();
    submit(&mut tool);
    tool.answer(5, Some(&announced("a", 2, 1)));
    tool.answer(6, Some(&announced("b", 3, 1)));
    tool.pass(40);
    assert_eq!(used(&tool), [5]);
}
