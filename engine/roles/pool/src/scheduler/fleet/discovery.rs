//! Rounds of discovery: when one is due, and which one an answer belongs to.

use std::collections::VecDeque;
use std::time::{Duration, Instant};

/// Pause between two rounds of discovery while no server is there; it doubles up to `LATER_ROUND`.
const FIRST_ROUND: Duration = Duration::from_millis(100);
const LATER_ROUND: Duration = Duration::from_secs(2);
/// How long a server that is new waits for its first work, where two may have one id.
pub(crate) const PROBATION: Duration = Duration::from_millis(30);
/// All servers hear each round. Where there are more than so many, not each one that comes or becomes free may cause one of
/// its own: there is a pause for each further server between two rounds, up to `LATER_ROUND`.
const FEW_SERVERS: usize = 16;
const PAUSE_PER_SERVER: Duration = Duration::from_millis(10);
/// Rounds whose answers are still understood.
const ROUNDS: usize = 16;

#[derive(Debug)]
pub(crate) struct Discovery {
    /// Hash and number of each of the last rounds.
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

    /// The number of the last round; 0 before the first.
    pub fn round(&self) -> u64 {
        self.round
    }

    /// The number of the round that was asked with a hash.
    pub fn round_of(&self, hash: &str) -> Option<u64> {
        let mut rounds = self.rounds.iter();
        let entry = rounds.find(|(sent, _)| *sent == hash);
        entry.map(|(_, round)| *round)
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
        self.next = self.next.min(now + LATER_ROUND);
    }

    /// Something has changed: the next round is not to be later than the pause that so many servers need.
    pub fn hasten(&mut self, servers: usize, now: Instant) {
        let many = u32::try_from(servers.saturating_sub(FEW_SERVERS)).unwrap_or(u32::MAX);
        let pause = PAUSE_PER_SERVER.saturating_mul(many);
        let at = self.last.map_or(now, |last| last + pause.min(LATER_ROUND));
        self.next = self.next.min(at.max(now));
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

    /// A round begins. `has_server`: whether a server is there. `within`: who is there must be known within this time.
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
