//! Brokers that end connections on large messages without having announced a limit.

#![allow(clippy::panic, reason = "a test")]

use crate::common;

use common::{Extended, Line, Net, Party, server, tool, tool_with, work};
use swarmwright_pool::{Mode, Work};

const SEEDS: [u64; 3] = [3, 4, 9];
const BATCHED: &[&str] = &["stepwise", "batched"];
const OFFLOADED: &[&str] = &["stepwise", "offloaded"];

fn undisturbed(candidates: usize) -> Vec<f64> {
    let mut net = Net::new(0);
    let now = net.now;
    let index = net.add(Party::Tool(Box::new(tool("a", 0, now))));
    net.add(Party::Server(Box::new(server(1, Line::new()))));
    net.submit(index, work(candidates, &SEEDS));
    net.finish(index)
}

/// Creates a net with two servers and a tool on a broker that accepts this many bytes.
fn narrow(
    takes: usize,
    modes: &[&'static str],
    change: impl Fn(&mut Extended),
    agents: u32,
) -> (Net, usize) {
    let mut net = Net::new(5);
    net.takes = takes;
    for id in [1, 2] {
        let mut server = Extended {
            batch: 64,
            ..Extended::new(id, modes)
        };
        change(&mut server);
        net.add(Party::Extended(Box::new(server)));
    }
    let tool = tool_with(Mode::Auto, "a", 0, net.now, |config| {
        config.parameters.insert("numAgents".into(), agents.into());
    });
    let index = net.add(Party::Tool(Box::new(tool)));
    (net, index)
}

/// Returns the warnings about the limit.
fn told(net: &Net) -> Vec<&String> {
    let of_it = |text: &&String| text.contains("max_packet_size");
    net.warnings.iter().filter(of_it).collect()
}

#[test]
fn batches_are_made_smaller_when_servers_messages_end_their_connections() {
    // 64 episodes of 5 agents take some 5 kB.
    let (mut net, index) = narrow(2000, BATCHED, |_| {}, 5);
    net.submit(index, work(300, &SEEDS));
    assert_eq!(net.finish(index), undisturbed(300));
    assert!((2..=6).contains(&net.cuts), "{}", net.cuts);
    let told = told(&net);
    assert!(
        told.len() == 1 && told[0].contains("batches have 15 episodes at most"),
        "{told:?}"
    );
    assert_eq!(net.tool(index).counts().quarantined, 0);
}

#[test]
fn a_server_that_crashes_is_not_taken_for_one_whose_message_was_too_large() {
    let (mut net, index) = narrow(2000, BATCHED, |server| server.crashes = true, 5);
    net.submit(index, work(60, &SEEDS));
    assert_eq!(net.finish(index), undisturbed(60));
    assert!(net.cuts >= 4, "{}", net.cuts);
    assert_eq!(told(&net), Vec::<&String>::new());
    assert!(net.tool(index).counts().server_failures >= 4);
}

#[test]
fn blocks_are_made_smaller_when_they_or_their_results_end_connections() {
    for takes in [3000, 8000] {
        let (mut net, index) = narrow(takes, OFFLOADED, |server| server.pace /= 1000, 5);
        net.submit(index, work(3000, &SEEDS));
        assert_eq!(net.finish(index), undisturbed(3000));
        assert!((2..=12).contains(&net.cuts), "{takes} {}", net.cuts);
        let told = told(&net);
        assert_eq!(told.len(), 1, "{told:?}");
    }
}

fn until_hopeless(net: &mut Net, index: usize) -> String {
    for _ in 0..100_000 {
        if let Some(reason) = net.tool(index).hopeless() {
            return reason.to_owned();
        }
        assert!(!net.tool(index).finished(), "{:?}", net.warnings);
        net.turn();
    }
    panic!("no end in sight: {:?}", net.warnings);
}

#[test]
fn a_candidate_that_is_larger_than_the_broker_takes_is_hopeless() {
    let wide = r#"{"version": 1, "kind": "layered", "sensors": 2, "actuators": 1, "hidden": [1000],
        "activation": "tanh", "output_range": [-1, 1]}"#;
    let weights = 4001;
    let wide = Work::new(wide, vec![0.5; 20 * weights], SEEDS.to_vec()).unwrap();
    let (mut net, index) = narrow(9000, OFFLOADED, |_| {}, 5);
    net.submit(index, wide);
    let reason = until_hopeless(&mut net, index);
    assert!(net.cuts <= 7, "{}", net.cuts);
    assert!(
        reason.contains("on every packet of 16") && reason.contains("max_packet_size"),
        "{reason}"
    );
    // Other work may be small enough.
    net.submit(index, work(20, &SEEDS));
    assert_eq!(net.tool(index).hopeless(), None);
    assert_eq!(net.finish(index), undisturbed(20));
}

#[test]
fn a_step_of_one_episode_that_is_larger_than_the_broker_takes_is_hopeless() {
    // A step of 100 agents takes 1600 bytes.
    let (mut net, index) = narrow(1500, BATCHED, |_| {}, 100);
    net.submit(index, work(20, &SEEDS));
    let reason = until_hopeless(&mut net, index);
    assert!(net.cuts <= 12, "{}", net.cuts);
    assert!(
        reason.contains("servers' connections on every message of about 1600 bytes"),
        "{reason}"
    );
    assert_eq!(net.tool(index).counts().quarantined, 0);
}
