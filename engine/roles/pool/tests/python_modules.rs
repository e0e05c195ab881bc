//! Selection of servers for state machines with Python modules.

#![allow(clippy::unwrap_used, reason = "a test")]

use serde_json::json;
use swarmwright_controllers::Architecture;
use swarmwright_pool::{Demand, Mode};
use swarmwright_protocol::{Announcement, Capabilities, ModuleCode, Requirements};

fn demand() -> Demand {
    let document = json!({"version": 1, "kind": "python_modules", "sensors": 9, "actuators": 2, "states": 1,
        "transitions": 1, "behaviours": [{"name": "Spiral", "file": "parts.py", "sha256": "aa11", "parameters": {}}],
        "conditions": [{"name": "black_floor", "parameters": {"probability": [0.0, 1.0, false]}}]});
    let mut demand = Demand {
        simulation: "arena".to_owned(),
        requirements: Requirements {
            dimensions: 2.0,
            max_agents: None,
        },
        sensors: None,
        actuators: None,
        mode: Mode::Auto,
        kind: None,
        modules: Vec::new(),
        metrics: Vec::new(),
    };
    let architecture = Architecture::from_json(&document.to_string()).unwrap();
    demand.set_controllers(Some("python_modules"), &architecture);
    demand
}

fn announced(controllers: &[&str], sha256: &[&str]) -> Capabilities {
    let texts = |texts: &[&str]| texts.iter().map(ToString::to_string).collect();
    let module = |sha256: &&str| ModuleCode {
        role: "behaviour".to_owned(),
        name: "Spiral".to_owned(),
        file: Some("parts.py".to_owned()),
        sha256: Some((*sha256).to_owned()),
    };
    Capabilities {
        dimensions: 2.0,
        max_agents: None,
        swarmwright: Some(Announcement {
            version: 1,
            modes: texts(&["stepwise", "batched", "offloaded"]),
            controllers: texts(controllers),
            modules: sha256.iter().map(module).collect(),
            ..Announcement::default()
        }),
    }
}

fn misfit(capabilities: &Capabilities) -> Option<String> {
    demand().misfit(&["arena".to_owned()], capabilities)
}

#[test]
fn servers_that_have_the_code_are_used() {
    let fits = announced(&["modules", "python_modules"], &["bb22", "aa11"]);
    assert_eq!(misfit(&fits), None);
}

#[test]
fn servers_without_it_are_not_used_stepwise_either() {
    let d61 = Capabilities {
        dimensions: 2.0,
        max_agents: None,
        swarmwright: None,
    };
    let missing = "has no behaviour 'parts.py:Spiral'; start it with --modules parts.py:Spiral";
    assert_eq!(misfit(&d61).as_deref(), Some(missing));
    assert_eq!(
        misfit(&announced(&["modules"], &[])).as_deref(),
        Some(missing)
    );
    let other = misfit(&announced(&["modules", "python_modules"], &["bb22"])).unwrap();
    assert!(
        other.starts_with("has different code for behaviour 'parts.py:Spiral'"),
        "{other}"
    );
    // The server has the code, but does not announce the kind of controller.
    let odd = misfit(&announced(&["modules"], &["aa11"])).unwrap();
    assert!(odd.contains("of kind python_modules"), "{odd}");
}

#[test]
fn controllers_of_the_engine_need_none() {
    let mut demand = demand();
    let layered = json!({"version": 1, "kind": "layered", "sensors": 9, "actuators": 2, "hidden": [],
        "activation": "tanh", "output_range": [-1, 1]});
    let architecture = Architecture::from_json(&layered.to_string()).unwrap();
    demand.set_controllers(Some("layered"), &architecture);
    let capabilities = announced(&["layered"], &[]);
    assert_eq!(demand.misfit(&["arena".to_owned()], &capabilities), None);
}
