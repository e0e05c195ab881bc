//! Servers that fail all their work: they are detected, and their work is evaluated elsewhere.
#![allow(clippy::panic, reason = "a test")]

use crate::common;

use std::time::Duration;

use common::{
    Alone, Extended, Line, Net, Party, party, refusal, server, tool, tool_in_mode, tool_with, work,
};
use serde_json::json;
use swarmwright_pool::Mode;
use swarmwright_protocol::RefusalKind;

const SEEDS: [u64; 1] = [3];
const CANDIDATES: usize = 57;

fn undisturbed() -> Vec<f64> {
    let mut net = Net::new(0);
    let now = net.now;
    let index = net.add(Party::Tool(Box::new(tool("a", 0, now))));
    net.add(Party::Server(Box::new(server(1, Line::new()))));
    net.submit(index, work(CANDIDATES, &SEEDS));
    net.finish(index)
}

fn extended(id: u64, broken: bool) -> Party {
    Party::Extended(Box::new(Extended {
        fails_on: broken.then_some(SEEDS[0]),
        pace: Duration::from_millis(if broken { 1 } else { 50 }),
        ..Extended::new(id, &["stepwise", "batched", "offloaded"])
    }))
}

/// Adds a tool with work, and servers of which the first `sound` are sound.
fn begin(net: &mut Net, sound: u64, all: u64) -> (usize, Vec<usize>) {
    let servers = (1..=all).map(|id| net.add(extended(id, id > sound)));
    let servers = servers.collect();
    let tool = tool_in_mode(Mode::Auto, "a", 0, net.now);
    let index = net.add(Party::Tool(Box::new(tool)));
    net.submit(index, work(CANDIDATES, &SEEDS));
    (index, servers)
}

#[test]
fn servers_that_fail_everything_cost_no_candidate_and_are_named_once() {
    // All servers declare bitwise determinism.
    for (sound, random) in [(1, 1), (1, 2), (2, 3), (2, 4), (3, 5)] {
        let mut net = Net::new(random);
        let (index, _) = begin(&mut net, sound, 4);
        assert_eq!(net.finish(index), undisturbed(), "{:?}", net.warnings);
        assert_eq!(net.tool(index).counts().failed, 0);
        let told = |id: u64| {
            let words =
                format!("server {id} is broken: it fails evaluations that succeeded before");
            let found = net.warnings.iter().filter(|text| text.contains(&words));
            found.count()
        };
        assert_eq!((1..=sound).map(told).sum::<usize>(), 0);
        let named: Vec<usize> = (sound + 1..=4).map(told).collect();
        assert!(named.iter().all(|times| *times <= 1), "{named:?}");
        assert!(named.contains(&1), "{:?}", net.warnings);
        // No broken server gets much work before it is detected.
        let failed = net.journal(index).into_iter();
        let failed = failed.filter(|attempt| attempt.error.is_some()).count();
        assert!(failed < CANDIDATES, "{failed}");
    }
}

#[test]
fn servers_that_all_break_end_the_work_with_the_reason_and_no_results() {
    let mut net = Net::new(3);
    let (index, servers) = begin(&mut net, 2, 2);
    while net.tool(index).done() < 10 {
        net.turn();
    }
    for party in servers {
        if let Party::Extended(server) = &mut net.parties[party] {
            server.fails_on = Some(SEEDS[0]);
        }
    }
    let (start, patience) = (net.now, Duration::from_secs(10));
    let reason = loop {
        net.turn();
        let now = net.now;
        if let Some(reason) = net.tool(index).undecided(patience, now) {
            break reason;
        }
        assert!(now - start < Duration::from_secs(30), "{:?}", net.warnings);
        assert!(!net.tool(index).finished());
    };
    assert!(
        reason.contains("all servers fail evaluations that succeeded before")
            && reason.contains("a wheel came off"),
        "{reason}"
    );
    assert_eq!(net.tool(index).counts().failed, 0);
}

#[test]
fn servers_that_are_broken_from_the_start_fail_every_candidate() {
    let mut net = Net::new(3);
    let (index, _) = begin(&mut net, 0, 3);
    let start = net.now;
    assert!(net.finish(index).iter().all(|fitness| fitness.is_nan()));
    assert!(net.now - start < Duration::from_secs(5));
}

#[test]
fn servers_that_refuse_everything_end_the_work() {
    let mut net = Net::new(3);
    let (index, servers) = begin(&mut net, 1, 1);
    for party in servers {
        if let Party::Extended(server) = &mut net.parties[party] {
            server.refusal = refusal(RefusalKind::Failed, "my disk is full");
        }
    }
    let (start, patience) = (net.now, Duration::from_secs(10));
    let reason = loop {
        net.turn();
        let now = net.now;
        if let Some(reason) = net.tool(index).undecided(patience, now) {
            break reason;
        }
        assert!(now - start < Duration::from_secs(120), "{:?}", net.warnings);
    };
    assert!(
        reason.contains("no server has completed an evaluation for a long time")
            && reason.contains("my disk is full"),
        "{reason}"
    );
    assert!(net.now - start > patience, "it may be cured meanwhile");
}

#[test]
fn the_only_server_may_take_as_long_as_a_step_may_take() {
    let mut net = Net::new(3);
    let server = net.add(extended(1, false));
    let tool = tool_with(Mode::Auto, "a", 0, net.now, |config| {
        config.timeouts.step = Duration::from_secs(600);
    });
    let index = net.add(Party::Tool(Box::new(tool)));
    net.submit(index, work(CANDIDATES, &SEEDS));
    let (mut slow, patience) = (false, Duration::from_secs(10));
    while !net.tool(index).finished() {
        net.turn();
        let now = net.now;
        assert_eq!(net.tool(index).undecided(patience, now), None);
        let late = net.tool(index).done() > CANDIDATES / 3;
        // Much longer than before, so that the work would be given to another server as well.
        let pace = if late && !slow { 120_000 } else { 50 };
        slow |= late;
        party(&mut net, server).pace = Duration::from_millis(pace);
    }
    assert!(slow);
    assert_eq!(net.finish(index), undisturbed());
}

#[test]
fn silence_that_ends_with_the_connection_is_not_held_against_servers() {
    let patience = Duration::from_secs(10);
    let mut tool = Alone::new(work(3, &SEEDS));
    tool.answer(1, None);
    tool.pass(40);
    // Longer than the step time-out, and part of the wait for silent servers.
    for _ in 0..300 {
        tool.pass(100);
    }
    assert!(tool.machine.undecided(patience, tool.now).is_none());
    tool.reconnect();
    for _ in 0..300 {
        tool.pass(100);
        assert_eq!(tool.machine.undecided(patience, tool.now), None);
    }
    assert!(tool.machine.unserved(tool.now) >= patience);
    // Silent servers without such a reason are given up.
    tool.answer(1, None);
    tool.pass(40);
    let end = tool.now + Duration::from_secs(120);
    let reason = loop {
        tool.pass(100);
        if let Some(reason) = tool.machine.undecided(patience, tool.now) {
            break reason;
        }
        assert!(tool.now < end, "{:?}", tool.warnings);
    };
    assert!(
        reason.contains("no server has completed an evaluation"),
        "{reason}"
    );
}

/// Waits for the parameters of an episode, while the server answers each discovery once.
fn given(tool: &mut Alone) -> serde_json::Value {
    let before = tool.on("parameters").count();
    let mut last = 0;
    for _ in 0..3000 {
        if tool.on("parameters").count() > before {
            return tool.last("parameters");
        }
        let now = tool.on("discovery").count();
        if now > last {
            last = now;
            tool.answer(1, None);
        }
        tool.pass(100);
    }
    panic!("{:?}", tool.warnings);
}

/// Creates a tool whose server was silent in four episodes, and answered discovery after each.
fn in_vain_four_times() -> Alone {
    let mut tool = Alone::new(work(3, &SEEDS));
    for _ in 0..4 {
        given(&mut tool);
        // Longer than the step time-out.
        for _ in 0..105 {
            tool.pass(100);
        }
    }
    tool
}

#[test]
fn a_server_that_failed_often_may_finish_its_episode() {
    let mut tool = in_vain_four_times();
    let hash = given(&mut tool);
    let begun = tool.now;
    for _ in 0..1000 {
        tool.sense(&hash);
        tool.pass(100);
        let told = tool.machine.undecided(Duration::from_secs(10), tool.now);
        assert_eq!(
            told,
            None,
            "{:?} after the episode began, {} answers",
            tool.now - begun,
            tool.on("actuator").count()
        );
    }
}

#[test]
fn a_server_that_is_started_anew_is_tried_again() {
    let mut tool = in_vain_four_times();
    tool.machine
        .receive("swarmwright/v1/presence/1", b"", false, tool.now);
    tool.collect();
    // The user repairs the server within `step`, the time that a run waits for servers by default.
    for _ in 0..500 {
        tool.pass(100);
        assert_eq!(
            tool.machine.undecided(Duration::from_secs(10), tool.now),
            None
        );
    }
    tool.answer(1, None);
    assert_eq!(
        tool.machine.undecided(Duration::from_secs(10), tool.now),
        None,
        "at its first answer"
    );
}

#[test]
fn a_server_that_works_for_a_tool_without_a_name_is_waited_for() {
    let presence = json!({"version": 1, "server": 1, "state": "busy", "simulations": ["line"],
        "capabilities": {"dimensions": 2, "max_agents": 5}, "since": "2026-01-01T00:00:00Z"});
    let mut tool = Alone::new(work(3, &SEEDS));
    given(&mut tool);
    tool.hear("swarmwright/v1/presence/1", &presence);
    let begun = tool.now;
    // The episode takes two minutes.
    for _ in 0..1200 {
        tool.pass(100);
        let told = tool.machine.undecided(Duration::from_secs(10), tool.now);
        assert_eq!(
            told,
            None,
            "after {:?}; {:?}",
            tool.now - begun,
            tool.warnings
        );
    }
}
