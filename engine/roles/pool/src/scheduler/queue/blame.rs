//! Failures of evaluations: which are attributed to the evaluation, and which to servers.
//!
//! A failure counts against an evaluation only if the server that had it is sound: it succeeds with another evaluation
//! afterwards. A lost server counts only if it had succeeded with another one before, and if no other one was lost at
//! the same time: see `docs/decisions`.

use std::collections::{BTreeMap, BTreeSet, VecDeque};
use std::time::{Duration, Instant};

use crate::journal::Outcome;
use crate::scheduler::queue::piece::Piece;
use crate::sections::Faults;

/// Lost servers that count, before an evaluation is taken for the cause, at least.
const LEAST_LOST: u32 = 3;
/// Number of lost servers after which evaluations are tried one after another.
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

/// The cause of work without a result.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Blame {
    /// The server had other work.
    None,
    /// The connection broke; perhaps it was more than the broker takes.
    Broker,
    /// The server says that it failed.
    Evaluation,
    /// The server sent what cannot be used.
    Answer,
    /// The tool's own server went down at it.
    Crash,
    /// The server went down while it was at it, or gave it up; the cause is unknown.
    Gone,
    /// The server went down and had not begun.
    Lost,
    /// The server said nothing for too long, or is only slow. `others`: whether anyone spoke meanwhile.
    Silent { others: bool },
}

impl Blame {
    /// The same for work that had begun; `is_rest`: it is what is left of several evaluations.
    pub fn of_begun(self, is_rest: bool) -> Self {
        match self {
            // It may have had company.
            Self::Answer | Self::Crash | Self::Gone | Self::Lost | Self::Silent { .. }
                if is_rest =>
            {
                Self::None
            }
            Self::Lost => Self::Gone,
            blame => blame,
        }
    }
}

/// Why what a server had is over without results.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Cause<'a> {
    /// What the journal says of the attempt.
    pub outcome: Outcome,
    pub blame: Blame,
    /// For people.
    pub reason: &'a str,
}

impl<'a> Cause<'a> {
    /// The server failed, or is not used any more.
    pub fn server(reason: &'a str, blame: Blame) -> Self {
        Self {
            outcome: Outcome::ServerFailed,
            blame,
            reason,
        }
    }

    /// It was ended for the sake of other work.
    pub fn lost(reason: &'a str) -> Self {
        Self {
            outcome: Outcome::Lost,
            blame: Blame::None,
            reason,
        }
    }

    /// The server is reserved for another tool.
    pub fn handed_back(reason: &'a str) -> Self {
        Self {
            outcome: Outcome::HandedBack,
            blame: Blame::None,
            reason,
        }
    }

    /// The same for what only waited at the server meanwhile.
    pub fn of_others(self) -> Self {
        match self.outcome {
            Outcome::ServerFailed => Self::lost(self.reason),
            _ => self,
        }
    }
}

/// How an evaluation failed.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum FailureKind {
    /// The server said so, or sent what cannot be used.
    Reported,
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
    pub kind: FailureKind,
    /// Whether the server repeats itself to the bit, and had just succeeded with something else.
    pub certain: bool,
    pub at: Instant,
}

/// What is to become of an evaluation.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Verdict {
    /// All attempts have failed.
    Failed,
    /// It crashed too many servers.
    Quarantined,
}

#[derive(Debug, Clone, Default)]
struct Record {
    /// Each with whether its server has succeeded with another evaluation since.
    failures: Vec<(Failure, bool)>,
    /// How many servers were lost with it, whatever the cause, and when the first one was.
    lost: u32,
    since: Option<Instant>,
    /// It waits for its failures to be confirmed.
    aside: Option<Piece>,
}

impl Record {
    fn count(&self, kind: FailureKind) -> u32 {
        let same_installation = self
            .failures
            .iter()
            .filter(|(failure, _)| failure.kind == kind);
        u32::try_from(same_installation.count()).unwrap_or(u32::MAX)
    }

    fn verdict(&self, faults: &Faults) -> Option<Verdict> {
        let [reported, crashed, lost] = [
            FailureKind::Reported,
            FailureKind::Crashed,
            FailureKind::Lost,
        ]
        .map(|kind| self.count(kind));
        let quarantined =
            crashed >= faults.quarantine || crashed + lost >= faults.quarantine.max(LEAST_LOST);
        // Where servers repeat themselves to the bit, what two of them say is said by a third one, too.
        let certain = |last: &Failure| {
            let is_report =
                |failure: &Failure| failure.certain && failure.kind == FailureKind::Reported;
            let same = |failure: &Failure| is_report(failure) && failure.reason == last.reason;
            let times = self
                .failures
                .iter()
                .filter(|(failure, _)| same(failure))
                .count();
            is_report(last) && times > 1
        };
        if quarantined {
            Some(Verdict::Quarantined)
        } else if reported + crashed >= faults.attempts
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
pub(crate) struct Attribution {
    by_evaluation: BTreeMap<usize, Record>,
    /// How often servers have succeeded with something since any was lost last.
    proven: BTreeMap<u64, u32>,
    /// The last losses of servers: when, and with which evaluation alone.
    losses: VecDeque<(Instant, Option<usize>)>,
}

impl Attribution {
    pub fn is_empty(&self) -> bool {
        self.by_evaluation.is_empty()
    }

    pub fn any_aside(&self) -> bool {
        self.by_evaluation
            .values()
            .any(|record| record.aside.is_some())
    }

    /// Whether servers were lost with any evaluation that has not ended.
    pub fn has_suspects(&self) -> bool {
        self.by_evaluation.values().any(|record| record.lost > 0)
    }

    /// Whether servers were lost with an evaluation.
    pub fn is_suspect(&self, evaluation: usize) -> bool {
        let record = self.by_evaluation.get(&evaluation);
        record.is_some_and(|record| record.lost > 0)
    }

    /// Whether another dubious evaluation must end before this one is retried, since each would otherwise excuse the other.
    pub fn must_wait(&self, evaluation: usize) -> bool {
        let is_dubious = |record: &Record| record.lost >= DUBIOUS && record.aside.is_none();
        let record = self.by_evaluation.get(&evaluation);
        if !record.is_some_and(is_dubious) {
            return false;
        }
        let mut all = self.by_evaluation.iter();
        let first = all.find(|(_, record)| is_dubious(record));
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

    /// Attributes a failure to an evaluation. What is to become of it, once its failures are confirmed.
    pub fn attribute(
        &mut self,
        evaluation: usize,
        failure: Failure,
        faults: &Faults,
    ) -> Option<Verdict> {
        let record = self.by_evaluation.entry(evaluation).or_default();
        let confirmed = failure.kind == FailureKind::Lost;
        record.failures.push((failure, confirmed));
        record.verdict(faults)
    }

    /// A server was lost with one evaluation alone. How many were lost with it so far, and whether that is so many that
    /// nothing can be told any more.
    pub fn lost_with(&mut self, evaluation: usize, faults: &Faults, now: Instant) -> (u32, bool) {
        let record = self.by_evaluation.entry(evaluation).or_default();
        record.lost += 1;
        let since = *record.since.get_or_insert(now);
        let most = MOST_LOST * faults.quarantine.max(LEAST_LOST);
        let long = now.saturating_duration_since(since) >= LONG;
        (record.lost, record.lost >= most && long)
    }

    /// A server was lost, perhaps with one evaluation alone. All have to prove themselves again, as others may be gone
    /// for the same reason, which is not known yet. It speaks for all other evaluations with which servers were lost
    /// at the same time. Whether others were lost at the same time without this evaluation.
    pub fn server_lost(&mut self, with: Option<usize>, now: Instant) -> bool {
        self.proven.clear();
        let recent = |at: Instant| now.saturating_duration_since(at) <= TOGETHER;
        self.losses.retain(|(at, _)| recent(*at));
        let others = self
            .losses
            .iter()
            .any(|(_, other)| other.is_none() || *other != with);
        self.losses.push_back((now, with));
        for (evaluation, record) in &mut self.by_evaluation {
            if Some(*evaluation) != with {
                let is_kept =
                    |failure: &Failure| failure.kind != FailureKind::Lost || !recent(failure.at);
                record.failures.retain(|(failure, _)| is_kept(failure));
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
    /// tried since the last success, as the server may have been broken for a moment. `same_installation`: whether another one is
    /// the same installation.
    pub fn succeeded(
        &mut self,
        server: u64,
        times: u32,
        instance: Option<&String>,
        same_installation: impl Fn(u64) -> bool,
    ) {
        let proven = self.proven.entry(server).or_default();
        *proven = proven.saturating_add(times);
        for record in self.by_evaluation.values_mut() {
            // What another start said, perhaps on another machine, this one cannot confirm.
            record.failures.retain(|(failure, confirmed)| {
                let same = failure.server != server || failure.instance.as_ref() == instance;
                *confirmed || same || failure.kind != FailureKind::Reported
            });
            let mut servers = BTreeSet::new();
            // The last one of each server stays.
            record.failures.reverse();
            record.failures.retain(|(failure, confirmed)| {
                *confirmed
                    || failure.kind != FailureKind::Reported
                    || servers.insert(failure.server)
            });
            record.failures.reverse();
            for (failure, confirmed) in &mut record.failures {
                *confirmed |= failure.server == server || same_installation(failure.server);
            }
        }
    }

    /// Whether a server failed an evaluation and has succeeded with nothing since.
    pub fn is_open(&self, evaluation: usize, server: u64) -> bool {
        let record = self.by_evaluation.get(&evaluation);
        let open = |(failure, confirmed): &(Failure, bool)| {
            !confirmed && failure.server == server && failure.kind == FailureKind::Reported
        };
        record.is_some_and(|record| record.failures.iter().any(open))
    }

    /// What a server said since it last succeeded with something counts for nothing.
    pub fn discredit(&mut self, server: u64) {
        for record in self.by_evaluation.values_mut() {
            let counts =
                |(failure, confirmed): &(Failure, bool)| *confirmed || failure.server != server;
            record.failures.retain(counts);
        }
    }

    /// An evaluation waits until its failures are confirmed.
    pub fn put_aside(&mut self, piece: Piece) {
        let record = self.by_evaluation.entry(piece.first()).or_default();
        record.aside = Some(piece);
    }

    /// The servers that evaluations put aside wait for.
    pub fn awaited(&self) -> BTreeSet<u64> {
        let aside = self
            .by_evaluation
            .values()
            .filter(|record| record.aside.is_some());
        let failures = aside.flat_map(|record| &record.failures);
        let open = failures.filter(|(_, confirmed)| !confirmed);
        open.map(|(failure, _)| failure.server).collect()
    }

    /// Evaluations put aside that wait for no server; `all`: whichever they wait for, unless one is to be tried again, which
    /// may yet succeed.
    pub fn resolve(&mut self, faults: &Faults, all: bool) -> Vec<Resolved> {
        let mut resolved = Vec::new();
        let is_pending =
            |record: &Record| record.aside.is_some() && record.verdict(faults).is_none();
        let all = all && !self.by_evaluation.values().any(is_pending);
        for record in self.by_evaluation.values_mut() {
            let open = !all && record.failures.iter().any(|(_, confirmed)| !confirmed);
            if record.aside.is_none() || (open && record.verdict(faults).is_some()) {
                continue;
            }
            let verdict = record.verdict(faults);
            let last = record.failures.last();
            let reason = last.map_or_else(String::new, |(failure, _)| failure.reason.clone());
            let downs = record.count(FailureKind::Crashed) + record.count(FailureKind::Lost);
            if let Some(piece) = record.aside.take() {
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
            .map(|record| &mut record.aside);
        let is_untried_here = |piece: &mut Piece| !piece.has_failed_on(server);
        aside.find_map(|piece| piece.take_if(is_untried_here))
    }
}
