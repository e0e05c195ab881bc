//! Audits: comparison of results with those of other servers.

#![allow(clippy::panic, clippy::unwrap_used, reason = "a test")]

use crate::common;

use std::time::Duration;

use common::{
    CANDIDATES, Extended, Net, Party, SEEDS, Wrong, batched, begin_with, offloaded, party, refusal,
    undisturbed, work,
};
use swarmwright_pool::{Faults, Repetition};
use swarmwright_protocol::RefusalKind;

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
                .any(|text| text.contains("server 2 gives wrong results")
                    && text.contains("or the simulation, which declares determinism: bitwise")),
            "{:?}",
            net.warnings
        );
        // The excluded server gets no further work.
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
        told.contains("on server 1")
            && told.contains("on server 2")
            && told.contains("its reset may not restore everything"),
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
fn audits_that_no_other_server_can_do_are_left_out_counted_and_told_once() {
    for random in 0..3 {
        let mut net = Net::new(random);
        net.add(Party::Extended(Box::new(offloaded(1))));
        net.add(Party::Extended(Box::new(Extended {
            refusal: refusal(RefusalKind::Failed, "my disk is full"),
            ..offloaded(2)
        })));
        let faults = Faults {
            audit: 0.3,
            ..Faults::default()
        };
        let index = begin_with(&mut net, faults, work(CANDIDATES, &SEEDS));
        for _ in 0..5 {
            let start = net.now;
            assert_eq!(net.finish(index), undisturbed(CANDIDATES));
            let took = net.now - start;
            assert!(took < Duration::from_secs(5), "{took:?}");
            net.submit(index, work(CANDIDATES, &SEEDS));
        }
        let counts = *net.tool(index).counts();
        assert_eq!(counts.audits, 0, "{counts:?}");
        assert!(counts.audits_left_out > 50, "{counts:?}");
        let told = "results of server 1 count without the audits";
        let told = net.warnings.iter().filter(|text| text.contains(told));
        assert_eq!(told.count(), 1, "{:?}", net.warnings);
    }
}

#[test]
fn evaluations_are_repeated_on_another_server_where_there_is_one_and_no_others_are_made() {
    for servers in [1, 2, 3] {
        let mut net = Net::new(5);
        for id in 1..=servers {
            net.add(Party::Extended(Box::new(offloaded(id))));
        }
        let index = begin_with(&mut net, Faults::default(), work(CANDIDATES, &SEEDS));
        let all = net.finish(index);
        net.journal(index);
        let episodes = SEEDS.len();
        let only: Vec<Repetition> = (0..CANDIDATES)
            .step_by(3)
            .map(|candidate| Repetition {
                candidate,
                episode: candidate % episodes,
                before: Some(1 + candidate as u64 % servers),
            })
            .collect();
        let again = work(CANDIDATES, &SEEDS).only(only.clone()).unwrap();
        net.submit(index, again);
        let repeated = net.finish(index);
        let place = |one: &Repetition| one.candidate * episodes + one.episode;
        for (number, (first, second)) in all.iter().zip(&repeated).enumerate() {
            let is_asked = only.iter().any(|one| place(one) == number);
            assert!(if is_asked {
                first == second
            } else {
                second.is_nan()
            });
        }
        let journal = net.journal(index);
        assert_eq!(journal.len(), only.len());
        for one in &only {
            let attempt = journal
                .iter()
                .find(|made| (made.candidate, made.episode) == (one.candidate, one.episode))
                .unwrap();
            assert_eq!((attempt.candidates, attempt.episodes), (1, 1));
            assert_eq!(Some(attempt.server) == one.before, servers == 1);
        }
        // Further work is evaluated as usual.
        net.submit(index, work(CANDIDATES, &SEEDS));
        assert_eq!(net.finish(index), all);
    }
}

#[test]
fn evaluations_of_other_work_are_not_repeated() {
    for (candidate, episode) in [(CANDIDATES, 0), (0, SEEDS.len())] {
        let repetition = Repetition {
            candidate,
            episode,
            before: None,
        };
        let error = work(CANDIDATES, &SEEDS).only(vec![repetition]).unwrap_err();
        assert!(error.to_string().starts_with("only[0]: candidate"));
    }
}
