//! Reasons why the current work may not finish.

use std::collections::{BTreeMap, BTreeSet};
use std::time::{Duration, Instant};

use crate::scheduler::fleet::Fleet;
use crate::scheduler::fleet::processes::Processes;
use crate::scheduler::fleet::slot::Slot;

/// Factor for the patience with silent or useless servers that may be sound.
const SILENCE_FACTOR: u32 = 4;
/// Absence of a server after which its unconfirmed reports are dropped; longer than a turn of another tool.
const ABSENCE_TIMEOUT: Duration = Duration::from_secs(30);
/// How long to wait for the answers of other servers after one refused the work.
const OTHERS: Duration = Duration::from_millis(500);

#[derive(Debug, Default)]
pub(crate) struct Outlook {
    /// Since when there has been work but no server for it.
    unserved_since: Option<Instant>,
    /// When a server last refused the work.
    refused_at: Option<Instant>,
    /// A disagreement of two servers, if it is unknown which one is wrong.
    disagreement: Option<String>,
    /// Since when all servers have been silent or have failed all their work.
    broken_since: Option<Instant>,
    /// Offline servers whose success is awaited, and since when they have been offline.
    absent: BTreeMap<u64, Instant>,
    /// Message about servers that are lost repeatedly for an unknown reason.
    undecided: Option<String>,
}

impl Outlook {
    /// Prepares for new work.
    pub fn begin(&mut self) {
        *self = Self {
            unserved_since: self.unserved_since,
            ..Self::default()
        };
    }

    /// Records whether there is work but no server for it.
    pub fn unserved(&mut self, unserved: bool, now: Instant) {
        self.unserved_since = unserved.then(|| self.unserved_since.unwrap_or(now));
    }

    /// Returns how long there has been work but no server for it.
    pub fn unserved_for(&self, now: Instant) -> Duration {
        let since = self.unserved_since;
        since.map_or(Duration::ZERO, |since| now.saturating_duration_since(since))
    }

    /// Records that a server refused the work.
    pub fn refused(&mut self, now: Instant) {
        self.refused_at = Some(now);
    }

    /// Returns whether a server refused the work, and others have had the time to answer.
    pub fn is_refused(&self, now: Instant) -> bool {
        let refused = self.refused_at;
        refused.is_some_and(|at| now.saturating_duration_since(at) >= OTHERS)
    }

    /// Records that two servers disagree; only the first message is kept.
    pub fn disagree(&mut self, message: String) {
        self.disagreement.get_or_insert(message);
    }

    pub fn disagreement(&self) -> Option<&str> {
        self.disagreement.as_deref()
    }

    /// Records that some server may be of use.
    pub fn some_work(&mut self) {
        self.broken_since = None;
    }

    /// Records whether any server is of use.
    pub fn judge(&mut self, fleet: &Fleet, finished: bool, now: Instant) {
        if fleet.has_hope() || finished {
            self.some_work();
        } else if !fleet.is_empty() {
            self.broken_since.get_or_insert(now);
        }
    }

    /// Returns why no server is of use, after all have been silent or failed all their work for a long time.
    /// `patience`: how long to wait for servers that fail evaluations that succeeded before.
    pub fn useless(&self, fleet: &Fleet, patience: Duration, now: Instant) -> Option<&'static str> {
        let since = self.broken_since?;
        let health = fleet.health();
        // A silent server may be about to return its first success until it times out.
        let at_work = |(id, slot): (u64, &Slot)| !slot.jobs.is_empty() && !health.is_broken(id);
        // A lack of servers has its own time limit.
        if fleet.is_empty() || fleet.has_hope() || fleet.slots().any(at_work) {
            return None;
        }
        let may_be_sound = |(id, _): (u64, &Slot)| !health.is_broken(id);
        let (patience, reason) = if fleet.slots().any(may_be_sound) {
            let reason = "no server has completed an evaluation for a long time";
            (patience * SILENCE_FACTOR, reason)
        } else {
            (
                patience,
                "all servers fail evaluations that succeeded before",
            )
        };
        (now.saturating_duration_since(since) >= patience).then_some(reason)
    }

    /// Returns the servers, of those whose success is awaited, that do not return while others can be asked instead.
    pub fn absent(
        &mut self,
        awaited: BTreeSet<u64>,
        fleet: &Fleet,
        processes: &Processes,
        now: Instant,
    ) -> Vec<u64> {
        self.absent.retain(|server, _| awaited.contains(server));
        let mut all = Vec::new();
        for server in awaited {
            let slot = fleet.slot(server);
            let gone = slot.is_none_or(|slot| slot.silent && slot.jobs.is_empty());
            // Supervised servers return, and the success of any of them confirms the failures reported by the others.
            if !gone || processes.are_watched(server) {
                self.absent.remove(&server);
                continue;
            }
            let since = *self.absent.entry(server).or_insert(now);
            let mut slots = fleet.slots();
            let others = slots.any(|(id, slot)| id != server && !slot.silent);
            if others && now.saturating_duration_since(since) >= ABSENCE_TIMEOUT {
                all.push(server);
            }
        }
        all
    }

    /// Records that servers are lost repeatedly; only the first message is kept.
    pub fn cannot_decide(&mut self, message: String) {
        self.undecided.get_or_insert(message);
    }

    pub fn undecided(&self) -> Option<&str> {
        self.undecided.as_deref()
    }
}
