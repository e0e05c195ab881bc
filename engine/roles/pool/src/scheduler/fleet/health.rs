//! Health of servers: their failures and back-offs. It is kept by id, also while the server is offline.

use std::collections::BTreeMap;
use std::time::{Duration, Instant};

/// Pause after the first failure; it doubles with each further failure in a row.
const FIRST_PAUSE: Duration = Duration::from_secs(1);
const LONGEST_PAUSE: Duration = Duration::from_secs(60);
/// Number of failed candidates without a success after which a server is in doubt.
const FEW: usize = 3;
/// Number of failures without a success after which a server counts as useless; it still gets work.
const MANY: u32 = 4;

/// History of one id.
#[derive(Debug, Clone, Default)]
struct Past {
    /// Failures in a row, and the reason for the last one.
    failures: u32,
    reason: String,
    /// Time until which the server gets no work.
    until: Option<Instant>,
    /// Whether the server is not used any more because its results were wrong.
    distrusted: bool,
    /// Candidates that failed on the server since its last success; only the first few are kept.
    failed: Vec<usize>,
    /// Number of times in a row that the server failed evaluations that had succeeded before.
    broken: u32,
    /// Number of requests refused since its last success because another tool had the server.
    taken: u32,
    /// Number of times since its last success that the server was silent, refused work or answered wrongly.
    in_vain: u32,
    /// Whether other servers have finished its unanswered work; it must answer before it gets new work.
    overtaken: bool,
    /// Process that this history belongs to, if the server announces it.
    instance: Option<String>,
}

/// Histories of all ids.
#[derive(Debug, Default)]
pub(crate) struct Health {
    pasts: BTreeMap<u64, Past>,
    /// Whether any server may be in doubt.
    doubtful: bool,
}

impl Health {
    /// Records a failure of a server; the pause doubles with each failure in a row. Returns the end of the pause.
    pub fn failed(&mut self, id: u64, reason: &str, now: Instant) -> Instant {
        let past = self.pasts.entry(id).or_default();
        past.failures += 1;
        reason.clone_into(&mut past.reason);
        let pause = FIRST_PAUSE * 2u32.saturating_pow((past.failures - 1).min(6));
        let until = now + pause.min(LONGEST_PAUSE);
        past.until = Some(until);
        until
    }

    /// Records that a server completed its work.
    pub fn recovered(&mut self, id: u64) {
        if let Some(past) = self.pasts.get_mut(&id) {
            past.failures = 0;
            past.until = None;
        }
    }

    /// Removes the last failure, which was not the server's fault.
    pub fn forgive(&mut self, id: u64) {
        if let Some(past) = self.pasts.get_mut(&id) {
            past.failures = past.failures.saturating_sub(1);
            past.until = None;
        }
    }

    /// Records that a candidate failed on a server; the candidate itself may be to blame.
    pub fn failed_candidate(&mut self, id: u64, candidate: usize) {
        let past = self.pasts.entry(id).or_default();
        if past.failed.len() < FEW && !past.failed.contains(&candidate) {
            past.failed.push(candidate);
            self.doubtful |= past.failed.len() >= FEW;
        }
    }

    /// Records that a server failed an evaluation that had succeeded before. Returns the end of the pause, which
    /// doubles each time.
    pub fn broke(&mut self, id: u64, reason: &str, now: Instant) -> Instant {
        self.doubtful = true;
        let past = self.pasts.entry(id).or_default();
        past.broken += 1;
        past.failures = past.broken - 1;
        self.failed(id, reason, now)
    }

    /// Records that a server that had answered discovery refused a request because another tool had it. Returns the
    /// number of such refusals since its last success.
    pub fn refused_as_taken(&mut self, id: u64) -> u32 {
        let past = self.pasts.entry(id).or_default();
        past.taken += 1;
        past.taken
    }

    /// Records the process of a server; failures of an earlier process under the same id are dropped.
    pub fn note_instance(&mut self, id: u64, instance: Option<&str>) {
        if let Some(past) = self.pasts.get_mut(&id)
            && past.instance.as_deref() != instance
        {
            (past.in_vain, past.overtaken) = (0, false);
            past.instance = instance.map(str::to_owned);
        }
    }

    /// Records that the process of a server has ended.
    pub fn process_ended(&mut self, id: u64) {
        if let Some(past) = self.pasts.get_mut(&id) {
            (past.in_vain, past.overtaken) = (0, false);
        }
    }

    /// Records that a server was silent, refused work, or answered wrongly.
    pub fn failed_in_vain(&mut self, id: u64) {
        let past = self.pasts.entry(id).or_default();
        past.in_vain = past.in_vain.saturating_add(1);
    }

    /// Records that other servers have finished the unanswered work of a server.
    pub fn overtaken(&mut self, id: u64) {
        self.doubtful = true;
        self.pasts.entry(id).or_default().overtaken = true;
    }

    /// Records that a server reported on its work.
    pub fn answers(&mut self, id: u64) {
        if let Some(past) = self.pasts.get_mut(&id) {
            past.overtaken = false;
        }
    }

    /// Returns whether a server has failed too often without a success to be useful.
    pub fn is_useless(&self, id: u64) -> bool {
        self.pasts.get(&id).is_some_and(|past| past.in_vain >= MANY)
    }

    /// Records that a server succeeded.
    pub fn succeeded(&mut self, id: u64) {
        if let Some(past) = self.pasts.get_mut(&id) {
            past.failed.clear();
            past.broken = 0;
            past.taken = 0;
            (past.in_vain, past.overtaken) = (0, false);
        }
    }

    /// Records that new work with other candidates has begun.
    pub fn new_work(&mut self) {
        for past in self.pasts.values_mut() {
            past.failed.clear();
        }
    }

    /// Returns whether a server may be broken, because it fails often or does not report on its work.
    pub fn is_doubtful(&self, id: u64) -> bool {
        let past = self.pasts.get(&id);
        past.is_some_and(|past| past.broken > 0 || past.overtaken || past.failed.len() >= FEW)
    }

    /// Returns whether any server may be [in doubt](Self::is_doubtful).
    pub fn has_doubtful(&self) -> bool {
        self.doubtful
    }

    /// Records that no server is in doubt.
    pub fn none_doubtful(&mut self) {
        self.doubtful = false;
    }

    /// Returns whether a server fails evaluations that succeeded before.
    pub fn is_broken(&self, id: u64) -> bool {
        self.pasts.get(&id).is_some_and(|past| past.broken > 0)
    }

    /// Returns whether a candidate has failed on a server since its last success.
    pub fn has_failed(&self, id: u64) -> bool {
        let past = self.pasts.get(&id);
        past.is_some_and(|past| !past.failed.is_empty())
    }

    /// Excludes a server whose results were wrong.
    pub fn distrust(&mut self, id: u64, reason: &str) {
        let past = self.pasts.entry(id).or_default();
        past.distrusted = true;
        reason.clone_into(&mut past.reason);
    }

    /// Returns why a server is excluded, if it is.
    pub fn distrusted(&self, id: u64) -> Option<&str> {
        let past = self.pasts.get(&id)?;
        past.distrusted.then_some(&*past.reason)
    }

    /// Returns until when a server that comes online must wait; the first failure is forgiven because the server may
    /// have been restarted.
    pub fn pause(&self, id: u64, now: Instant) -> Option<Instant> {
        let past = self.pasts.get(&id).filter(|past| past.failures > 1)?;
        past.until.filter(|until| *until > now)
    }

    /// Returns the number of failures in a row and the reason for the last one, if there are any.
    pub fn failures(&self, id: u64) -> Option<(u32, &str)> {
        let past = self.pasts.get(&id).filter(|past| past.failures > 0)?;
        Some((past.failures, &past.reason))
    }
}
