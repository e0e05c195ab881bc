//! Decides which servers must prove that they are sound, and whether to discover more.

use crate::scheduler::view::View;

impl View<'_> {
    /// Returns the idle servers that must repeat an evaluation that succeeded before.
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

    /// Returns whether to start a discovery, to find more servers or to check that one is still online. Discovery is
    /// avoided otherwise because a server that another tool uses takes it as a request. `first`: no work has begun yet.
    pub fn wants_servers(&self, first: bool) -> bool {
        let looking = first || !self.ledger.finished();
        let few = self.fleet.is_empty() || self.fleet.slots().any(|(_, slot)| !slot.usable());
        // Another tool may have got the server first; see `preempted`.
        let waiting = self.in_flight.episodes().any(|episode| !episode.begun());
        // Whether other servers are silent, too, helps to find the cause of a loss.
        let suspects = self.ledger.attribution().has_suspects();
        self.ledger.queued() > 0 || waiting || suspects || (looking && few)
    }
}
