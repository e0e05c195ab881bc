//! Fleets of seed-only, batched and offloaded servers: the results are always those of one stepwise server.

#![allow(clippy::panic, clippy::unwrap_used, reason = "a test")]

use crate::common;

use std::time::Duration;

use common::{
    CANDIDATES, Extended, Line, Net, Party, SEEDS, batched, begin, begin_without_copies, offloaded,
    party, server, tool_that_measures, undisturbed, work,
};
use proptest::prelude::*;
use swarmwright_pool::{Mode, Results};
use swarmwright_protocol::{PieceKind, Status, ToServer, Topics};

proptest! {
    #![proptest_config(ProptestConfig::with_cases(64))]

    #[test]
    fn results_do_not_depend_on_how_and_by_whom_they_are_computed(
        stepwise in 0u64..3, batching in 0u64..3, offloading in 0u64..3, real in 0u64..3, mode in 0usize..4,
        random in any::<u64>(),
    ) {
        let mut net = Net::new(random);
        for id in 30..30 + real {
            net.add(Party::Server(Box::new(server(id, Line::new()))));
        }
        for id in 0..stepwise {
            net.add_seed_only(id);
        }
        for id in 10..10 + batching {
            let batch = 1 + usize::try_from(id * 7 % 11).unwrap();
            net.add(Party::Extended(Box::new(Extended { batch, ..batched(id) })));
        }
        for id in 20..20 + offloading {
            let pace = Duration::from_micros(1 + id * 37 % 1000);
            net.add(Party::Extended(Box::new(Extended { pace, ..offloaded(id) })));
        }
        let mode = [Mode::Auto, Mode::Stepwise, Mode::Batched, Mode::Offloaded][mode];
        let able = match mode {
            Mode::Auto => stepwise + batching + offloading + real,
            Mode::Stepwise => stepwise + real,
            Mode::Batched => batching + offloading + real,
            Mode::Offloaded => offloading + real,
        };
        prop_assume!(able > 0);
        // The extended servers in these tests do not support stepwise mode.
        prop_assume!(mode != Mode::Stepwise || batching + offloading == 0);
        let index = begin(&mut net, mode, work(CANDIDATES, &SEEDS));
        prop_assert_eq!(net.finish(index), undisturbed(CANDIDATES));
    }

    #[test]
    fn a_server_lost_in_mid_block_costs_nothing_but_time(after in 0usize..300, random in any::<u64>(), batching: bool) {
        let mut net = Net::new(random);
        let make = if batching { batched } else { offloaded };
        let doomed = net.add(Party::Extended(Box::new(make(1))));
        net.add(Party::Extended(Box::new(make(2))));
        net.add_seed_only(3);
        let index = begin(&mut net, Mode::Auto, work(CANDIDATES, &SEEDS));
        for _ in 0..after {
            net.turn();
        }
        net.parties[doomed] = Party::Gone;
        prop_assert_eq!(net.finish(index), undisturbed(CANDIDATES));
    }

    #[test]
    fn answers_that_come_twice_change_nothing(random in any::<u64>(), batching: bool) {
        let mut net = Net::new(random);
        let make = if batching { batched } else { offloaded };
        net.add(Party::Extended(Box::new(Extended { twice: true, ..make(1) })));
        net.add(Party::Extended(Box::new(Extended { twice: true, ..make(2) })));
        let index = begin(&mut net, Mode::Auto, work(CANDIDATES, &SEEDS));
        prop_assert_eq!(net.finish(index), undisturbed(CANDIDATES));
        let warnings: Vec<_> = net.warnings.iter().collect();
        prop_assert!(warnings.is_empty(), "{:?}", warnings);
    }
}

#[test]
fn the_status_names_who_is_waited_for_and_who_has_a_pause() {
    let mut net = Net::new(7);
    let slow = Extended {
        pace: Duration::from_secs(25),
        ..offloaded(1)
    };
    net.add(Party::Extended(Box::new(slow)));
    net.add(Party::Extended(Box::new(offloaded(2))));
    let index = begin_without_copies(&mut net, work(CANDIDATES, &SEEDS));
    let start = net.now;
    let status = net.tool(index).status(start);
    assert_eq!((status.done, status.total), (0, 120));
    assert!(status.waiting_for.is_empty() && status.servers.is_empty());
    while net.tool(index).done() < 110 {
        net.turn();
    }
    let now = net.now + Duration::from_secs(9);
    let status = net.tool(index).status(now);
    let oldest = &status.waiting_for[0];
    assert_eq!((oldest.server, oldest.kind), (1, PieceKind::Block));
    assert!(oldest.silent > 8.0);
    assert_eq!(net.tool(index).waiting_for(now), oldest.to_string());
    assert_eq!(Status::decode(&status.encode()), Ok(status));
    // The step time-out of the tool is 10 seconds.
    let benched = loop {
        net.turn();
        let now = net.now;
        let mut servers = net.tool(index).status(now).servers;
        if servers.first().is_some_and(|first| first.benched.is_some()) {
            break servers.remove(0);
        }
    };
    assert_eq!((benched.server, benched.failures), (1, 1));
    let reason = benched.reason.as_deref().unwrap();
    assert!(
        reason.starts_with("server 1 has not answered a block"),
        "{reason}"
    );
    assert!(reason.ends_with("raise timeouts.step (10 s)"), "{reason}");
}

#[test]
fn the_journal_has_a_line_for_each_request_and_covers_everything_once() {
    let mut net = Net::new(9);
    let server = net.add(Party::Extended(Box::new(offloaded(1))));
    net.add(Party::Extended(Box::new(batched(2))));
    net.add_seed_only(3);
    let index = begin(&mut net, Mode::Auto, work(CANDIDATES, &SEEDS));
    net.finish(index);
    let journal = net.journal(index);
    let mut covered = [[0; SEEDS.len()]; CANDIDATES];
    for attempt in &journal {
        for row in &mut covered[attempt.candidate..][..attempt.candidates] {
            for cell in &mut row[attempt.episode..][..attempt.episodes] {
                *cell += 1;
            }
        }
    }
    assert_eq!(covered, [[1; SEEDS.len()]; CANDIDATES]);
    let blocks = journal.iter().filter(|attempt| attempt.server == 1).count();
    assert_eq!(blocks, party(&mut net, server).blocks.len());
    let modes: Vec<_> = journal
        .iter()
        .map(|attempt| (attempt.server, attempt.mode))
        .collect();
    for expected in [(1, "offloaded"), (2, "batched"), (3, "stepwise")] {
        assert!(modes.contains(&expected), "{modes:?}");
    }
}

#[test]
fn giving_up_frees_the_servers() {
    let mut net = Net::new(4);
    net.add(Party::Extended(Box::new(offloaded(1))));
    let index = begin(&mut net, Mode::Auto, work(CANDIDATES, &SEEDS));
    while party(&mut net, 0).blocks.is_empty() {
        net.turn();
    }
    net.tool(index).release();
    net.collect(index);
    for _ in 0..20 {
        net.turn();
    }
    let text = |payload: &[u8]| String::from_utf8_lossy(payload).into_owned();
    let last = net
        .log
        .iter()
        .rfind(|message| message.topic == "control")
        .unwrap();
    let control = text(&last.payload);
    assert!(
        control.contains(r#""run":false"#) && control.contains(r#""tool":"a""#),
        "{control}"
    );
    let sent = |message: &&common::Message| message.topic == Topics::default().to_server(1);
    let first = net.log.iter().find(sent).unwrap();
    let Ok(ToServer::Evaluate(request)) = ToServer::decode(&first.payload) else {
        panic!("no request");
    };
    assert_eq!((request.tool.as_str(), request.attempt), ("a", 1));
    assert_eq!(request.reply, Topics::default().to_tool("a"));
    assert!(request.lease >= 10.0);
}

/// Returns the results for a tool that needs `metrics`.
fn measured(net: &mut Net, metrics: &[&str], mode: Mode, candidates: usize) -> Results {
    let tool = tool_that_measures(metrics, mode, "a", 0, net.now);
    let index = net.add(Party::Tool(Box::new(tool)));
    net.submit(index, work(candidates, &SEEDS));
    net.finish_with_metrics(index)
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(32))]

    #[test]
    fn metrics_do_not_depend_on_how_and_by_whom_they_are_computed(
        batching in 0u64..3, offloading in 0u64..3, real in 0u64..3, mode in 0usize..4, random in any::<u64>(),
    ) {
        let mut net = Net::new(random);
        for id in 30..30 + real {
            net.add(Party::Server(Box::new(server(id, Line::new()))));
        }
        let mode = [Mode::Auto, Mode::Stepwise, Mode::Batched, Mode::Offloaded][mode];
        // The other servers in these tests do not support stepwise mode.
        let others = if mode == Mode::Stepwise { 0 } else { 2 };
        for id in 10..10 + batching.min(others) {
            net.add(Party::Extended(Box::new(batched(id))));
        }
        for id in 20..20 + offloading.min(others) {
            net.add(Party::Extended(Box::new(offloaded(id))));
        }
        prop_assume!(real + if mode == Mode::Offloaded { 0 } else { batching.min(others) } + offloading.min(others) > 0);
        let results = measured(&mut net, &["half", "steps"], mode, CANDIDATES);
        let expected = undisturbed(CANDIDATES);
        // All five agents have stopped after the fifth step or, with agent 3, the sixth.
        let rows = expected.iter().flat_map(|fitness| [fitness / 2.0, 6.0]);
        prop_assert_eq!(results.metrics, rows.collect::<Vec<_>>());
        prop_assert_eq!(results.fitness, expected);
    }
}

#[test]
fn a_server_that_does_not_announce_what_is_needed_is_not_used_and_it_is_said_why() {
    let mut net = Net::new(4);
    net.add_seed_only(1);
    net.add(Party::Extended(Box::new(offloaded(2))));
    let tool = tool_that_measures(&["half"], Mode::Auto, "a", 0, net.now);
    let index = net.add(Party::Tool(Box::new(tool)));
    net.submit(index, work(3, &SEEDS));
    assert_eq!(
        net.finish_with_metrics(index).fitness,
        undisturbed(3),
        "the other one is used"
    );
    let told = "server 1 answered, but does not announce the metric half, which the fitness needs";
    assert!(
        net.warnings.iter().any(|text| text.contains(told)),
        "{:?}",
        net.warnings
    );
    assert!(net.tool(index).describe().contains("metrics half"));
    assert_eq!(net.tool(index).metrics(), ["half", "steps"]);
}

#[test]
fn an_evaluation_without_a_metric_that_is_needed_has_failed_and_it_is_said_why() {
    for make in [batched, offloaded] {
        for (half, reason, failed) in [
            (Some((4, f64::NAN)), "the metric half is NaN", 1),
            (Some((9, f64::INFINITY)), "the metric half is inf", 2),
            (None, "the metric half is missing", 3),
        ] {
            let mut net = Net::new(5);
            net.add(Party::Extended(Box::new(Extended { half, ..make(1) })));
            let results = measured(&mut net, &["half"], Mode::Auto, 2);
            for (index, (fitness, metric)) in
                results.fitness.iter().zip(&results.metrics).enumerate()
            {
                let fails = failed == 3 || index % 3 == failed;
                assert_eq!(
                    (fitness.is_nan(), metric.is_nan()),
                    (fails, fails),
                    "{reason} {index}"
                );
            }
            assert!(
                net.warnings
                    .iter()
                    .any(
                        |text| (text.contains("failed after ") || text.contains("quarantined"))
                            && text.contains(reason)
                    ),
                "{:?}",
                net.warnings
            );
            // A tool that does not need the metric is not affected.
            let mut net = Net::new(5);
            net.add(Party::Extended(Box::new(Extended { half, ..make(1) })));
            assert_eq!(
                measured(&mut net, &["steps"], Mode::Auto, 2).fitness,
                undisturbed(2)
            );
        }
    }
}

#[test]
fn seconds_that_cannot_be_are_ignored_and_told_once() {
    for (seconds, what) in [
        (f64::NAN, "NaN or infinite"),
        (f64::INFINITY, "NaN or infinite"),
        (-3.0, "negative"),
    ] {
        let mut net = Net::new(1);
        let one = Extended {
            seconds: Some(seconds),
            ..offloaded(1)
        };
        net.add(Party::Extended(Box::new(one)));
        net.add(Party::Extended(Box::new(offloaded(2))));
        let index = begin(&mut net, Mode::Offloaded, work(CANDIDATES, &SEEDS));
        assert_eq!(net.finish(index), undisturbed(CANDIDATES));
        let now = net.now;
        let status = net.tool(index).status(now);
        for used in status.servers {
            assert!(used.speed.is_some_and(f64::is_finite), "{used:?}");
        }
        let told = format!("\"seconds\" in answers of server 1: it is {what}");
        assert_eq!(net.warnings.len(), 1, "{:?}", net.warnings);
        assert!(net.warnings[0].contains(&told), "{:?}", net.warnings);
    }
}
