//! Determinism: which servers reproduce their results, and how far the results of two servers may differ.

use swarmwright_protocol::Announcement;

use crate::scheduler::fleet::Fleet;
use crate::scheduler::queue::results::ServerResult;

impl Fleet {
    fn announcement(&self, id: u64) -> Option<&Announcement> {
        self.slots.get(&id)?.capabilities.swarmwright.as_ref()
    }

    /// Returns whether a server declares that it reproduces its results bitwise.
    pub fn repeats_itself(&self, id: u64) -> bool {
        let declared =
            |announced: &Announcement| announced.determinism.as_deref() == Some("bitwise");
        self.announcement(id).is_some_and(declared)
    }

    /// Returns another possible cause of different results: a simulation that is declared deterministic but does not
    /// reset fully.
    pub fn other_cause(&self, results: &[ServerResult]) -> &'static str {
        let declared = results
            .iter()
            .all(|result| self.repeats_itself(result.server));
        if declared {
            "; or the simulation, which declares determinism: bitwise, gives different results for the same episode, since its \
             reset may not restore everything"
        } else {
            ""
        }
    }

    /// Returns whether the results of a server can be compared with those of others.
    pub fn is_comparable(&self, id: u64) -> bool {
        let declared = |announced: &Announcement| {
            matches!(
                announced.determinism.as_deref(),
                Some("bitwise" | "statistical")
            )
        };
        self.announcement(id).is_some_and(declared)
    }

    /// Returns the determinism and the tolerance that each server declares.
    pub fn declared(&self) -> Vec<(u64, Option<&str>, Option<f64>)> {
        let declared = |id| match self.announcement(id) {
            Some(announced) => (id, announced.determinism.as_deref(), announced.tolerance),
            None => (id, None, None),
        };
        self.slots.keys().copied().map(declared).collect()
    }

    /// Returns the tolerance between the results of two servers; `None` if they must be equal.
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

    /// Returns the servers that must not audit the results of `servers`; `None` if no server may.
    pub fn auditors_but(&self, servers: &[u64]) -> Option<Vec<u64>> {
        let out = |id: &u64| servers.contains(id) || !self.is_comparable(*id);
        let all = self.slots.keys().copied();
        let never: Vec<u64> = all.filter(|id| out(id)).collect();
        (never.len() < self.slots.len()).then_some(never)
    }

    /// Returns whether another server is likely to be able to audit: it is not silent, not in doubt, and has not failed
    /// more than once in a row.
    pub fn has_auditor_but(&self, servers: &[u64]) -> bool {
        let fails = |id: u64| {
            let failures = self.health().failures(id);
            failures.is_some_and(|(times, _)| times > 1) || self.health().is_doubtful(id)
        };
        let mut others = self.slots().filter(|(id, _)| !servers.contains(id));
        others.any(|(id, slot)| !slot.silent && !fails(id) && self.is_comparable(id))
    }
}
