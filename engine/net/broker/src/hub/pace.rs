//! Decisions about which clients are read later.

use super::{Hub, STANDSTILL};
use std::time::Instant;

impl Hub {
    /// Returns whether reading from this client is delayed: it is too fast, does not read the answers to its packets,
    /// waits for retained messages, or publishes while memory is short or an active reader is far behind.
    pub fn is_held(&mut self, id: usize, now: Instant) -> bool {
        if self.is_too_fast(id, now) {
            return true;
        }
        // The connection may have ended since it became readable.
        let Some(link) = self.links.get(id) else {
            return false;
        };
        if link.asked.is_some() || link.is_behind() || self.must_wait(link, now) {
            return true;
        }
        let Some(reader) = link.held_by else {
            return false;
        };
        let held = self.links.get(reader).is_some_and(|reader| {
            !reader.closing
                && reader.out.len() > self.limits.backlog / 2
                && now - reader.progress < STANDSTILL
        });
        if !held {
            self.links[id].held_by = None;
        }
        held
    }

    /// Returns whether this client has exceeded its packet rate, so that reading from it is delayed.
    fn is_too_fast(&mut self, id: usize, now: Instant) -> bool {
        let Some(link) = self.links.get_mut(id).filter(|link| link.allowance < 0.0) else {
            return false;
        };
        let rate = f64::from(self.limits.rate);
        let passed = now.saturating_duration_since(link.allowed_at).as_secs_f64();
        link.allowance = (link.allowance + rate * passed).min(rate);
        link.allowed_at = now;
        link.allowance < 0.0
    }
}
