//! Teams: agents get the controllers of their groups, with the group's part of the weights.
#![allow(clippy::unwrap_used, clippy::panic)] // helpers of tests

use serde_json::{Value, json};
use swarmwright_controllers::{
    Architecture, Controller, ControllerError, KINDS, Specification, SwarmControllers,
};

fn layered(sensors: usize, actuators: usize) -> Value {
    json!({"version": 1, "kind": "layered", "sensors": sensors, "actuators": actuators, "hidden": [],
        "activation": "linear", "output_range": [-1.0, 1.0]})
}

fn team(agents: &Value) -> Value {
    json!({"version": 1, "kind": "team", "groups": [
        {"name": "hunters", "agents": 2, "controller": layered(1, 2)},
        {"name": "prey", "agents": agents, "controller": layered(2, 1)}]})
}

/// Two hunters with 4 weights, then prey with 3.
fn controller(agents: &Value) -> Controller {
    let mut document = team(agents);
    document["weights"] = json!([0.25, 0.0, 0.5, 0.0, 0.0, 0.5, -0.5]);
    Controller::new(&document.to_string().parse::<Specification>().unwrap())
}

#[test]
fn each_agent_has_the_controller_of_its_group() {
    let whole = controller(&json!(null));
    assert_eq!((whole.sensors(), whole.actuators()), (2, 2));
    for agent in [0, 1] {
        let mut hunter = whole.of_agent(agent).unwrap();
        let mut actuators = [9.0; 2];
        hunter.step(&[0.5], &mut actuators).unwrap();
        assert_eq!(actuators, [0.25, 0.5]);
        // A row as long as that of the agent with the most.
        hunter.step(&[0.5, 7.0], &mut actuators).unwrap();
        assert_eq!(actuators, [0.25, 0.5]);
    }
    for agent in [2, 3, 1_000_000] {
        let mut prey = whole.of_agent(agent).unwrap();
        let mut one = [9.0];
        prey.step(&[1.0, 0.5], &mut one).unwrap();
        assert_eq!(one, [0.25]);
        let mut two = [9.0; 2];
        prey.step(&[1.0, 0.5], &mut two).unwrap();
        assert_eq!(two, [0.25, 0.0]);
        assert!(prey.step(&[1.0], &mut one).is_err());
    }
    assert_eq!(
        whole.of_agent(2).unwrap().specification().weights(),
        [0.0, 0.5, -0.5]
    );
}

#[test]
fn a_team_itself_steers_nobody_and_has_so_many_agents() {
    let mut whole = controller(&json!(3));
    assert_eq!(
        whole.step(&[0.0; 2], &mut [0.0; 2]),
        Err(ControllerError::NoAgent)
    );
    assert!(whole.of_agent(4).is_ok());
    let message = whole.of_agent(5).unwrap_err().to_string();
    assert!(message.contains("agent 5 belongs to no group"), "{message}");
    assert!(message.contains("5 agents, from 0 to 4"), "{message}");
}

#[test]
fn states_of_a_team_are_those_of_its_machines() {
    // Two states, one sensor without thresholds, no actuators but one: from 0 to 1, and back.
    let machine = json!({"version": 1, "kind": "mealy_fsm", "sensors": 1, "actuators": 1, "states": 2,
        "thresholds": [[]]});
    let team = |first: &Value, last: &Value, weights: &[f32]| {
        let document = json!({"version": 1, "kind": "team", "weights": weights, "groups": [
            {"name": "first", "agents": 2, "controller": first},
            {"name": "last", "agents": null, "controller": last}]});
        let specification: Specification = document.to_string().parse().unwrap();
        SwarmControllers::new(Controller::new(&specification))
    };
    let network = layered(1, 1);
    let mut swarm = team(&network, &machine, &[0.0, 0.5, 1.0, 0.5, 0.0, 0.5]);
    assert_eq!(swarm.machine_states(), Some(vec![-1, -1, 0]));
    for agent in [0, 4] {
        swarm.of(agent).unwrap().step(&[0.0], &mut [0.0]).unwrap();
    }
    assert_eq!(swarm.machine_states(), Some(vec![-1, -1, 0, 0, 1]));
    let mut swarm = team(&machine, &network, &[1.0, 0.5, 0.0, 0.5, 0.0, 0.5]);
    assert_eq!(swarm.machine_states(), Some(vec![0, 0, -1]));
    swarm.of(1).unwrap().step(&[0.0], &mut [0.0]).unwrap();
    assert_eq!(swarm.machine_states(), Some(vec![0, 1, -1]));
    let none = team(&network, &network, &[0.0; 4]);
    assert_eq!(none.machine_states(), None);
}

#[test]
fn a_team_is_written_as_it_is_read() {
    for agents in [json!(3), json!(null)] {
        let specification = controller(&agents).specification();
        assert_eq!(specification.weight_count(), 7);
        let written = serde_json::to_value(&specification).unwrap();
        assert_eq!(written["groups"][0], team(&agents)["groups"][0]);
        assert_eq!(
            written.to_string().parse::<Specification>().unwrap(),
            specification
        );
    }
    assert!(
        !KINDS.contains(&"team"),
        "agents have the kinds of its parts"
    );
}

#[test]
fn what_is_wrong_is_said_with_its_place() {
    let refused = |change: &dyn Fn(&mut Value)| {
        let mut document = team(&json!(1));
        change(&mut document);
        Architecture::from_json(&document.to_string())
            .unwrap_err()
            .to_string()
    };
    type Change<'a> = &'a dyn Fn(&mut Value);
    let cases: [(Change, &str); 8] = [
        (&|d| d["groups"] = json!([]), "controller.groups: 0 found"),
        (
            &|d| d["groups"][1]["name"] = json!("hunters"),
            "controller.groups[1].name: \"hunters\" is given twice",
        ),
        (
            &|d| d["groups"][0]["agents"] = json!(null),
            "controller.groups[0].agents: null found",
        ),
        (
            &|d| d["groups"][0]["agents"] = json!(-1),
            "controller.groups[0].agents: -1 found",
        ),
        (
            &|d| d["groups"][0]["count"] = json!(1),
            "controller.groups[0].count: is unknown",
        ),
        (
            &|d| d["groups"][0]["controller"]["hidden"] = json!([0]),
            "controller.groups[0].controller.hidden[0]: 0 found",
        ),
        (
            &|d| d["groups"][1]["controller"] = team(&json!(1)),
            "controller.groups[1].controller.kind: a team consists",
        ),
        (
            &|d| d["groups"][1]["controller"] = json!({"version": 1, "kind": "parameter_set", "parameters": [{"name": "a", "type": "real"}]}),
            "controller.groups[1].controller.kind: a team consists",
        ),
    ];
    for (change, expected) in cases {
        let message = refused(change);
        assert!(message.starts_with(expected), "{message}");
    }
}
