//! Rounds of discovery: when the next one is due, and which one an answer belongs to.

use std::collections::VecDeque;
use std::time::{Duration, Instant};

/// Pause between two rounds of discovery while there is no server; it doubles up to `LATER_ROUND`.
const FIRST_ROUND: Duration = Duration::from_millis(100);
const LATER_ROUND: Duration = Duration::from_secs(2);
/// How long a new server waits for its first work, where two servers may share an id.
pub(crate) const PROBATION: Duration = Duration::from_millis(30);
/// Number of servers up to which rounds follow each other without a pause. Every server receives every round, so with
/// more servers, each further one adds `PAUSE_PER_SERVER` between two rounds, up to `LATER_ROUND`.
const FEW_SERVERS: usize = 16;
const PAUSE_PER_SERVER: Duration = Duration::from_millis(10);
/// Number of recent rounds whose answers are accepted.
const ROUNDS: usize = 16;

#[derive(Debug)]
pub(crate) struct Discovery {
    /// Hash and number of each recent round.
    rounds: VecDeque<(String, u64)>,
    round: u64,
    last: Option<Instant>,
    next: Instant,
    pause: Duration,
}

impl Discovery {
    pub fn new(now: Instant) -> Self {
        Self {
            rounds: VecDeque::new(),
            round: 0,
            last: None,
            next: now,
            pause: FIRST_ROUND,
        }
    }

    /// Returns the number of the last round; 0 before the first.
    pub fn round(&self) -> u64 {
        self.round
    }

    /// Returns the number of the round with a hash.
    pub fn round_of(&self, hash: &str) -> Option<u64> {
        let mut rounds = self.rounds.iter();
        let entry = rounds.find(|(sent, _)| *sent == hash);
        entry.map(|(_, round)| *round)
    }

    /// Returns the number of rounds whose answers are accepted.
    pub fn understood(&self) -> usize {
        self.rounds.len()
    }

    /// Returns when the next round is due.
    pub fn next(&self) -> Instant {
        self.next
    }

    /// Makes sure that the next round comes within `LATER_ROUND` of now.
    pub fn work_began(&mut self, now: Instant) {
        self.next = self.next.min(now + LATER_ROUND);
    }

    /// Brings the next round forward after a change, keeping the pause that this many servers require.
    pub fn hasten(&mut self, servers: usize, now: Instant) {
        let many = u32::try_from(servers.saturating_sub(FEW_SERVERS)).unwrap_or(u32::MAX);
        let pause = PAUSE_PER_SERVER.saturating_mul(many);
        let at = self.last.map_or(now, |last| last + pause.min(LATER_ROUND));
        self.next = self.next.min(at.max(now));
    }

    /// Postpones the next round by `LATER_ROUND`.
    pub fn postpone(&mut self, now: Instant) {
        self.next = now + LATER_ROUND;
    }

    /// Restarts discovery with a round that is due at once.
    pub fn restart(&mut self, now: Instant) {
        self.pause = FIRST_ROUND;
        self.next = now;
    }

    /// Begins a round. `has_server`: whether any server is known. `within`: time within which the servers must be
    /// known.
    pub fn begin(
        &mut self,
        hash: String,
        has_server: bool,
        within: Option<Duration>,
        now: Instant,
    ) {
        self.round += 1;
        self.last = Some(now);
        self.rounds.push_back((hash, self.round));
        if self.rounds.len() > ROUNDS {
            self.rounds.pop_front();
        }
        self.pause = if has_server {
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rounds_of_many_servers_have_a_pause() {
        let start = Instant::now();
        let later = start + Duration::from_millis(100);
        let next = |servers| {
            let mut discovery = Discovery::new(start);
            discovery.begin("hash".to_owned(), true, None, start);
            discovery.hasten(servers, later);
            discovery.next() - start
        };
        assert_eq!(next(1), Duration::from_millis(100));
        assert_eq!(next(FEW_SERVERS), Duration::from_millis(100));
        assert_eq!(next(100), Duration::from_millis(840));
        assert_eq!(next(10_000), LATER_ROUND);
    }
}
