//! Parameter sets: every episode uses its candidate's values in every mode, and a server that asks for steering is not
//! used.

#![allow(clippy::panic, clippy::unwrap_used, reason = "a test")]

use crate::common;

use common::{Line, Net, Party, server, tool_in_mode};
use serde_json::{Value, json};
use swarmwright_pool::{Mode, Work};

const SEEDS: [u64; 2] = [3, 9];

fn work(name: &str, candidates: u8) -> Work {
    let specification = json!({"version": 1, "kind": "parameter_set", "parameters": [{"name": name, "type": "real"}]});
    let genomes = (0..candidates).map(|candidate| f32::from(candidate) / 8.0);
    Work::new(
        &specification.to_string(),
        genomes.collect(),
        SEEDS.to_vec(),
    )
    .unwrap()
}

fn begin(net: &mut Net, mode: Mode, work: Work) -> usize {
    let tool = tool_in_mode(mode, "a", 0, net.now);
    let index = net.add(Party::Tool(Box::new(tool)));
    net.submit(index, work);
    index
}

/// Returns the fitness for five agents with 3, 4, 5, 6 and 3 steps of speed and seed, weighted 1 to 5; all values are
/// exact.
fn expected(candidates: u8) -> Vec<f64> {
    let steps = [3.0, 4.0, 5.0, 6.0, 3.0];
    let weighted: f64 = (1..)
        .zip(steps)
        .map(|(weight, steps)| f64::from(weight) * steps)
        .sum();
    (0..candidates)
        .flat_map(|candidate| {
            SEEDS.map(|seed| (f64::from(candidate) / 8.0 + seed as f64) * weighted)
        })
        .collect()
}

#[test]
fn results_do_not_depend_on_how_and_by_whom_they_are_computed() {
    for (random, mode) in [Mode::Stepwise, Mode::Batched, Mode::Offloaded, Mode::Auto]
        .into_iter()
        .enumerate()
    {
        for servers in 1..4 {
            let mut net = Net::new(random as u64);
            for id in 0..servers {
                net.add(Party::Server(Box::new(server(id, Line::new()))));
            }
            let index = begin(&mut net, mode, work("speed", 20));
            assert_eq!(net.finish(index), expected(20), "{mode}, {servers} servers");
            assert_eq!(net.warnings, Vec::<String>::new(), "{mode}");
        }
    }
}

#[test]
fn a_server_that_knows_only_the_seed_profile_gets_the_values_with_a_hash_of_their_own() {
    let mut net = Net::new(1);
    net.add_seed_only(1);
    let index = begin(&mut net, Mode::Auto, work("speed", 5));
    assert_eq!(net.finish(index), expected(5));
    let messages: Vec<Value> = net
        .log
        .iter()
        .filter(|message| message.topic == "parameters")
        .map(|message| serde_json::from_slice(&message.payload).unwrap())
        .collect();
    let speeds: Vec<&Value> = messages.iter().map(|message| &message["speed"]).collect();
    let wanted = [0.0, 0.0, 0.125, 0.125, 0.25, 0.25, 0.375, 0.375, 0.5, 0.5];
    assert_eq!(json!(speeds), json!(wanted));
    let mut hashes: Vec<&str> = messages
        .iter()
        .filter_map(|m| m["simulation_hash"].as_str())
        .collect();
    hashes.sort_unstable();
    hashes.dedup();
    assert_eq!(hashes.len(), wanted.len());
    assert!(net.log.iter().all(|message| message.topic != "sensor"));
}

#[test]
fn a_server_that_asks_for_steering_is_not_used_and_the_reason_is_told() {
    for mode in [Mode::Stepwise, Mode::Batched, Mode::Offloaded] {
        let mut net = Net::new(2);
        net.add(Party::Server(Box::new(server(1, Line::new()))));
        // Only `speed` makes the agents of this simulation steer themselves.
        let index = begin(&mut net, mode, work("haste", 3));
        let mut reason = None;
        for _ in 0..1000 {
            net.turn();
            let now = net.now;
            reason = reason.or_else(|| net.tool(index).rejected(now));
        }
        let reason = reason.unwrap_or_else(|| panic!("{mode}: {:?}", net.warnings));
        assert!(
            reason.contains("a parameter set steers no agents"),
            "{mode}: {reason}"
        );
        assert!(reason.contains("server 1"), "{mode}: {reason}");
    }
}
