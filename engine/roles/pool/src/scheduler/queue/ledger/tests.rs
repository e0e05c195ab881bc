use super::*;

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
        // What comes late for something forgotten changes nothing.
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
        // Of the last candidate, only one episode is that server's, and it has not been handed out.
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
    // No server is left that has not failed it; the rest waits for the other one.
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
