//! Timer for checking again whether an idle server should get work or a backup copy.

use std::time::Instant;

#[derive(Debug, Default)]
pub(crate) struct Recheck(Option<Instant>);

impl Recheck {
    pub fn at(&self) -> Option<Instant> {
        self.0
    }

    /// Sets the time of the next check.
    pub fn set(&mut self, at: Instant) {
        self.0 = Some(at);
    }

    /// Moves the next check to this time, if it is earlier.
    pub fn hasten(&mut self, at: Instant) {
        self.0 = Some(self.0.map_or(at, |before| before.min(at)));
    }

    pub fn clear(&mut self) {
        self.0 = None;
    }

    /// Returns whether the next check is in the future.
    pub fn is_ahead(&self, now: Instant) -> bool {
        self.0.is_some_and(|at| at > now)
    }
}
