//! Agents with controllers of their own give the same bits in lanes as one episode at a time.
#![allow(clippy::unwrap_used)] // helpers of tests

use proptest::prelude::*;
use serde_json::{Value, json};
use swarmwright_controllers::Architecture;
use swarmwright_lanes::Level;
use swarmwright_worlds::{Block, Means, RolloutError, evaluate};

use crate::lanes::{arena, check, emergency_exit, minisim, network, weights};

/// A team whose last group has all agents that are left.
fn team(groups: &[(u32, Value)]) -> Value {
    let last = groups.len() - 1;
    let groups = groups.iter().enumerate();
    let groups: Vec<Value> = groups
        .map(|(index, (agents, controller))| {
            let agents = (index != last).then_some(agents);
            json!({"name": format!("group {index}"), "agents": agents, "controller": controller})
        })
        .collect();
    json!({"version": 1, "kind": "team", "groups": groups})
}

/// Two or three groups, of which one at least has all sensors and actuators, and others may have fewer.
fn teams(sensors: usize, actuators: usize, fewer: bool) -> BoxedStrategy<Value> {
    let least = |most: usize| if fewer { 1 } else { most };
    let other = (least(sensors)..=sensors, least(actuators)..=actuators)
        .prop_flat_map(|(sensors, actuators)| network(sensors, actuators));
    let others = prop::collection::vec((0u32..5, other), 1..3);
    (others, 0u32..5, network(sensors, actuators), 0usize..3)
        .prop_map(|(mut groups, agents, whole, at)| {
            groups.insert(at.min(groups.len()), (agents, whole));
            team(&groups)
        })
        .boxed()
}

/// Different weights for each of some candidates, however long they are.
fn genomes(architecture: &Value, weights: &[f32]) -> Vec<f32> {
    let architecture = Architecture::from_json(&architecture.to_string()).unwrap();
    let count = (6 * architecture.weight_count()).max(weights.len());
    weights.iter().copied().cycle().take(count).collect()
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(32))]

    #[test]
    fn minisim_is_the_same_with_teams(
        team in teams(4, 1, true), parameters in minisim(), weights in weights(), seed in any::<u32>(),
    ) {
        check("minisim", &team, &parameters, &genomes(&team, &weights), &[u64::from(seed), 3]);
    }

    #[test]
    fn defenders_that_are_steered_are_the_same(
        agents in network(4, 1), defenders in network(4, 1), parameters in minisim(), weights in weights(), seed in any::<u32>(),
    ) {
        let mut parameters = parameters;
        parameters["defenderSteering"] = json!("controller");
        let seeds = [u64::from(seed), 3];
        // Without a team all have the controller of the agents.
        check("minisim", &agents, &parameters, &weights, &seeds);
        let team = json!({"version": 1, "kind": "team", "groups": [
            {"name": "agents", "agents": parameters["numAgents"], "controller": agents},
            {"name": "defenders", "agents": parameters["numDefenders"], "controller": defenders}]});
        check("minisim", &team, &parameters, &genomes(&team, &weights), &seeds);
    }

    #[test]
    fn emergency_exit_is_the_same_with_teams(
        team in any::<bool>().prop_flat_map(|fewer| teams(10, 2, fewer)), parameters in emergency_exit(), weights in weights(),
        seed in any::<u32>(),
    ) {
        check("emergency_exit", &team, &parameters, &genomes(&team, &weights), &[u64::from(seed), 3]);
    }

    #[test]
    fn arena_is_the_same_with_teams(
        team in teams(24, 2, true), parameters in arena(), weights in weights(), seed in any::<u32>(),
    ) {
        check("arena", &team, &parameters, &genomes(&team, &weights), &[u64::from(seed), 3]);
    }
}

/// Many agents and defenders, which look at each other in parts.
#[test]
fn crowds_are_the_same_with_teams() {
    let layered = |hidden: usize| {
        json!({"version": 1, "kind": "layered", "sensors": 4, "actuators": 1, "hidden": [hidden],
            "activation": "tanh", "output_range": [-1, 1]})
    };
    let weights: Vec<f32> = (0..997).map(|index| (index as f32 * 0.7).sin()).collect();
    let parameters = json!({"numAgents": 75, "numDefenders": 40, "placement": "random", "mapWidth": 40, "mapHeight": 30});
    let groups = team(&[(50, layered(2)), (0, layered(1)), (0, layered(3))]);
    check(
        "minisim",
        &groups,
        &parameters,
        &genomes(&groups, &weights),
        &[1, 2, 3],
    );
    let mut steered = parameters;
    steered["defenderSteering"] = json!("controller");
    let sides = json!({"version": 1, "kind": "team", "groups": [
        {"name": "agents", "agents": 75, "controller": layered(4)},
        {"name": "defenders", "agents": null, "controller": layered(2)}]});
    check(
        "minisim",
        &sides,
        &steered,
        &genomes(&sides, &weights),
        &[1, 2, 3],
    );
}

#[test]
fn what_is_wrong_with_a_team_does_not_depend_on_lanes() {
    let network = json!({"version": 1, "kind": "layered", "sensors": 4, "actuators": 1, "hidden": [],
        "activation": "tanh", "output_range": [-1, 1]});
    let sides = |names: [&str; 2], counts: [Value; 2]| {
        json!({"version": 1, "kind": "team", "groups": [
            {"name": names[0], "agents": counts[0], "controller": network},
            {"name": names[1], "agents": counts[1], "controller": network}]})
    };
    let steered = json!({"defenderSteering": "controller", "numAgents": 3, "numDefenders": 2});
    for (team, parameters, message) in [
        (
            sides(["agents", "guards"], [json!(3), json!(2)]),
            &steered,
            "agents, guards found, but there are agents, defenders",
        ),
        (
            sides(["agents", "defenders"], [json!(2), json!(2)]),
            &steered,
            "agents has 2 agents, but there are 3",
        ),
        (
            sides(["agents", "defenders"], [json!(3), json!(9)]),
            &steered,
            "defenders has 9 agents, but there are 2",
        ),
        (
            sides(["a", "b"], [json!(1), json!(1)]),
            &json!({"numAgents": 3}),
            "agent 2 belongs to no group",
        ),
    ] {
        let architecture = Architecture::from_json(&team.to_string()).unwrap();
        let block = Block {
            architecture: &architecture,
            genomes: &vec![0.5; 20 * architecture.weight_count()],
            parameters: parameters.as_object().unwrap(),
            seeds: &[1, 2],
            metrics: &[],
            stop: None,
        };
        let wrong = |level| -> RolloutError {
            let means = Means { level, threads: 1 };
            evaluate("minisim", &block, means).unwrap().unwrap_err()
        };
        let expected = wrong(None);
        assert!(expected.to_string().contains(message), "{expected}");
        assert_eq!(wrong(Some(Level::best())), expected);
    }
}
