//! How servers have behaved, and how long they back off after failures: kept by id, also while no server has it.

use std::collections::BTreeMap;
use std::time::{Duration, Instant};

/// The pause after a first failure; it doubles with each further one in a row.
const FIRST_PAUSE: Duration = Duration::from_secs(1);
const LONGEST_PAUSE: Duration = Duration::from_secs(60);
/// Number of failed candidates, without a success, after which a server is in doubt.
const FEW: usize = 3;
/// Number of failures without a success after which a server counts as useless, although it still gets work.
const MANY: u32 = 4;

/// What is remembered of one id.
#[derive(Debug, Clone, Default)]
struct Past {
    /// Failures in a row, and why it failed last.
    failures: u32,
    reason: String,
    /// Time before which it gets no work.
    until: Option<Instant>,
    /// Its results were wrong: it is not used any more.
    distrusted: bool,
    /// Candidates that it has failed since it succeeded with anything, the first few of them.
    failed: Vec<usize>,
    /// How often in a row it has failed what had succeeded before.
    broken: u32,
    /// Requests that it has refused since it succeeded with anything, as if another tool had it.
    taken: u32,
    /// How often it was silent, refused what it should do or answered wrongly since it succeeded with anything.
    in_vain: u32,
    /// Others have finished what it had, of which it has not said anything: it is to answer something first.
    overtaken: bool,
    /// The process that this is of, where it says so.
    instance: Option<String>,
}

/// The past of all ids.
#[derive(Debug, Default)]
pub(crate) struct Health {
    pasts: BTreeMap<u64, Past>,
    /// Whether any may be in doubt.
    doubtful: bool,
}

impl Health {
    /// A server failed: a pause that grows with each failure in a row. Returns its end.
    pub fn failed(&mut self, id: u64, reason: &str, now: Instant) -> Instant {
        let past = self.pasts.entry(id).or_default();
        past.failures += 1;
        reason.clone_into(&mut past.reason);
        let pause = FIRST_PAUSE * 2u32.saturating_pow((past.failures - 1).min(6));
        let until = now + pause.min(LONGEST_PAUSE);
        past.until = Some(until);
        until
    }

    /// A server did what it was asked for.
    pub fn recovered(&mut self, id: u64) {
        if let Some(past) = self.pasts.get_mut(&id) {
            past.failures = 0;
            past.until = None;
        }
    }

    /// Forgives the last failure, which was not the server's fault.
    pub fn forgive(&mut self, id: u64) {
        if let Some(past) = self.pasts.get_mut(&id) {
            past.failures = past.failures.saturating_sub(1);
            past.until = None;
        }
    }

    /// A server failed a candidate that may be to blame itself.
    pub fn failed_candidate(&mut self, id: u64, candidate: usize) {
        let past = self.pasts.entry(id).or_default();
        if past.failed.len() < FEW && !past.failed.contains(&candidate) {
            past.failed.push(candidate);
            self.doubtful |= past.failed.len() >= FEW;
        }
    }

    /// A server failed what had succeeded before: a pause that grows each time.
    pub fn broke(&mut self, id: u64, reason: &str, now: Instant) -> Instant {
        self.doubtful = true;
        let past = self.pasts.entry(id).or_default();
        past.broken += 1;
        past.failures = past.broken - 1;
        self.failed(id, reason, now)
    }

    /// A server that had answered discovery refused a request, as another tool had it. Returns how many it has refused so
    /// since it succeeded with anything.
    pub fn refused_as_taken(&mut self, id: u64) -> u32 {
        let past = self.pasts.entry(id).or_default();
        past.taken += 1;
        past.taken
    }

    /// A server is there: what another process did under its id in vain counts for nothing.
    pub fn note_instance(&mut self, id: u64, instance: Option<&str>) {
        if let Some(past) = self.pasts.get_mut(&id)
            && past.instance.as_deref() != instance
        {
            (past.in_vain, past.overtaken) = (0, false);
            past.instance = instance.map(str::to_owned);
        }
    }

    /// A server's process has ended.
    pub fn process_ended(&mut self, id: u64) {
        if let Some(past) = self.pasts.get_mut(&id) {
            (past.in_vain, past.overtaken) = (0, false);
        }
    }

    /// A server was silent, refused what it should do, or answered wrongly.
    pub fn failed_in_vain(&mut self, id: u64) {
        let past = self.pasts.entry(id).or_default();
        past.in_vain = past.in_vain.saturating_add(1);
    }

    /// Others have finished what a server had, of which it has not said anything.
    pub fn overtaken(&mut self, id: u64) {
        self.doubtful = true;
        self.pasts.entry(id).or_default().overtaken = true;
    }

    /// Notes that a server reported on its work.
    pub fn answers(&mut self, id: u64) {
        if let Some(past) = self.pasts.get_mut(&id) {
            past.overtaken = false;
        }
    }

    /// Whether a server has failed too often without a success to be useful.
    pub fn is_useless(&self, id: u64) -> bool {
        self.pasts.get(&id).is_some_and(|past| past.in_vain >= MANY)
    }

    /// A server succeeded with something.
    pub fn succeeded(&mut self, id: u64) {
        if let Some(past) = self.pasts.get_mut(&id) {
            past.failed.clear();
            past.broken = 0;
            past.taken = 0;
            (past.in_vain, past.overtaken) = (0, false);
        }
    }

    /// Notes that other work has begun, with other candidates.
    pub fn new_work(&mut self) {
        for past in self.pasts.values_mut() {
            past.failed.clear();
        }
    }

    /// Whether a server fails so much, or says so little, that it is perhaps broken.
    pub fn is_doubtful(&self, id: u64) -> bool {
        let past = self.pasts.get(&id);
        past.is_some_and(|past| past.broken > 0 || past.overtaken || past.failed.len() >= FEW)
    }

    /// Whether any server may be [in doubt](Self::is_doubtful).
    pub fn has_doubtful(&self) -> bool {
        self.doubtful
    }

    /// No server is in doubt.
    pub fn none_doubtful(&mut self) {
        self.doubtful = false;
    }

    /// Whether a server fails what had succeeded before.
    pub fn is_broken(&self, id: u64) -> bool {
        self.pasts.get(&id).is_some_and(|past| past.broken > 0)
    }

    /// Whether a server has failed a candidate since it succeeded with anything.
    pub fn has_failed(&self, id: u64) -> bool {
        let past = self.pasts.get(&id);
        past.is_some_and(|past| !past.failed.is_empty())
    }

    /// Its results were wrong.
    pub fn distrust(&mut self, id: u64, reason: &str) {
        let past = self.pasts.entry(id).or_default();
        past.distrusted = true;
        reason.clone_into(&mut past.reason);
    }

    /// Why it is not to be used any more, if so.
    pub fn distrusted(&self, id: u64) -> Option<&str> {
        let past = self.pasts.get(&id)?;
        past.distrusted.then_some(&*past.reason)
    }

    /// Until when a server that appears now has to wait: one that was started anew has one failure free.
    pub fn pause(&self, id: u64, now: Instant) -> Option<Instant> {
        let past = self.pasts.get(&id).filter(|past| past.failures > 1)?;
        past.until.filter(|until| *until > now)
    }

    /// Failures in a row and the last one's reason, if there are any.
    pub fn failures(&self, id: u64) -> Option<(u32, &str)> {
        let past = self.pasts.get(&id).filter(|past| past.failures > 0)?;
        Some((past.failures, &past.reason))
    }
}
