//! What is held against evaluations, and whether servers vouch for it.
//!
//! A failure counts against an evaluation only if the server that had it is sound: it succeeds with another evaluation
//! afterwards. A lost server counts only if it had succeeded with another one before, and if no other one was lost at
//! the same time: see `docs/decisions`.

use std::collections::{BTreeMap, BTreeSet, VecDeque};
use std::time::{Duration, Instant};

use crate::config::Faults;
use crate::scheduler::queue::piece::Piece;

/// Lost servers that count, before an evaluation is taken for the cause, at least.
const LEAST_LOST: u32 = 3;
/// Evaluations with which so many servers were lost are tried one after another.
const DUBIOUS: u32 = 2;
/// So often a server has to succeed with something else before it gets an evaluation with which others were lost: one
/// that is lost again and again for reasons of its own hardly comes so far.
const PROOF: u32 = 3;
/// Servers that are lost within this time of each other have a common cause.
const TOGETHER: Duration = Duration::from_secs(5);
/// After so many lost servers, for each one with which an evaluation would be quarantined, nothing can be told any more,
/// and after so long.
const MOST_LOST: u32 = 4;
const LONG: Duration = Duration::from_secs(60);

/// Whose fault it is that work brought no result.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Blame {
    /// The server had other work.
    Nobody,
    /// The connection broke; perhaps it was more than the broker takes.
    Broker,
    /// The server says that it failed.
    Evaluation,
    /// The server sent what cannot be used.
    Answer,
    /// The tool's own server went down at it.
    Crash,
    /// The server went down while it was at it, or gave it up, nobody knows why.
    Gone,
    /// The server went down and had not begun.
    Lost,
    /// The server said nothing for too long, or is only slow. `others`: whether anyone spoke meanwhile.
    Silent { others: bool },
}

/// How an evaluation failed.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum How {
    /// The server said so, or sent what cannot be used.
    Said,
    /// The tool's own server went down at it.
    Crashed,
    /// The server was lost, or silent, while it was at it.
    Lost,
}

/// One failure of an evaluation that was alone on its server.
#[derive(Debug, Clone)]
pub(crate) struct Failure {
    pub server: u64,
    /// Which start of it, where it says so.
    pub instance: Option<String>,
    pub reason: String,
    pub how: How,
    /// Whether the server repeats itself to the bit, and had just succeeded with something else.
    pub certain: bool,
    pub at: Instant,
}

/// What is to become of an evaluation.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Verdict {
    /// All attempts have failed.
    Failed,
    /// It took so many servers down.
    Quarantined,
}

#[derive(Debug, Clone, Default)]
struct Suspicion {
    /// Each with whether its server has succeeded with another evaluation since.
    failures: Vec<(Failure, bool)>,
    /// How many servers were lost with it, whatever the cause, and when the first one was.
    lost: u32,
    since: Option<Instant>,
    /// It waits for its servers to be vouched for.
    aside: Option<Piece>,
}

impl Suspicion {
    fn count(&self, how: How) -> u32 {
        let alike = self.failures.iter().filter(|(one, _)| one.how == how);
        u32::try_from(alike.count()).unwrap_or(u32::MAX)
    }

    fn verdict(&self, faults: &Faults) -> Option<Verdict> {
        let [said, crashed, lost] = [How::Said, How::Crashed, How::Lost].map(|how| self.count(how));
        let quarantined =
            crashed >= faults.quarantine || crashed + lost >= faults.quarantine.max(LEAST_LOST);
        // Where servers repeat themselves to the bit, what two of them say is said by a third one, too.
        let certain = |last: &Failure| {
            let said = |one: &Failure| one.certain && one.how == How::Said;
            let same = |one: &Failure| said(one) && one.reason == last.reason;
            let times = self.failures.iter().filter(|(one, _)| same(one)).count();
            said(last) && times > 1
        };
        if quarantined {
            Some(Verdict::Quarantined)
        } else if said + crashed >= faults.attempts
            || self.failures.iter().any(|(last, _)| certain(last))
        {
            Some(Verdict::Failed)
        } else {
            None
        }
    }
}

/// An evaluation that waited for its servers.
pub(crate) enum Resolved {
    /// It has failed for good, the last time for this reason.
    Failed(Piece, Verdict, u32, String),
    /// Some of its failures do not count: it is tried again.
    Again(Piece),
}

/// All that is held against evaluations of one work.
#[derive(Debug, Default)]
pub(crate) struct Suspicions {
    by_evaluation: BTreeMap<usize, Suspicion>,
    /// How often servers have succeeded with something since any was lost last.
    proven: BTreeMap<u64, u32>,
    /// The last losses of servers: when, and with which evaluation alone.
    losses: VecDeque<(Instant, Option<usize>)>,
}

impl Suspicions {
    pub fn is_empty(&self) -> bool {
        self.by_evaluation.is_empty()
    }

    pub fn any_aside(&self) -> bool {
        self.by_evaluation.values().any(|one| one.aside.is_some())
    }

    /// Whether servers were lost with any evaluation that has not ended.
    pub fn has_suspects(&self) -> bool {
        self.by_evaluation.values().any(|one| one.lost > 0)
    }

    /// Whether servers were lost with an evaluation.
    pub fn is_suspect(&self, evaluation: usize) -> bool {
        let found = self.by_evaluation.get(&evaluation);
        found.is_some_and(|one| one.lost > 0)
    }

    /// Whether another dubious evaluation has to end before this one is tried again: else each would speak for the other.
    pub fn must_wait(&self, evaluation: usize) -> bool {
        let is_dubious = |one: &Suspicion| one.lost >= DUBIOUS && one.aside.is_none();
        let found = self.by_evaluation.get(&evaluation);
        if !found.is_some_and(is_dubious) {
            return false;
        }
        let mut all = self.by_evaluation.iter();
        let first = all.find(|(_, one)| is_dubious(one));
        first.is_some_and(|(first, _)| *first != evaluation)
    }

    pub fn is_proven(&self, server: u64) -> bool {
        self.proven
            .get(&server)
            .is_some_and(|times| *times >= PROOF)
    }

    /// An evaluation has ended.
    pub fn forget(&mut self, evaluation: usize) {
        self.by_evaluation.remove(&evaluation);
    }

    /// Holds a failure against an evaluation. What is to become of it, once its servers are vouched for.
    pub fn hold_against(
        &mut self,
        evaluation: usize,
        failure: Failure,
        faults: &Faults,
    ) -> Option<Verdict> {
        let suspicion = self.by_evaluation.entry(evaluation).or_default();
        let vouched = failure.how == How::Lost;
        suspicion.failures.push((failure, vouched));
        suspicion.verdict(faults)
    }

    /// A server was lost with one evaluation alone. How many were lost with it so far, and whether that is so many that
    /// nothing can be told any more.
    pub fn lost_with(&mut self, evaluation: usize, faults: &Faults, now: Instant) -> (u32, bool) {
        let suspicion = self.by_evaluation.entry(evaluation).or_default();
        suspicion.lost += 1;
        let since = *suspicion.since.get_or_insert(now);
        let most = MOST_LOST * faults.quarantine.max(LEAST_LOST);
        let long = now.saturating_duration_since(since) >= LONG;
        (suspicion.lost, suspicion.lost >= most && long)
    }

    /// A server was lost, perhaps with one evaluation alone. All have to prove themselves again, as others may be gone
    /// for the same reason, and only nobody knows yet. It speaks for all other evaluations with which servers were lost
    /// at the same time. Whether others were lost at the same time without this evaluation.
    pub fn shaken(&mut self, with: Option<usize>, now: Instant) -> bool {
        self.proven.clear();
        let recent = |at: Instant| now.saturating_duration_since(at) <= TOGETHER;
        self.losses.retain(|(at, _)| recent(*at));
        let others = self
            .losses
            .iter()
            .any(|(_, other)| other.is_none() || *other != with);
        self.losses.push_back((now, with));
        for (evaluation, suspicion) in &mut self.by_evaluation {
            if Some(*evaluation) != with {
                let kept = |one: &Failure| one.how != How::Lost || !recent(one.at);
                suspicion.failures.retain(|(one, _)| kept(one));
            }
        }
        others
    }

    /// Whether a server was lost a moment ago, and may soon be back.
    pub fn lost_lately(&self, now: Instant) -> bool {
        let last = self.losses.back();
        last.is_some_and(|(at, _)| now.saturating_duration_since(*at) <= TOGETHER)
    }

    /// A server has succeeded with something: what it said before counts, once for each evaluation however often it was
    /// tried since the last success, as the server may have been broken for a moment. `alike`: whether another one is
    /// the same installation.
    pub fn succeeded(
        &mut self,
        server: u64,
        instance: Option<&String>,
        alike: impl Fn(u64) -> bool,
    ) {
        *self.proven.entry(server).or_default() += 1;
        for suspicion in self.by_evaluation.values_mut() {
            // What another start said, perhaps on another machine, this one cannot vouch for.
            suspicion.failures.retain(|(failure, vouched)| {
                let same = failure.server != server || failure.instance.as_ref() == instance;
                *vouched || same || failure.how != How::Said
            });
            let mut told = BTreeSet::new();
            // The last one of each server stays.
            suspicion.failures.reverse();
            suspicion.failures.retain(|(failure, vouched)| {
                *vouched || failure.how != How::Said || told.insert(failure.server)
            });
            suspicion.failures.reverse();
            for (failure, vouched) in &mut suspicion.failures {
                *vouched |= failure.server == server || alike(failure.server);
            }
        }
    }

    /// Whether a server failed an evaluation and has succeeded with nothing since.
    pub fn is_open(&self, evaluation: usize, server: u64) -> bool {
        let found = self.by_evaluation.get(&evaluation);
        let open = |(failure, vouched): &(Failure, bool)| {
            !vouched && failure.server == server && failure.how == How::Said
        };
        found.is_some_and(|one| one.failures.iter().any(open))
    }

    /// What a server said since it last succeeded with something counts for nothing.
    pub fn discredit(&mut self, server: u64) {
        for suspicion in self.by_evaluation.values_mut() {
            let counts = |(one, vouched): &(Failure, bool)| *vouched || one.server != server;
            suspicion.failures.retain(counts);
        }
    }

    /// An evaluation waits until its servers are vouched for.
    pub fn put_aside(&mut self, piece: Piece) {
        let suspicion = self.by_evaluation.entry(piece.first()).or_default();
        suspicion.aside = Some(piece);
    }

    /// The servers that evaluations put aside wait for.
    pub fn awaited(&self) -> BTreeSet<u64> {
        let aside = self
            .by_evaluation
            .values()
            .filter(|one| one.aside.is_some());
        let failures = aside.flat_map(|one| &one.failures);
        let open = failures.filter(|(_, vouched)| !vouched);
        open.map(|(failure, _)| failure.server).collect()
    }

    /// Evaluations put aside that wait for nobody; `all`: whoever they wait for, unless one is to be tried again, which
    /// may yet succeed.
    pub fn resolve(&mut self, faults: &Faults, all: bool) -> Vec<Resolved> {
        let mut resolved = Vec::new();
        let again = |one: &Suspicion| one.aside.is_some() && one.verdict(faults).is_none();
        let all = all && !self.by_evaluation.values().any(again);
        for suspicion in self.by_evaluation.values_mut() {
            let open = !all && suspicion.failures.iter().any(|(_, vouched)| !vouched);
            if suspicion.aside.is_none() || (open && suspicion.verdict(faults).is_some()) {
                continue;
            }
            let verdict = suspicion.verdict(faults);
            let last = suspicion.failures.last();
            let reason = last.map_or_else(String::new, |(one, _)| one.reason.clone());
            let downs = suspicion.count(How::Crashed) + suspicion.count(How::Lost);
            if let Some(piece) = suspicion.aside.take() {
                resolved.push(match verdict {
                    Some(verdict) => Resolved::Failed(piece, verdict, downs, reason),
                    None => Resolved::Again(piece),
                });
            }
        }
        resolved
    }

    /// Takes back one evaluation that was put aside and that a server has not failed.
    pub fn take_aside_for(&mut self, server: u64) -> Option<Piece> {
        let mut aside = self
            .by_evaluation
            .values_mut()
            .map(|suspicion| &mut suspicion.aside);
        let other = |piece: &mut Piece| !piece.has_failed_on(server);
        aside.find_map(|piece| piece.take_if(other))
    }
}
