//! Arbitrary sequences of packets, mostly SUBSCRIBE: every answer is a packet, stored data is counted, and nothing
//! remains when the clients have left.

use super::*;
use proptest::prelude::*;
use swarmwright_fuzzing::packets_of_clients as golden;
use swarmwright_fuzzing::{config, mutated, peak};

/// Number of clients.
const CLIENTS: usize = 3;

#[derive(Debug, Clone)]
enum Step {
    /// A client sends this packet; it connects first if necessary.
    Say(usize, Vec<u8>),
    /// The client's connection ends.
    Leave(usize),
    /// The client reads its messages.
    Read(usize),
    Pass(u64),
}

/// SUBSCRIBE and UNSUBSCRIBE with many filters, options and identifiers, and PUBLISH to topics that match them.
fn subscriptions() -> Vec<Vec<u8>> {
    let filters = [
        "#",
        "+",
        "+/+/+",
        "a/b",
        "a/+",
        "a/#",
        "+/b",
        "$SYS/#",
        "$share/g/a",
        "",
        "a//b",
        "a/b/#",
    ];
    let deep = "x/".repeat(140);
    let mut packets = Vec::new();
    for options in [0, 1, 2, 0x2e, 0x1c, 3, 0xff] {
        let mut body = vec![0, 9, 0];
        for filter in filters {
            body.extend(text(filter));
            body.push(options);
        }
        packets.push(packet(0x82, &body));
        let mut identified = vec![0, 9, 2, 0x0b, 0x7f];
        identified.extend(text("a/b"));
        identified.push(options);
        packets.push(packet(0x82, &identified));
    }
    packets.push(subscribe(&deep, 0));
    let mut body = vec![0, 9, 0];
    for filter in filters {
        body.extend(text(filter));
    }
    packets.push(packet(0xa2, &body));
    for (topic, flags) in [
        ("a/b", 0),
        ("a/b", 1),
        ("a", 3),
        ("a/b/c", 5),
        ("$SYS/x", 1),
    ] {
        packets.push(publish(topic, flags, 7, &[], b"payload"));
        packets.push(publish(topic, flags, 8, &[2, 0, 0, 0, 5], b""));
    }
    packets
}

fn step() -> impl Strategy<Value = Step> {
    let packets = [subscriptions(), golden()].concat();
    let exact = prop::sample::select(packets.clone());
    let packet = prop_oneof![2 => exact, 3 => mutated(packets)];
    let client = 0..CLIENTS;
    prop_oneof![
        12 => (client.clone(), packet).prop_map(|(client, bytes)| Step::Say(client, bytes)),
        1 => client.clone().prop_map(Step::Leave),
        2 => client.prop_map(Step::Read),
        1 => prop_oneof![Just(1u64), Just(20), Just(4000)].prop_map(Step::Pass),
    ]
}

/// Runs the steps and returns the highest memory counted by the broker.
fn play(steps: &[Step]) -> usize {
    let mut stage = Stage::new(Limits {
        memory: 1 << 20,
        ..Limits::default()
    });
    let mut links = [None; CLIENTS];
    let mut most = 0;
    for step in steps {
        match step {
            Step::Say(client, bytes) => {
                let link = match links[*client] {
                    Some(link) => link,
                    None => {
                        let Some(link) = stage.hub.open(format!("client {client}"), stage.now)
                        else {
                            continue;
                        };
                        // Some sessions outlive the connection.
                        let expiry = if *client == 0 { 0 } else { 600 };
                        let hello = connect(&format!("c{client}"), false, 0, expiry, None);
                        stage.hub.receive(link, &hello, stage.now);
                        links[*client] = Some(link);
                        link
                    }
                };
                let done = stage.hub.receive(link, bytes, stage.now);
                assert!(done <= bytes.len());
            }
            Step::Leave(client) => {
                if let Some(link) = links[*client].take() {
                    stage.hub.closed(link, stage.now);
                }
            }
            Step::Read(client) => {
                if let Some(link) = links[*client] {
                    stage.heard(link);
                }
            }
            Step::Pass(seconds) => stage.pass(*seconds),
        }
        for _ in 0..100 {
            if !stage.hub.is_searching() || !stage.hub.search(stage.now) {
                break;
            }
        }
        stage.hub.take_dirty();
        for link in &mut links {
            // The server closes connections for the hub, once their last packets are sent.
            if let Some(id) = link.filter(|id| stage.hub.is_closing(*id)) {
                stage.heard(id);
                stage.hub.closed(id, stage.now);
                *link = None;
            }
        }
        most = most.max(stage.hub.memory());
        assert!(
            stage.hub.memory() <= (1 << 20) + (1 << 16),
            "{}",
            stage.hub.memory()
        );
    }
    for link in links.into_iter().flatten() {
        stage.hub.closed(link, stage.now);
    }
    stage.pass(4000);
    // Wills may be published late.
    stage.pass(4000);
    assert_eq!(stage.hub.memory(), stage.hub.retained.size());
    assert!(stage.hub.sessions.is_empty() && stage.hub.by_client.is_empty());
    assert!(stage.hub.subscriptions.is_empty());
    assert_eq!((stage.hub.absent, stage.hub.unauthenticated), (0, 0));
    most
}

proptest! {
    #![proptest_config(config())]

    #[test]
    fn clients_that_say_anything(steps in prop::collection::vec(step(), 1..24)) {
        let (counted, bytes) = peak(|| play(&steps));
        // Tables of the broker itself, and growing buffers.
        prop_assert!(bytes <= 4 * counted + (1 << 18), "{} bytes, {} counted", bytes, counted);
    }
}
