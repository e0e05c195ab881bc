//! Shares of work of servers, and their modes.

#![allow(clippy::panic, clippy::unwrap_used, reason = "a test")]

use crate::common;

use std::time::Duration;

use common::{
    CANDIDATES, Extended, Net, Party, SEEDS, batched, begin, offloaded, party, tool_in_mode,
    undisturbed, work,
};
use swarmwright_pool::Mode;
use swarmwright_protocol::Topics;

#[test]
fn blocks_follow_the_speed_of_each_server() {
    let mut net = Net::new(11);
    let fast = Extended {
        pace: Duration::from_micros(20),
        ..offloaded(1)
    };
    let slow = Extended {
        pace: Duration::from_micros(200),
        ..offloaded(2)
    };
    let fast = net.add(Party::Extended(Box::new(fast)));
    let slow = net.add(Party::Extended(Box::new(slow)));
    let index = begin(&mut net, Mode::Auto, work(20_000, &SEEDS));
    let start = net.now;
    net.finish(index);
    let done = |server: &Extended| server.blocks.iter().map(|(_, count)| *count).sum::<usize>();
    let (by_fast, by_slow) = (done(party(&mut net, fast)), done(party(&mut net, slow)));
    assert_eq!(by_fast + by_slow, 60_000);
    let share = by_fast as f64 / by_slow as f64;
    assert!((8.0..12.0).contains(&share), "{by_fast} and {by_slow}");
    // Both servers must always be busy: the ideal duration, plus 5 % for start and end.
    let ideal = Duration::from_micros(20) * 60_000 * 10 / 11;
    assert!(net.now - start < ideal * 105 / 100, "{:?}", net.now - start);
    // About 20 ms of work per block, once the speed is known.
    let largest = party(&mut net, fast)
        .blocks
        .iter()
        .map(|(_, count)| *count)
        .max();
    assert!((900..=1100).contains(&largest.unwrap()), "{largest:?}");
}

#[test]
fn a_slow_server_is_not_waited_for_when_the_others_are_faster_alone() {
    let mut net = Net::new(3);
    let slow = Extended {
        pace: Duration::from_secs(2),
        ..offloaded(1)
    };
    net.add(Party::Extended(Box::new(slow)));
    net.add(Party::Extended(Box::new(offloaded(2))));
    let index = begin(&mut net, Mode::Auto, work(CANDIDATES, &SEEDS));
    net.finish(index);
    let start = net.now;
    net.submit(index, work(CANDIDATES, &SEEDS));
    assert_eq!(net.finish(index), undisturbed(CANDIDATES));
    assert!(
        net.now - start < Duration::from_secs(1),
        "{:?}",
        net.now - start
    );
}

#[test]
fn two_blocks_are_in_flight() {
    let mut net = Net::new(1);
    net.add(Party::Extended(Box::new(offloaded(1))));
    let index = begin(&mut net, Mode::Auto, work(1000, &SEEDS));
    net.finish(index);
    let topics = Topics::default();
    let (mut open, mut most) = (0i64, 0);
    for message in &net.log {
        if message.topic == topics.to_server(1) {
            open += 1;
        } else if message.topic == topics.to_tool("a") {
            open -= 1;
        }
        most = most.max(open);
    }
    assert_eq!(most, 2);
}

#[test]
fn a_mode_that_is_named_excludes_servers_without_it_and_says_so() {
    let mut net = Net::new(2);
    net.add_seed_only(1);
    net.add(Party::Extended(Box::new(batched(2))));
    let index = begin(&mut net, Mode::Offloaded, work(4, &SEEDS));
    for _ in 0..200 {
        net.turn();
    }
    assert!(!net.tool(index).has_server());
    let words = net.tool(index).describe();
    for part in [
        "mode offloaded",
        "server 1: does not offer mode offloaded",
        "server 2: does not offer mode offloaded",
    ] {
        assert!(words.contains(part), "{words}");
    }
}

#[test]
fn a_kind_of_controller_that_a_server_does_not_know_stays_with_the_tool() {
    let mut net = Net::new(2);
    let other = Extended {
        controllers: vec!["fully_meshed"],
        ..offloaded(1)
    };
    net.add(Party::Extended(Box::new(other)));
    let index = begin(&mut net, Mode::Auto, work(CANDIDATES, &SEEDS));
    assert_eq!(net.finish(index), undisturbed(CANDIDATES));
    assert!(
        net.journal(index)
            .iter()
            .all(|attempt| attempt.mode == "batched")
    );
}

#[test]
fn requests_are_kept_below_what_the_broker_takes() {
    for packet in [10_000, 16_384, 65_536] {
        let mut net = Net::new(3);
        net.add(Party::Extended(Box::new(offloaded(1))));
        net.add(Party::Extended(Box::new(Extended {
            batch: 1_000_000,
            ..batched(2)
        })));
        let mut tool = tool_in_mode(Mode::Auto, "a", 0, net.now);
        tool.set_largest_packet(packet);
        let index = net.add(Party::Tool(Box::new(tool)));
        net.submit(index, work(3000, &SEEDS));
        assert_eq!(net.finish(index), undisturbed(3000));
        let largest = net.log.iter().map(|message| message.payload.len()).max();
        assert!(largest < Some(packet), "{largest:?} {packet}");
    }
}
