//! Which servers find the same again, and how far the results of two may differ.

use swarmwright_protocol::Announcement;

use crate::scheduler::fleet::Fleet;

impl Fleet {
    fn announcement(&self, id: u64) -> Option<&Announcement> {
        self.slots.get(&id)?.capabilities.swarmwright.as_ref()
    }

    /// Whether a server declares that it finds the same again, to the bit.
    pub fn repeats_itself(&self, id: u64) -> bool {
        let declared =
            |announced: &Announcement| announced.determinism.as_deref() == Some("bitwise");
        self.announcement(id).is_some_and(declared)
    }

    /// Whether what a server finds can be compared with what others do.
    pub fn is_comparable(&self, id: u64) -> bool {
        let declared = |announced: &Announcement| {
            matches!(
                announced.determinism.as_deref(),
                Some("bitwise" | "statistical")
            )
        };
        self.announcement(id).is_some_and(declared)
    }

    /// What each server declares: how far it finds the same again, and its tolerance.
    pub fn declared(&self) -> Vec<(u64, Option<&str>, Option<f64>)> {
        let declared = |id| match self.announcement(id) {
            Some(announced) => (id, announced.determinism.as_deref(), announced.tolerance),
            None => (id, None, None),
        };
        self.slots.keys().copied().map(declared).collect()
    }

    /// How far the results of two servers may differ; none: not at all.
    pub fn tolerance(&self, first: u64, second: u64) -> Option<f64> {
        let declared = |id| {
            let announced = self.announcement(id)?;
            let statistical = announced.determinism.as_deref() == Some("statistical");
            statistical.then(|| announced.tolerance.unwrap_or_default())
        };
        match (declared(first), declared(second)) {
            (Some(first), Some(second)) => Some(first.max(second)),
            (first, second) => first.or(second),
        }
    }

    /// Servers that must not audit, given those that have had their say; none if all must not.
    pub fn auditors_but(&self, servers: &[u64]) -> Option<Vec<u64>> {
        let out = |id: &u64| servers.contains(id) || !self.is_comparable(*id);
        let all = self.slots.keys().copied();
        let never: Vec<u64> = all.filter(|id| out(id)).collect();
        (never.len() < self.slots.len()).then_some(never)
    }

    /// Whether a server that has not been asked can be expected to audit: none that is silent, is to show first that it is
    /// sound, or has failed more than once in a row.
    pub fn has_auditor_but(&self, servers: &[u64]) -> bool {
        let fails = |id: u64| {
            let failures = self.health().failures(id);
            failures.is_some_and(|(times, _)| times > 1) || self.health().is_doubtful(id)
        };
        let mut others = self.slots().filter(|(id, _)| !servers.contains(id));
        others.any(|(id, slot)| !slot.silent && !fails(id) && self.is_comparable(id))
    }
}
