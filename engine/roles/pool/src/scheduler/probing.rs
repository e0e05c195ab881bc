//! Decides which servers must show that they work, and whether to discover more.

use crate::scheduler::view::View;

impl View<'_> {
    /// The servers that have nothing to do and are to evaluate what succeeded before.
    pub fn probes_due(&self) -> Vec<u64> {
        let awaited = self.ledger.attribution().awaited();
        let supervised = awaited.iter().any(|id| self.processes.are_watched(*id));
        let waits = self.ledger.queued() > 0;
        let servers = self.fleet.servers();
        let slots = self.fleet.slots();
        let idle = slots.filter(|(_, slot)| {
            slot.jobs.is_empty() && slot.backs_off_until.is_none() && !slot.silent
        });
        let is_due = |id: u64| {
            self.fleet.health().is_doubtful(id)
                || awaited.contains(&id)
                || (supervised && self.processes.are_watched(id))
                || (waits && self.ledger.waits_for_proof(id, &servers))
        };
        idle.map(|(id, _)| id).filter(|id| is_due(*id)).collect()
    }

    /// Whether more servers are of use, or one should say that it is still there. A server that others use takes a
    /// question for a wish. `first`: no work has begun yet.
    pub fn wants_servers(&self, first: bool) -> bool {
        let looking = first || !self.ledger.finished();
        let few = self.fleet.is_empty() || self.fleet.slots().any(|(_, slot)| !slot.usable());
        // Another tool may have been faster on its server; see `preempted`.
        let waiting = self.in_flight.episodes().any(|episode| !episode.begun());
        // Whether others are silent, too, tells what to think of one that is lost.
        let suspects = self.ledger.attribution().has_suspects();
        self.ledger.queued() > 0 || waiting || suspects || (looking && few)
    }
}
