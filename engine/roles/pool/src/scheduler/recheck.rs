//! When to look again whether an idle server should get work that others should do first, or a copy of theirs.

use std::time::Instant;

#[derive(Debug, Default)]
pub(crate) struct Recheck(Option<Instant>);

impl Recheck {
    pub fn at(&self) -> Option<Instant> {
        self.0
    }

    /// Not before this time.
    pub fn set(&mut self, at: Instant) {
        self.0 = Some(at);
    }

    /// Not later than at this time.
    pub fn hasten(&mut self, at: Instant) {
        self.0 = Some(self.0.map_or(at, |before| before.min(at)));
    }

    pub fn clear(&mut self) {
        self.0 = None;
    }

    /// Whether its time has not come.
    pub fn is_ahead(&self, now: Instant) -> bool {
        self.0.is_some_and(|at| at > now)
    }
}
