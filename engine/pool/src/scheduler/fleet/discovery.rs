//! Rounds of discovery: when one is due, and which one an answer belongs to.

use std::collections::VecDeque;
use std::time::{Duration, Instant};

/// Pause between two rounds of discovery while no server is there; it doubles up to `LATER_ROUND`.
const FIRST_ROUND: Duration = Duration::from_millis(100);
const LATER_ROUND: Duration = Duration::from_secs(2);
/// How long a server that is new waits for its first work, where two may have one id.
pub(crate) const PROBATION: Duration = Duration::from_millis(30);
/// Rounds whose answers are still understood.
const ROUNDS: usize = 16;

#[derive(Debug)]
pub(crate) struct Discovery {
    /// Hash and number of each of the last rounds.
    rounds: VecDeque<(String, u64)>,
    round: u64,
    next: Instant,
    pause: Duration,
}

impl Discovery {
    pub fn new(now: Instant) -> Self {
        Self {
            rounds: VecDeque::new(),
            round: 0,
            next: now,
            pause: FIRST_ROUND,
        }
    }

    /// The number of the last round; 0 before the first.
    pub fn round(&self) -> u64 {
        self.round
    }

    /// The number of the round that was asked with a hash.
    pub fn round_of(&self, hash: &str) -> Option<u64> {
        let mut rounds = self.rounds.iter();
        let found = rounds.find(|(asked, _)| *asked == hash);
        found.map(|(_, round)| *round)
    }

    /// Rounds whose answers are understood.
    pub fn understood(&self) -> usize {
        self.rounds.len()
    }

    /// When the next round is due.
    pub fn next(&self) -> Instant {
        self.next
    }

    /// The next round is not to be later than the usual pause from now.
    pub fn work_began(&mut self, now: Instant) {
        self.hasten(now + LATER_ROUND);
    }

    /// The next round is not to be later than at this time.
    pub fn hasten(&mut self, at: Instant) {
        self.next = self.next.min(at);
    }

    /// No round is needed for a while.
    pub fn postpone(&mut self, now: Instant) {
        self.next = now + LATER_ROUND;
    }

    /// Begins anew, at once.
    pub fn restart(&mut self, now: Instant) {
        self.pause = FIRST_ROUND;
        self.next = now;
    }

    /// A round begins. `found`: whether a server is there. `within`: who is there must be known within this time.
    pub fn begin(&mut self, hash: String, found: bool, within: Option<Duration>, now: Instant) {
        self.round += 1;
        self.rounds.push_back((hash, self.round));
        if self.rounds.len() > ROUNDS {
            self.rounds.pop_front();
        }
        self.pause = if found {
            LATER_ROUND
        } else {
            (self.pause * 2).min(LATER_ROUND)
        };
        if let Some(within) = within {
            self.pause = self.pause.min((within / 4).max(FIRST_ROUND));
        }
        self.next = now + self.pause;
    }
}
