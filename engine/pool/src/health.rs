//! How servers have behaved: what is remembered of an id, also while no server has it.

use std::collections::BTreeMap;
use std::time::{Duration, Instant};

/// The pause after a first failure; it doubles with each further one in a row.
const FIRST_PAUSE: Duration = Duration::from_secs(1);
const LONGEST_PAUSE: Duration = Duration::from_secs(60);

/// What is remembered of one id.
#[derive(Debug, Clone, Default)]
struct Past {
    /// Failures in a row, and why it failed last.
    failures: u32,
    reason: String,
    /// Not before this time again.
    until: Option<Instant>,
    /// Its results were wrong: it is not used any more.
    distrusted: bool,
}

/// The past of all ids.
#[derive(Debug, Default)]
pub(crate) struct Health(BTreeMap<u64, Past>);

impl Health {
    /// A server failed: a pause that grows with each failure in a row. Returns its end.
    pub fn failed(&mut self, id: u64, reason: &str, now: Instant) -> Instant {
        let past = self.0.entry(id).or_default();
        past.failures += 1;
        reason.clone_into(&mut past.reason);
        let pause = FIRST_PAUSE * 2u32.saturating_pow((past.failures - 1).min(6));
        let until = now + pause.min(LONGEST_PAUSE);
        past.until = Some(until);
        until
    }

    /// A server did what it was asked for.
    pub fn recovered(&mut self, id: u64) {
        if let Some(past) = self.0.get_mut(&id) {
            past.failures = 0;
            past.until = None;
        }
    }

    /// What was held against it last was none of its fault.
    pub fn forgive(&mut self, id: u64) {
        if let Some(past) = self.0.get_mut(&id) {
            past.failures = past.failures.saturating_sub(1);
            past.until = None;
        }
    }

    /// Its results were wrong.
    pub fn distrust(&mut self, id: u64, reason: &str) {
        let past = self.0.entry(id).or_default();
        past.distrusted = true;
        reason.clone_into(&mut past.reason);
    }

    /// Why it is not to be used any more, if so.
    pub fn distrusted(&self, id: u64) -> Option<&str> {
        let past = self.0.get(&id)?;
        past.distrusted.then_some(&*past.reason)
    }

    /// Until when a server that appears now has to wait: one that was started anew has one failure free.
    pub fn pause(&self, id: u64, now: Instant) -> Option<Instant> {
        let past = self.0.get(&id).filter(|past| past.failures > 1)?;
        past.until.filter(|until| *until > now)
    }

    /// Failures in a row and the last one's reason, if there are any.
    pub fn failures(&self, id: u64) -> Option<(u32, &str)> {
        let past = self.0.get(&id).filter(|past| past.failures > 0)?;
        Some((past.failures, &past.reason))
    }
}
