//! Servers that do not report on work that others have finished in the meantime.

use std::time::Instant;

use swarmwright_protocol::Waiting;

use crate::scheduler::fleet::Fleet;
use crate::scheduler::fleet::slot::Overtaken;

impl Fleet {
    /// Records that other servers have finished work of a server that has been silent `since`: until it answers, it
    /// gets only single evaluations that no result depends on.
    pub fn was_overtaken(&mut self, id: u64, first: Waiting, since: Instant) {
        if let Some(slot) = self.slots.get_mut(&id) {
            slot.overtaken.get_or_insert(Overtaken { first, since });
            self.health.overtaken(id);
        }
    }

    /// Returns the unanswered work of overtaken servers, by server.
    pub fn overtaken(&self, now: Instant) -> Vec<Waiting> {
        let overtaken = self.slots().filter_map(|(_, slot)| slot.overtaken.as_ref());
        overtaken
            .map(|entry| Waiting {
                silent: now.saturating_duration_since(entry.since).as_secs_f64(),
                ..entry.first.clone()
            })
            .collect()
    }
}
