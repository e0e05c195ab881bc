//! Which evaluations one thread does alone.

use std::time::Duration;

use swarmwright_worlds::Pace;

/// 50 and 500 microseconds, of parts of 30 milliseconds.
const MODEST: usize = 600;
const ALONE: usize = 60;

/// What is known after the first evaluations.
fn begun(evaluations: usize, threads: usize, micros: u64) -> Pace {
    let pace = Pace::new(Duration::from_millis(30), 32);
    assert!(!pace.is_less(MODEST, 32, 16), "nothing is known");
    pace.note(evaluations, threads, Duration::from_micros(micros));
    pace
}

#[test]
fn what_one_thread_does_quickly_it_does_alone() {
    // 256 take two threads 25 microseconds, and one alone 20 or 80.
    for (micros, alone) in [(20, true), (80, false)] {
        let pace = begun(256, 2, 25);
        assert!(pace.is_less(MODEST, 256, 2), "it is tried");
        pace.note(256, 1, Duration::from_micros(micros));
        assert_eq!(pace.is_less(MODEST, 256, 2), alone);
        assert!(pace.is_less(ALONE, 256, 2));
    }
    assert!(!begun(256, 2, 2000).is_less(ALONE, 256, 2), "all take long");
}

#[test]
fn an_interruption_is_forgotten() {
    let pace = begun(256, 2, 25);
    pace.note(256, 1, Duration::from_micros(20));
    pace.note(256, 1, Duration::from_millis(4));
    assert!(pace.is_less(MODEST, 128, 2), "half as fast at most");
    for _ in 0..8 {
        pace.note(256, 1, Duration::from_millis(4));
    }
    assert!(!pace.is_less(ALONE, 256, 2), "it is slow indeed");
    let tried = (0..500).find(|_| {
        pace.note(256, 2, Duration::from_micros(100));
        pace.is_less(MODEST, 256, 2)
    });
    assert!(tried.is_some_and(|calls| calls > 10), "{tried:?}");
    pace.note(256, 1, Duration::from_micros(20));
    assert!(pace.is_less(MODEST, 256, 2));
}
