//! Log lines about clients, limited in number: a client that causes log lines could otherwise fill the disk.

use std::time::{Duration, Instant};

/// Lines of one kind that are written in each [`PERIOD`].
const LINES: u32 = 20;
const PERIOD: Duration = Duration::from_secs(10);

/// What a line is about; lines are limited for each kind separately.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Kind {
    /// A message that a client may not publish.
    Denied,
    /// A connection that was refused.
    Refused,
    /// A client that was disconnected.
    Disconnected,
    /// Something that does not fit into a store.
    Full,
}

/// Counts lines.
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
    /// Writes a warning, unless there were too many of its kind.
    pub fn say(&mut self, kind: Kind, now: Instant, text: impl FnOnce() -> String) {
        self.sweep_one(kind as usize, now);
        let tally = &mut self.kinds[kind as usize];
        tally.since.get_or_insert(now);
        tally.count += 1;
        if tally.count <= LINES {
            log::warn!("{}", text());
        }
    }

    /// Logs how many lines were left out, once the period is over.
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
