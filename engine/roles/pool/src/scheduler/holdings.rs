//! What the scheduler remembers: that it does not grow without bound can be seen.

use crate::scheduler::Scheduler;

/// How much a scheduler holds.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Holdings {
    /// Evaluations that wait for a server.
    pub queued: usize,
    /// Stepwise episodes under way.
    pub episodes: usize,
    /// Blocks and batches under way.
    pub requests: usize,
    /// Rounds of discovery whose answers are understood.
    pub rounds: usize,
    /// Servers that may be used.
    pub servers: usize,
    /// Warnings that are not made again.
    pub warned_once: usize,
}

impl Scheduler {
    /// How much it holds now.
    #[must_use]
    pub fn holdings(&self) -> Holdings {
        let (episodes, requests) = self.in_flight.len();
        Holdings {
            queued: self.ledger.queued(),
            episodes,
            requests,
            rounds: self.discovery.understood(),
            servers: self.fleet.len(),
            warned_once: self.outbox.warned_once(),
        }
    }

    /// Whether a server has no work of this tool.
    #[must_use]
    pub fn has_nothing_on(&self, server: u64) -> bool {
        let slot = self.fleet.slot(server);
        slot.is_none_or(|slot| slot.jobs.is_empty())
    }

    /// Whether a server has no work of this tool although there is some for it: it has no pause after failures, and what
    /// waits need not wait for another server. True of a server that is not known.
    #[must_use]
    pub fn is_idle(&self, server: u64) -> bool {
        self.fleet.slot(server).is_none_or(|slot| {
            let servers: Vec<u64> = self.fleet.usable().map(|(id, _)| id).collect();
            slot.jobs.is_empty() && slot.usable() && self.ledger.has_for(server, &servers)
        })
    }
}
