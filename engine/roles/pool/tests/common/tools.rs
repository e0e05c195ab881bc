//! Tools and servers for conversations.

use std::time::{Duration, Instant};

use serde_json::Map;
use swarmwright_pool::{Config, Demand, Faults, Mode, Scheduler, Timeouts};
use swarmwright_protocol::{Requirements, Topics};
use swarmwright_wrapper::{Identity, Machine as ServerMachine};

use super::Line;

/// Creates a tool in stepwise mode.
pub fn tool(name: &str, first_instance: u64, now: Instant) -> Scheduler {
    tool_in_mode(Mode::Stepwise, name, first_instance, now)
}

pub fn tool_in_mode(mode: Mode, name: &str, first_instance: u64, now: Instant) -> Scheduler {
    tool_that_measures(&[], mode, name, first_instance, now)
}

/// Creates a tool with a modified configuration.
pub fn tool_with(
    mode: Mode,
    name: &str,
    first_instance: u64,
    now: Instant,
    change: impl FnOnce(&mut Config),
) -> Scheduler {
    let mut config = config(&[], mode, name, first_instance);
    change(&mut config);
    Scheduler::new(config, now)
}

/// Creates a tool that needs these metrics of every episode.
pub fn tool_that_measures(
    metrics: &[&str],
    mode: Mode,
    name: &str,
    first_instance: u64,
    now: Instant,
) -> Scheduler {
    let config = config(metrics, mode, name, first_instance);
    Scheduler::new(config, now)
}

pub fn tool_with_faults(
    faults: Faults,
    name: &str,
    first_instance: u64,
    now: Instant,
) -> Scheduler {
    let config = config(&[], Mode::Auto, name, first_instance);
    Scheduler::new(Config { faults, ..config }, now)
}

fn config(metrics: &[&str], mode: Mode, name: &str, first_instance: u64) -> Config {
    let mut parameters = Map::new();
    parameters.insert("numAgents".into(), 5.into());
    Config {
        demand: Demand {
            simulation: "line".into(),
            requirements: Requirements {
                dimensions: 2.0,
                max_agents: Some(5.0),
            },
            sensors: Some(2),
            actuators: Some(1),
            mode,
            kind: None,
            modules: Vec::new(),
            metrics: metrics.iter().map(ToString::to_string).collect(),
        },
        parameters,
        tool: name.into(),
        token: name.into(),
        topics: Topics::default(),
        visual: false,
        timeouts: Timeouts {
            step: Duration::from_secs(10),
            ..Timeouts::default()
        },
        faults: Faults::default(),
        largest: usize::MAX,
        probation: Duration::from_millis(30),
        first_instance,
    }
}

pub fn server(id: u64, simulation: Line) -> ServerMachine {
    ServerMachine::new(
        Identity::new(id),
        vec![Box::new(simulation)],
        Topics::default(),
        Duration::from_secs(20),
    )
}
