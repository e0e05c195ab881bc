//! Rate-limited log lines about clients; otherwise, a client could fill the disk with them.

use std::time::{Duration, Instant};

/// Largest number of lines per kind in each [`PERIOD`].
const LINES: u32 = 20;
const PERIOD: Duration = Duration::from_secs(10);

/// Kind of a line; each kind is limited separately.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Kind {
    /// A denied publication.
    Denied,
    /// A refused connection.
    Refused,
    /// A disconnected client.
    Disconnected,
    /// Something that exceeds a limit on stored data.
    Full,
}

/// Counts of lines by kind.
#[derive(Default)]
pub struct Complaints {
    kinds: [Tally; 4],
}

#[derive(Default, Clone, Copy)]
struct Tally {
    since: Option<Instant>,
    count: u32,
}

impl Complaints {
    /// Logs a warning, unless there were too many of its kind.
    pub fn say(&mut self, kind: Kind, now: Instant, text: impl FnOnce() -> String) {
        self.sweep_one(kind as usize, now);
        let tally = &mut self.kinds[kind as usize];
        tally.since.get_or_insert(now);
        tally.count += 1;
        if tally.count <= LINES {
            log::warn!("{}", text());
        }
    }

    /// Logs the number of suppressed lines once the period is over.
    pub fn sweep(&mut self, now: Instant) {
        for kind in 0..self.kinds.len() {
            self.sweep_one(kind, now);
        }
    }

    fn sweep_one(&mut self, kind: usize, now: Instant) {
        let tally = &mut self.kinds[kind];
        if tally
            .since
            .is_some_and(|since| now.saturating_duration_since(since) >= PERIOD)
        {
            let left_out = tally.count.saturating_sub(LINES);
            if left_out > 0 {
                let events = [
                    "denied messages",
                    "refused connections",
                    "disconnected clients",
                    "messages or subscriptions over a limit",
                ][kind];
                log::warn!(
                    "{left_out} more {events} in the last {} s",
                    PERIOD.as_secs()
                );
            }
            *tally = Tally::default();
        }
    }

    #[cfg(test)]
    pub fn count(&self, kind: Kind) -> u32 {
        self.kinds[kind as usize].count
    }
}
