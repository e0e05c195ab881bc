//! Fleets of seed-only, batched and offloaded servers: the results are always those of one stepwise server.

#![allow(clippy::panic, reason = "a test")]

mod common;

use std::time::Duration;

use common::{
    Extended, Line, Net, Party, Wrong, refusal, server, tool, tool_in_mode, tool_that_measures,
    tool_with_faults, work,
};
use proptest::prelude::*;
use swarmwright_pool::{Faults, Mode, Results, Work};
use swarmwright_protocol::{PieceKind, RefusalKind, Status, ToServer, Topics};

const SEEDS: [u64; 3] = [3, 4, 9];
const CANDIDATES: usize = 40;

fn undisturbed(candidates: usize) -> Vec<f64> {
    let mut net = Net::new(0);
    let now = net.now;
    let index = net.add(Party::Tool(Box::new(tool("a", 0, now))));
    net.add(Party::Server(Box::new(server(1, Line::new()))));
    net.submit(index, work(candidates, &SEEDS));
    net.finish(index)
}

fn batched(id: u64) -> Extended {
    Extended::new(id, &["stepwise", "batched"])
}

fn offloaded(id: u64) -> Extended {
    Extended::new(id, &["stepwise", "batched", "offloaded"])
}

/// The tool, and work submitted to it.
fn begin(net: &mut Net, mode: Mode, work: Work) -> usize {
    let tool = tool_in_mode(mode, "a", 0, net.now);
    let index = net.add(Party::Tool(Box::new(tool)));
    net.submit(index, work);
    index
}

fn begin_with(net: &mut Net, faults: Faults, work: Work) -> usize {
    let tool = tool_with_faults(faults, "a", 0, net.now);
    let index = net.add(Party::Tool(Box::new(tool)));
    net.submit(index, work);
    index
}

fn begin_without_copies(net: &mut Net, work: Work) -> usize {
    let faults = Faults {
        backup: false,
        ..Faults::default()
    };
    begin_with(net, faults, work)
}

fn party(net: &mut Net, index: usize) -> &mut Extended {
    match &mut net.parties[index] {
        Party::Extended(server) => server,
        _ => panic!("party {index} is no extended server"),
    }
}

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
        // The servers of these tests that know the extensions speak no plain steps.
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
fn an_answer_that_comes_after_its_lease_is_not_heard() {
    let mut net = Net::new(7);
    // The tool waits for 10 seconds.
    let slow = Extended {
        pace: Duration::from_secs(25),
        ..offloaded(1)
    };
    net.add(Party::Extended(Box::new(slow)));
    net.add(Party::Extended(Box::new(offloaded(2))));
    let index = begin_without_copies(&mut net, work(CANDIDATES, &SEEDS));
    assert_eq!(net.finish(index), undisturbed(CANDIDATES));
    let told = |text: &&String| text.contains("server 1 has not answered a block of 1 evaluations");
    assert!(
        net.warnings.iter().any(|text| told(&text)),
        "{:?}",
        net.warnings
    );
    // More work, while the late answers to the first come in.
    net.submit(index, work(300, &SEEDS));
    assert_eq!(net.finish(index), undisturbed(300));
    let mut numbers: Vec<u64> = (0..2)
        .flat_map(|at| party(&mut net, at).blocks.clone())
        .map(|(number, _)| number)
        .collect();
    let all = numbers.len();
    numbers.sort_unstable();
    numbers.dedup();
    assert_eq!(numbers.len(), all, "a request number was used twice");
    assert!(net.tool(index).counts().time_outs > 0);
}

#[test]
fn a_silent_server_is_not_waited_for_when_another_can_have_its_work() {
    let mut net = Net::new(7);
    let slow = Extended {
        pace: Duration::from_secs(25),
        ..offloaded(1)
    };
    net.add(Party::Extended(Box::new(slow)));
    net.add(Party::Extended(Box::new(offloaded(2))));
    let start = net.now;
    let index = begin(&mut net, Mode::Auto, work(CANDIDATES, &SEEDS));
    assert_eq!(net.finish(index), undisturbed(CANDIDATES));
    assert!(
        net.now - start < Duration::from_secs(3),
        "{:?}",
        net.now - start
    );
    let counts = *net.tool(index).counts();
    assert_eq!((counts.backups, counts.time_outs), (2, 0), "{counts:?}");
}

#[test]
fn an_evaluation_that_takes_servers_down_is_left_out_and_the_others_are_not() {
    let mut net = Net::new(3);
    let all = work(CANDIDATES, &SEEDS);
    let poison = all.genomes_of(17..18)[0];
    for id in 1..4 {
        net.add(Party::Extended(Box::new(Extended {
            dies_on: Some(poison),
            ..offloaded(id)
        })));
    }
    let index = begin(&mut net, Mode::Auto, all);
    let results = net.finish(index);
    let expected = undisturbed(CANDIDATES);
    for (evaluation, (found, expected)) in results.iter().zip(&expected).enumerate() {
        if evaluation / SEEDS.len() == 17 {
            assert!(found.is_nan());
        } else {
            assert_eq!(found, expected, "{evaluation}");
        }
    }
    let counts = *net.tool(index).counts();
    assert_eq!((counts.quarantined, counts.failed), (3, 3), "{counts:?}");
    assert!(counts.server_failures >= 9, "{counts:?}");
}

#[test]
fn a_server_that_is_wrong_is_found_out_and_what_it_did_is_done_again() {
    for (make, wrong) in [
        (batched as fn(u64) -> Extended, Wrong::By(1.01)),
        (offloaded, Wrong::By(1.01)),
        (offloaded, Wrong::Always(4.25)),
    ] {
        let mut net = Net::new(3);
        net.add(Party::Extended(Box::new(make(1))));
        net.add(Party::Extended(Box::new(Extended {
            wrong: Some(wrong),
            ..make(2)
        })));
        net.add(Party::Extended(Box::new(make(3))));
        let index = begin_with(
            &mut net,
            Faults {
                audit: 0.3,
                ..Faults::default()
            },
            work(CANDIDATES, &SEEDS),
        );
        assert_eq!(net.finish(index), undisturbed(CANDIDATES));
        let counts = *net.tool(index).counts();
        assert!(
            counts.audits > 10 && counts.disagreements > 0 && counts.recomputed > 0,
            "{counts:?}"
        );
        assert!(
            net.warnings
                .iter()
                .any(|text| text.contains("server 2 gives wrong results")),
            "{:?}",
            net.warnings
        );
        // It is not asked again.
        let asked = party(&mut net, 1).blocks.len();
        net.submit(index, work(CANDIDATES, &SEEDS));
        assert_eq!(net.finish(index), undisturbed(CANDIDATES));
        assert_eq!(party(&mut net, 1).blocks.len(), asked);
    }
}

#[test]
fn two_servers_that_do_not_agree_end_the_work_as_it_cannot_be_told_which_is_wrong() {
    let mut net = Net::new(3);
    net.add(Party::Extended(Box::new(offloaded(1))));
    net.add(Party::Extended(Box::new(Extended {
        wrong: Some(Wrong::By(1.01)),
        ..offloaded(2)
    })));
    let index = begin_with(
        &mut net,
        Faults {
            audit: 1.0,
            ..Faults::default()
        },
        work(CANDIDATES, &SEEDS),
    );
    for _ in 0..5000 {
        net.turn();
    }
    assert!(!net.tool(index).finished());
    let told = net
        .tool(index)
        .disagreement()
        .unwrap_or_default()
        .to_owned();
    assert!(
        told.contains("on server 1") && told.contains("on server 2"),
        "{told}"
    );
}

#[test]
fn one_server_alone_is_not_audited() {
    let mut net = Net::new(3);
    net.add(Party::Extended(Box::new(offloaded(1))));
    let index = begin_with(
        &mut net,
        Faults {
            audit: 1.0,
            ..Faults::default()
        },
        work(CANDIDATES, &SEEDS),
    );
    assert_eq!(net.finish(index), undisturbed(CANDIDATES));
    assert_eq!(net.tool(index).counts().audits, 0);
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
    // The tool waits for 10 seconds.
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
}

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
    // Both were busy all the time: as fast as the two together can be, and 5 % for the beginning and the end.
    let ideal = Duration::from_micros(20) * 60_000 * 10 / 11;
    assert!(net.now - start < ideal * 105 / 100, "{:?}", net.now - start);
    // About 20 ms of work each, once the speed is known.
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
fn a_server_that_another_tool_takes_is_not_a_failure() {
    let mut net = Net::new(5);
    let taken = refusal(RefusalKind::Taken, "taken by b");
    net.add(Party::Extended(Box::new(Extended {
        refusal: taken,
        ..offloaded(1)
    })));
    net.add(Party::Extended(Box::new(offloaded(2))));
    let index = begin(&mut net, Mode::Auto, work(CANDIDATES, &SEEDS));
    assert_eq!(net.finish(index), undisturbed(CANDIDATES));
    assert!(
        net.journal(index)
            .iter()
            .all(|attempt| attempt.attempt == 1)
    );
    assert!(net.warnings.is_empty(), "{:?}", net.warnings);
}

#[test]
fn a_server_that_refuses_the_work_is_left_out() {
    for make in [batched, offloaded] {
        let mut net = Net::new(6);
        let refusal = refusal(RefusalKind::Invalid, "parameters.numAgents: too many");
        let refusing = net.add(Party::Extended(Box::new(Extended { refusal, ..make(1) })));
        net.add(Party::Extended(Box::new(make(2))));
        let index = begin(&mut net, Mode::Auto, work(CANDIDATES, &SEEDS));
        assert_eq!(net.finish(index), undisturbed(CANDIDATES));
        net.submit(index, work(CANDIDATES, &SEEDS));
        assert_eq!(net.finish(index), undisturbed(CANDIDATES));
        assert!(party(&mut net, refusing).blocks.len() <= 4);
        assert!(
            net.warnings
                .iter()
                .any(|text| text.contains("parameters.numAgents: too many"))
        );
    }
}

#[test]
fn work_that_all_servers_refuse_is_rejected_with_their_reason() {
    let mut net = Net::new(6);
    for id in [1, 2] {
        let refusal = refusal(RefusalKind::Invalid, "parameters.numAgents: too many");
        net.add(Party::Extended(Box::new(Extended {
            refusal,
            ..offloaded(id)
        })));
    }
    let index = begin(&mut net, Mode::Auto, work(CANDIDATES, &SEEDS));
    let mut reason = None;
    for _ in 0..1000 {
        net.turn();
        let now = net.now;
        reason = reason.or_else(|| net.tool(index).rejected(now));
    }
    let reason = reason.unwrap();
    assert!(
        reason.contains("server 1: parameters.numAgents: too many"),
        "{reason}"
    );
    assert!(reason.contains("server 2: "), "{reason}");
}

#[test]
fn an_episode_that_fails_is_tried_elsewhere_and_the_others_are_kept() {
    let mut net = Net::new(8);
    let broken = Extended {
        fails_on: Some(SEEDS[1]),
        ..offloaded(1)
    };
    net.add(Party::Extended(Box::new(broken)));
    net.add(Party::Extended(Box::new(offloaded(2))));
    let index = begin(&mut net, Mode::Auto, work(CANDIDATES, &SEEDS));
    assert_eq!(net.finish(index), undisturbed(CANDIDATES));
    let journal = net.journal(index);
    let failed: Vec<_> = journal
        .iter()
        .filter(|attempt| attempt.error.is_some())
        .collect();
    assert!(!failed.is_empty());
    for attempt in failed {
        assert_eq!(attempt.error.as_deref(), Some("a wheel came off"));
        assert_eq!(
            (attempt.candidates, attempt.episode, attempt.episodes),
            (1, 1, 1)
        );
        assert_eq!(attempt.server, 1);
    }
}

#[test]
fn an_episode_that_fails_everywhere_has_no_fitness() {
    let mut net = Net::new(8);
    for id in [1, 2] {
        let fails_on = Some(SEEDS[1]);
        net.add(Party::Extended(Box::new(Extended {
            fails_on,
            ..offloaded(id)
        })));
    }
    let index = begin(&mut net, Mode::Auto, work(4, &SEEDS));
    let (found, expected) = (net.finish(index), undisturbed(4));
    for (at, (found, expected)) in found.iter().zip(&expected).enumerate() {
        if at % SEEDS.len() == 1 {
            assert!(found.is_nan());
        } else {
            assert_eq!(found.to_bits(), expected.to_bits());
        }
    }
    let tries: Vec<u32> = net
        .journal(index)
        .iter()
        .map(|attempt| attempt.attempt)
        .collect();
    // The servers say that they repeat themselves to the bit. But one that failed several candidates in a row may be broken.
    let most = tries.iter().max().copied();
    assert!(most >= Some(2) && most <= Some(3), "{most:?}");
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

/// What comes out for a tool that needs `metrics`.
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
        // The others of these tests speak no plain steps.
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
                        |text| (text.contains("failed after ") || text.contains("in quarantine"))
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
