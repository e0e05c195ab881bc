use std::time::{Duration, Instant};

use super::failures::{Failed, Loss};
use super::*;
use crate::scheduler::queue::blame::Blame;
use crate::sections::Faults;

const ARCHITECTURE: &str = r#"{"version": 1, "kind": "layered", "sensors": 1, "actuators": 1, "hidden": [],
    "activation": "tanh", "output_range": [-1, 1]}"#;

fn ledger(candidates: usize, episodes: u64) -> Ledger {
    let work = Work::new(
        ARCHITECTURE,
        vec![0.5; 2 * candidates],
        (0..episodes).collect(),
    );
    Ledger::new(work.unwrap(), 0)
}

#[test]
fn pieces_are_rectangles_and_cover_everything_once() {
    for (candidates, episodes, most) in [
        (7, 3, 1),
        (7, 3, 2),
        (7, 3, 3),
        (7, 3, 7),
        (5, 1, 2),
        (1, 10, 4),
        (4, 2, 100),
    ] {
        let mut ledger = ledger(candidates, episodes);
        let mut next = 0;
        while let Some(piece) = ledger.take(1, &[1], most) {
            assert_eq!(piece.first(), next);
            let (rows, columns) = ledger.extent(&piece);
            assert_eq!(rows.len() * columns.len(), piece.len());
            assert!(piece.len() <= most);
            for index in piece.evaluations.clone() {
                ledger.settle(index, 1, 1.0, &[]);
            }
            next += piece.len();
        }
        assert!(ledger.finished());
        assert_eq!((ledger.queued(), next), (0, ledger.done()));
    }
}

#[test]
fn what_is_settled_is_not_queued_again() {
    let mut ledger = ledger(4, 2);
    let piece = ledger.take(1, &[1], 8).unwrap();
    for index in [0, 3, 4, 7] {
        ledger.settle(index, 1, 1.0, &[]);
    }
    ledger.put_back(&piece);
    assert_eq!(ledger.queued(), 4);
    let rest: Vec<_> = std::iter::from_fn(|| ledger.take(1, &[1], 8))
        .map(|piece| piece.evaluations)
        .collect();
    assert_eq!(rest, [1..2, 2..3, 5..6, 6..7]);
}

#[test]
fn work_that_grows_is_handed_out_once_and_forgotten_when_it_has_ended() {
    let mut ledger = ledger(4, 2);
    let (mut seen, mut made) = (Vec::new(), 4);
    let mut next = 0;
    while let Some(piece) = ledger.take(1, &[1], 3) {
        assert_eq!(piece.first(), next);
        next += piece.len();
        for index in piece.evaluations.clone().rev() {
            ledger.settle(index, 1, f64::from(u32::try_from(index).unwrap()), &[]);
            ledger.settle(index, 1, -1.0, &[]);
        }
        let settled = ledger.take_settled();
        for (row, candidate) in settled.candidates.iter().enumerate() {
            let first = f64::from(u32::try_from(2 * candidate).unwrap());
            assert_eq!(settled.fitness[2 * row..][..2], [first, first + 1.0]);
            seen.push(*candidate);
            if made < 20_000 {
                ledger.extend(&[0.5; 2]).unwrap();
                made += 1;
            }
        }
        assert!(ledger.settled.len() < 4 * MIN_FORGOTTEN);
        // Late results for forgotten evaluations change nothing.
        ledger.settle(0, 1, -1.0, &[]);
        ledger.put_back(&piece);
        assert!(ledger.queued() <= 8);
    }
    seen.sort_unstable();
    assert_eq!(seen, (0..20_000).collect::<Vec<_>>());
    assert!(ledger.finished());
    assert!(ledger.forgotten > 0);
    assert_eq!(
        ledger.extend(&[f32::NAN, 0.0]),
        Err(WorkError::NotFinite {
            candidate: 0,
            weight: 0
        })
    );
}

#[test]
fn what_was_handed_out_is_handed_out_again_where_work_is_revised() {
    for revised in [false, true] {
        let work = Work::new(ARCHITECTURE, vec![0.5; 8], vec![1, 2]).unwrap();
        let mut ledger = Ledger::new(if revised { work.revised() } else { work }, 0);
        while ledger.take(1, &[1, 2], 8).is_some() {}
        for evaluation in 0..7 {
            ledger.settle(evaluation, 1 + u64::from(evaluation > 1), 1.0, &[]);
        }
        assert_eq!(ledger.take_settled().candidates, [0, 1, 2]);
        ledger.settle(7, 1, 1.0, &[]);
        // Only one episode of the last candidate is from that server, and it has not been returned.
        let found = ledger.reopen(1);
        if !revised {
            assert_eq!(found, (1, 2));
            continue;
        }
        assert_eq!(found, (3, 0));
        assert!(!ledger.finished());
        while let Some(piece) = ledger.take(2, &[1, 2], 8) {
            for evaluation in piece.evaluations {
                ledger.settle(evaluation, 2, 2.0, &[]);
            }
        }
        let settled = ledger.take_settled();
        assert_eq!(settled.candidates, [0, 3]);
        assert_eq!(settled.fitness, [2.0, 2.0, 1.0, 2.0]);
        assert!(ledger.finished());
    }
}

#[test]
fn what_failed_goes_to_others_first_and_in_ever_smaller_parts() {
    let mut ledger = ledger(64, 1);
    let piece = ledger.take(1, &[1, 2], 64).unwrap();
    ledger.put_back(&piece.failed(1));
    assert_eq!(ledger.take(1, &[1, 2], 64), None);
    let again = ledger.take(2, &[1, 2], 64).unwrap();
    assert_eq!(again.evaluations, 0..8);
    ledger.put_back(&again.failed(2));
    assert_eq!(ledger.take(1, &[1, 2], 64).unwrap().evaluations, 0..1);
    // The piece has failed on all servers; the rest waits for the other server.
    assert_eq!(ledger.take(2, &[1, 2], 64).unwrap().evaluations, 1..2);
}

#[test]
fn a_piece_that_is_settled_as_a_whole_is_settled_as_one_by_one() {
    for (candidates, episodes, most) in [(7, 3, 1), (7, 3, 2), (7, 3, 7), (5, 1, 2), (1, 10, 4)] {
        let [mut whole, mut single] = [0; 2].map(|_| ledger(candidates, episodes));
        for server in 1.. {
            let Some(piece) = whole.take(server, &[server], most) else {
                break;
            };
            assert_eq!(single.take(server, &[server], most), Some(piece.clone()));
            let fitness: Vec<f64> = piece
                .evaluations
                .clone()
                .map(|one| f64::from(u32::try_from(one).unwrap()))
                .collect();
            assert!(whole.settle_whole(&piece.evaluations, server, &fitness));
            assert!(!whole.settle_whole(&piece.evaluations, server, &fitness));
            for (index, fitness) in piece.evaluations.clone().zip(fitness) {
                assert!(single.settle(index, server, fitness, &[]));
            }
            assert_eq!(format!("{whole:?}"), format!("{single:?}"));
        }
        assert!(whole.finished());
    }
}

#[test]
fn a_piece_of_which_another_server_has_a_part_is_not_settled_as_a_whole() {
    let mut ledger = ledger(8, 1);
    let piece = ledger.take(1, &[1, 2], 8).unwrap();
    ledger.hold(&piece.part(3..4));
    let before = format!("{ledger:?}");
    assert!(!ledger.settle_whole(&piece.evaluations, 1, &[1.0; 8]));
    assert_eq!(format!("{ledger:?}"), before);
    assert!(ledger.settle_whole(&(4..8), 1, &[1.0; 4]));
    assert!(!ledger.settle_whole(&(3..5), 1, &[1.0; 2]));
}

/// A failure of a piece on a server that had just succeeded with other work.
fn failed(blame: Blame) -> Failed<'static> {
    Failed {
        server: 1,
        instance: None,
        reason: "it broke",
        blame,
        sound: true,
        at: Instant::now(),
    }
}

#[test]
fn what_the_server_is_not_to_blame_for_waits_again_as_it_was() {
    for (blame, most) in [(Blame::None, 4), (Blame::Lost, 4), (Blame::Broker, 2)] {
        let mut ledger = ledger(2, 2);
        let piece = ledger.take(1, &[1], 4).unwrap();
        assert!(!ledger.failed(piece, failed(blame), false, &Faults::default()));
        let again = ledger.take(1, &[1], 4).unwrap();
        assert_eq!((again.len(), again.tries, again.late), (most, 0, 0));
    }
}

#[test]
fn several_that_failed_together_are_tried_again_in_smaller_parts() {
    let silent = Blame::Silent { others: true };
    for (blame, late) in [(Blame::Evaluation, 0), (Blame::Crash, 0), (silent, 1)] {
        let mut ledger = ledger(8, 2);
        let piece = ledger.take(1, &[1], 16).unwrap();
        assert!(ledger.failed(piece, failed(blame), false, &Faults::default()));
        assert!(ledger.attribution().is_empty());
        let again = ledger.take(2, &[1, 2], 16).unwrap();
        assert_eq!((again.len(), again.tries, again.late), (2, 1, late));
        assert!(again.has_failed_on(1));
    }
}

#[test]
fn one_that_failed_alone_is_put_aside_after_its_last_attempt() {
    let mut ledger = ledger(2, 1);
    let faults = Faults {
        attempts: 2,
        ..Faults::default()
    };
    for (attempt, again) in [(1, true), (2, false)] {
        let piece = ledger.take(attempt, &[1, 2], 1).unwrap();
        assert_eq!(piece.evaluations, 0..1);
        let failed = Failed {
            server: attempt,
            ..failed(Blame::Evaluation)
        };
        assert_eq!(ledger.failed(piece, failed, true, &faults), again);
    }
    assert!(ledger.attribution().any_aside());
    assert_eq!(ledger.queued(), 1);
}

#[test]
fn what_has_ended_meanwhile_is_not_tried_again() {
    let mut ledger = ledger(2, 1);
    let piece = ledger.take(1, &[1], 1).unwrap();
    ledger.settle(0, 2, 1.0, &[]);
    assert!(!ledger.failed(piece, failed(Blame::Crash), true, &Faults::default()));
    assert_eq!((ledger.queued(), ledger.done()), (1, 1));
}

#[test]
fn a_loss_counts_of_a_proven_server_at_one_evaluation_alone() {
    let (faults, start) = (Faults::default(), Instant::now());
    let gone = |blame: Blame, length: usize, proven: bool, shared: bool| {
        let mut ledger = ledger(4, 1);
        let piece = ledger.take(1, &[1], length).unwrap();
        if proven {
            ledger
                .attribution_mut()
                .succeeded(1, 10, None, |other| other == 1);
        }
        if shared {
            ledger.hold(&piece);
        }
        ledger.lost(&piece, 1, blame, &faults, start)
    };
    let counts = |blame, length, proven, shared| gone(blame, length, proven, shared).counts;
    assert!(counts(Blame::Gone, 1, true, false));
    assert!(!counts(Blame::Gone, 2, true, false), "with others");
    assert!(!counts(Blame::Gone, 1, false, false), "not proven");
    assert!(!counts(Blame::Gone, 1, true, true), "elsewhere, too");
    assert!(counts(Blame::Silent { others: true }, 1, true, false));
    assert!(!counts(Blame::Silent { others: false }, 1, true, false));
    assert!(!counts(Blame::Lost, 1, true, false), "not begun");
    assert_eq!(gone(Blame::Gone, 1, true, false).hopeless, None);
}

#[test]
fn servers_lost_at_the_same_time_have_another_cause() {
    let (faults, start) = (Faults::default(), Instant::now());
    let mut ledger = ledger(4, 1);
    let pieces = [1, 2].map(|server| ledger.take(server, &[1, 2], 1).unwrap());
    let mut lost = |index: usize, seconds: u64| {
        let server = index as u64 + 1;
        ledger
            .attribution_mut()
            .succeeded(server, 10, None, |_| false);
        let now = start + Duration::from_secs(seconds);
        ledger.lost(&pieces[index], server, Blame::Gone, &faults, now)
    };
    assert!(lost(0, 0).counts);
    assert!(!lost(1, 1).counts);
    let later: Vec<Loss> = (1..20).map(|times| lost(1, 60 * times)).collect();
    assert!(later[0].counts && later[0].hopeless.is_none());
    assert_eq!(later[10].hopeless, Some(12));
}
