//! Reconnections of the tool to the broker.
#![allow(clippy::unwrap_used, clippy::panic, reason = "a test")]

use crate::common;

use std::time::Duration;

use common::{Alone, Line, Net, Party, SEEDS, server, tool, undisturbed, work};
use serde_json::{Value, json};

/// Returns the hashes of the messages that end an episode after the first `count` messages, in order.
fn ends(tool: &Alone, count: usize) -> Vec<Value> {
    let messages = tool.said.iter().skip(count);
    let ends = messages.filter(|(_, message)| message["run"] == false);
    ends.map(|(_, message)| message["simulation_hash"].clone())
        .collect()
}

/// Creates a tool with an episode in flight on server 1.
fn in_an_episode() -> (Alone, Value) {
    let mut tool = Alone::new(work(3, &SEEDS));
    tool.answer(1, None);
    tool.pass(40);
    let hash = tool.last("parameters");
    tool.sense(&hash);
    (tool, hash)
}

#[test]
fn an_episode_is_ended_again_until_its_server_answers() {
    let (mut tool, hash) = in_an_episode();
    tool.reconnect();
    assert_eq!(ends(&tool, 0), std::slice::from_ref(&hash));
    // The server has not received the message, because its own connection is not restored yet.
    for _ in 0..100 {
        tool.pass(100);
    }
    let told = ends(&tool, 0);
    assert!((3..=10).contains(&told.len()), "{told:?}");
    assert!(told.iter().all(|ended| *ended == hash));
    tool.answer(1, None);
    let known = tool.said.len();
    for _ in 0..10 {
        tool.pass(100);
    }
    assert!(ends(&tool, known).is_empty());
    assert_ne!(tool.last("parameters"), hash);
}

#[test]
fn a_server_that_never_answers_is_not_told_for_ever() {
    let (mut tool, _) = in_an_episode();
    tool.reconnect();
    for _ in 0..1300 {
        tool.pass(100);
    }
    let known = tool.said.len();
    for _ in 0..600 {
        tool.pass(100);
    }
    assert!(ends(&tool, known).is_empty());
}

#[test]
fn an_episode_is_ended_when_the_connection_breaks_again_before_that_was_heard() {
    let (mut tool, hash) = in_an_episode();
    tool.reconnect();
    tool.reconnect();
    assert_eq!(ends(&tool, 0), [hash.clone(), hash]);
}

#[test]
fn an_episode_is_ended_again_where_that_may_have_been_lost_with_the_connection() {
    let (mut tool, hash) = in_an_episode();
    // All work is given up and other work begins; the connection breaks before the server learns of it.
    tool.machine.cancel();
    tool.collect();
    let now = tool.now;
    tool.machine.submit(work(2, &SEEDS), now);
    tool.collect();
    let next = tool.last("parameters");
    assert_ne!(next, hash);
    let known = tool.said.len();
    tool.reconnect();
    assert_eq!(ends(&tool, known), [hash, next]);
}

#[test]
fn a_server_that_goes_on_with_the_episode_is_free_at_once() {
    // The server keeps its episode. The tool's message after reconnecting is lost, because the connection breaks again
    // or the server's own one is not restored yet.
    for breaks in [1, 2] {
        let mut net = Net::new(3);
        let start = net.now;
        net.add(Party::Server(Box::new(server(1, Line::new()))));
        let index = net.add(Party::Tool(Box::new(tool("a", 0, start))));
        net.submit(index, work(7, &SEEDS));
        while !net.log.iter().any(|message| message.topic == "actuator") {
            net.turn();
        }
        let now = net.now;
        for _ in 0..breaks {
            net.tool(index).disconnected(now);
            net.tool(index).connected(now);
            drop(net.tool(index).actions());
        }
        assert_eq!(net.finish(index), undisturbed(7));
        let waited = net.now - start;
        assert!(waited < Duration::from_secs(6), "{waited:?}");
    }
}

#[test]
fn a_server_that_does_not_say_for_whom_it_is_busy_keeps_its_episode() {
    for holder in [None, Some("b")] {
        let mut presence = json!({"version": 1, "server": 1, "state": "busy", "simulations": ["line"],
            "capabilities": {"dimensions": 2, "max_agents": 5}, "since": "2026-01-01T00:00:00Z"});
        if let Some(holder) = holder {
            presence["tool"] = holder.into();
        }
        let mut tool = Alone::new(work(3, &SEEDS));
        tool.answer(1, None);
        tool.pass(40);
        let hash = tool.last("parameters");
        // The server has the parameters, but not yet the `control` message.
        tool.hear("swarmwright/v1/presence/1", &presence);
        tool.pass(300);
        tool.sense(&hash);
        let (kept, acts) = (ends(&tool, 0).is_empty(), tool.on("actuator").count());
        assert_eq!(kept, holder.is_none(), "{:?}", tool.warnings);
        assert_eq!(acts, usize::from(holder.is_none()));
    }
}
