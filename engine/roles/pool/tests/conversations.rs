//! Whole conversations between optimization tools and servers, in any order of arrival.

use crate::common;

use std::time::Duration;

use common::{Line, Net, Party, server, tool, work};
use proptest::prelude::*;
use swarmwright_protocol::{Message, Topic};

const SEEDS: [u64; 2] = [3, 4];

fn undisturbed() -> Vec<f64> {
    let mut net = Net::new(0);
    let now = net.now;
    let index = net.add(Party::Tool(Box::new(tool("a", 0, now))));
    net.add(Party::Server(Box::new(server(1, Line::new()))));
    net.submit(index, work(7, &SEEDS));
    net.finish(index)
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(64))]

    #[test]
    fn outcomes_do_not_depend_on_servers_or_order_of_arrival(servers in 1u64..10, random in any::<u64>()) {
        let mut net = Net::new(random);
        let now = net.now;
        for id in 0..servers {
            net.add(Party::Server(Box::new(server(id, Line::new()))));
        }
        let index = net.add(Party::Tool(Box::new(tool("a", 0, now))));
        net.submit(index, work(7, &SEEDS));
        prop_assert_eq!(net.finish(index), undisturbed());
        prop_assert!(net.warnings.is_empty(), "{:?}", net.warnings);
    }

    #[test]
    fn tools_that_share_servers_do_not_disturb_each_other(servers in 1u64..4, random in any::<u64>()) {
        let mut net = Net::new(random);
        let now = net.now;
        for id in 0..servers {
            net.add(Party::Server(Box::new(server(id, Line::new()))));
        }
        let first = net.add(Party::Tool(Box::new(tool("a", 0, now))));
        let second = net.add(Party::Tool(Box::new(tool("b", 1 << 40, now))));
        net.submit(first, work(7, &SEEDS));
        net.submit(second, work(7, &SEEDS));
        prop_assert_eq!(net.finish(first), undisturbed());
        net.tool(first).release();
        net.collect(first);
        prop_assert_eq!(net.finish(second), undisturbed());
        // The second tool of a server notices this before the step time-out.
        prop_assert!(net.now - now < Duration::from_secs(20), "{:?}: {:?}", net.now - now, net.warnings);
    }

    #[test]
    fn a_server_that_stops_in_any_moment_costs_nothing_but_time(after in 0usize..400, random in any::<u64>()) {
        let mut net = Net::new(random);
        let now = net.now;
        let doomed = net.add(Party::Server(Box::new(server(1, Line::new()))));
        net.add(Party::Server(Box::new(server(2, Line::new()))));
        let index = net.add(Party::Tool(Box::new(tool("a", 0, now))));
        net.submit(index, work(7, &SEEDS));
        for _ in 0..after {
            net.turn();
        }
        net.parties[doomed] = Party::Gone;
        prop_assert_eq!(net.finish(index), undisturbed());
    }

    #[test]
    fn junk_and_strangers_change_nothing(junk in prop::collection::vec((0usize..8, prop::collection::vec(any::<u8>(), 0..60)), 1..40), random in any::<u64>()) {
        let mut net = Net::new(random);
        let now = net.now;
        net.add(Party::Server(Box::new(server(1, Line::new()))));
        let index = net.add(Party::Tool(Box::new(tool("a", 0, now))));
        let stranger = net.add(Party::Gone);
        for (topic, payload) in junk {
            let topic = Topic::SEED.get(topic).map_or("swarmwright/v1/presence/1", |topic| topic.name());
            net.publish(stranger, topic, &payload);
        }
        for text in [
            r#"{"simulation_hash":"00","agent":0,"sensor":[1,2]}"#,
            r#"{"simulation_hash":"00","agent":0,"actuator":[1]}"#,
            r#"{"simulation_hash":"00","fitness":9}"#,
            r#"{"server":9,"simulation_hash":"00","run":true}"#,
            r#"{"server":1,"simulation_hash":"00","run":true}"#,
            r#"{"server":1,"simulation_hash":"00","run":false}"#,
        ] {
            for topic in Topic::SEED {
                net.publish(stranger, topic.name(), text.as_bytes());
            }
        }
        net.submit(index, work(7, &SEEDS));
        prop_assert_eq!(net.finish(index), undisturbed());
    }
}

#[test]
fn the_sequence_is_that_of_the_protocol() {
    let mut net = Net::new(1);
    let now = net.now;
    net.add(Party::Server(Box::new(server(1, Line::new()))));
    let index = net.add(Party::Tool(Box::new(tool("a", 0, now))));
    net.submit(index, work(1, &[0]));
    net.finish(index);
    let topics: Vec<&str> = net
        .log
        .iter()
        .map(|message| message.topic.as_str())
        .collect();
    assert_eq!(
        &topics[..4],
        [
            "discovery",
            "server",
            "parameters",
            "swarmwright/v1/server/1"
        ]
    );
    assert_eq!(topics.last(), Some(&"fitness"));
    // Agents 0 and 4 act in 3 steps, agent 1 in 4, agent 2 in 5, agent 3 in 6; all act in step 0 after the reset, too.
    assert_eq!(
        topics.iter().filter(|topic| **topic == "sensor").count(),
        topics.iter().filter(|topic| **topic == "actuator").count()
    );
}

#[test]
fn every_concurrent_episode_has_its_own_hash() {
    let mut net = Net::new(5);
    let now = net.now;
    for id in 0..4 {
        net.add(Party::Server(Box::new(server(id, Line::new()))));
    }
    let index = net.add(Party::Tool(Box::new(tool("a", 0, now))));
    net.submit(index, work(7, &SEEDS));
    net.finish(index);
    let mut hashes: Vec<String> = net
        .log
        .iter()
        .filter(|message| message.topic == "parameters")
        .filter_map(
            |message| match Message::decode(Topic::Parameters, &message.payload) {
                Ok(Message::Parameters(parameters)) => Some(parameters.simulation_hash),
                _ => None,
            },
        )
        .collect();
    let all = hashes.len();
    hashes.sort();
    hashes.dedup();
    assert_eq!((all, hashes.len()), (14, 14));
}

#[test]
fn a_server_that_sends_the_wrong_number_of_sensors_is_left_for_another() {
    let mut net = Net::new(2);
    let now = net.now;
    // The server offers the simulation but sends other messages.
    net.add(Party::Script(Box::new(|topic, payload| {
        let meant = Topic::SEED.into_iter().find(|known| known.name() == topic).unwrap_or(Topic::Presence);
        match Message::decode(meant, payload) {
            Ok(Message::Discovery(discovery)) => vec![(
                "server".to_owned(),
                format!(
                    r#"{{"server":1,"simulation_hash":"{}","simulations":["line"],"capabilities":{{"dimensions":2}}}}"#,
                    discovery.simulation_hash
                )
                .into_bytes(),
            )],
            Ok(Message::Control(control)) if control.server == 1 && control.run => vec![(
                "sensor".to_owned(),
                format!(r#"{{"simulation_hash":"{}","agent":0,"sensor":[1,2,3]}}"#, control.simulation_hash).into_bytes(),
            )],
            _ => Vec::new(),
        }
    })));
    net.add(Party::Server(Box::new(server(2, Line::new()))));
    let index = net.add(Party::Tool(Box::new(tool("a", 0, now))));
    net.submit(index, work(7, &SEEDS));
    assert_eq!(net.finish(index), undisturbed());
    let told = net
        .warnings
        .iter()
        .filter(|text| text.contains("3 numbers") && text.contains("server 1"))
        .count();
    assert!(told >= 1, "{:?}", net.warnings);
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(64))]

    #[test]
    fn two_servers_with_one_id_are_both_left_out_and_named(random in any::<u64>()) {
        let mut net = Net::new(random);
        let now = net.now;
        net.add(Party::Server(Box::new(server(1, Line::new()))));
        net.add(Party::Server(Box::new(server(1, Line::new()))));
        net.add(Party::Server(Box::new(server(2, Line::new()))));
        let index = net.add(Party::Tool(Box::new(tool("a", 0, now))));
        net.submit(index, work(7, &SEEDS));
        prop_assert_eq!(net.finish(index), undisturbed());
        let named = net.warnings.iter().any(|warning| warning.contains("two servers answer to the id 1"));
        prop_assert!(named, "{:?}", net.warnings);
    }

    #[test]
    fn two_servers_with_one_id_alone_are_never_used(random in any::<u64>()) {
        let mut net = Net::new(random);
        let now = net.now;
        net.add(Party::Server(Box::new(server(1, Line::new()))));
        net.add(Party::Server(Box::new(server(1, Line::new()))));
        let index = net.add(Party::Tool(Box::new(tool("a", 0, now))));
        net.submit(index, work(7, &SEEDS));
        for _ in 0..3000 {
            net.turn();
        }
        prop_assert_eq!(net.tool(index).done(), 0, "{:?}", net.warnings);
        let now = net.now;
        let words = net.tool(index).waiting_for(now);
        prop_assert!(words.contains("two servers answer to this id"), "{words}");
    }
}

#[test]
fn a_server_whose_tool_is_gone_says_who_is_missing_and_gets_free_again() {
    let mut net = Net::new(4);
    let now = net.now;
    net.add(Party::Server(Box::new(server(1, Line::new()))));
    let dead = net.add(Party::Tool(Box::new(tool("dead", 0, now))));
    net.submit(dead, work(7, &SEEDS));
    while net
        .log
        .iter()
        .filter(|message| message.topic == "sensor")
        .count()
        < 3
    {
        net.turn();
    }
    net.parties[dead] = Party::Gone;
    let start = net.now;
    let alive = net.add(Party::Tool(Box::new(tool("alive", 1 << 40, start))));
    net.submit(alive, work(7, &SEEDS));
    assert_eq!(net.finish(alive), undisturbed());
    assert!(net.now - start > Duration::from_secs(20));
    let words: Vec<&String> = net
        .warnings
        .iter()
        .filter(|warning| warning.contains("dead has not sent the actuators of agent"))
        .collect();
    assert_eq!(words.len(), 2, "{:?}", net.warnings);
    assert!(words[1].contains("free again"));
}
