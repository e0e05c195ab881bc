//! Attribution of failures to evaluations or to servers.
//!
//! A failure counts against an evaluation only if its server is sound, that is, succeeds with another evaluation
//! afterwards. The loss of a server counts only if it had succeeded with other evaluations before, and if no other
//! server was lost at the same time: see `docs/decisions`.

use std::collections::{BTreeMap, BTreeSet, VecDeque};
use std::time::{Duration, Instant};

use crate::journal::Outcome;
use crate::scheduler::queue::piece::Piece;
use crate::sections::Faults;

/// Smallest number of losses that count before an evaluation is taken for their cause.
const LEAST_LOST: u32 = 3;
/// Number of losses after which evaluations are retried one after another.
const DUBIOUS: u32 = 2;
/// Number of other evaluations with which a server must succeed before it gets an evaluation with which servers were
/// lost; a server that is lost repeatedly for reasons of its own rarely reaches it.
const PROOF: u32 = 3;
/// Time within which losses of servers are assumed to have a common cause.
const TOGETHER: Duration = Duration::from_secs(5);
/// Number of losses per loss required for quarantine, and time since the first loss, after which the cause of the
/// losses counts as undecidable.
const MOST_LOST: u32 = 4;
const LONG: Duration = Duration::from_secs(60);

/// The presumed cause of a failure to return results.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Blame {
    /// The server had other work.
    None,
    /// The connection broke; the message may have been too large for the broker.
    Broker,
    /// The server reported that the evaluation failed.
    Evaluation,
    /// The server sent an unusable answer.
    Answer,
    /// The tool's own server crashed during the evaluation.
    Crash,
    /// The server went offline during the evaluation, or gave it up; the cause is unknown.
    Gone,
    /// The server went offline before it began.
    Lost,
    /// The server was silent for too long. `others`: whether any other server was heard in the meantime.
    Silent { others: bool },
}

impl Blame {
    /// Adapts the blame to work that had begun; `is_rest`: it is the remainder of several evaluations.
    pub fn of_begun(self, is_rest: bool) -> Self {
        match self {
            // Other evaluations may have been computed at the same time.
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

/// Why a job ended without results.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Cause<'a> {
    /// Outcome of the attempt in the journal.
    pub outcome: Outcome,
    pub blame: Blame,
    /// Reason, for users.
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

    /// The job was ended because of other work on the server.
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

    /// Returns the cause for the other jobs that waited at the server.
    pub fn of_others(self) -> Self {
        match self.outcome {
            Outcome::ServerFailed => Self::lost(self.reason),
            _ => self,
        }
    }
}

/// Kinds of failures of an evaluation.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum FailureKind {
    /// The server reported the failure, or sent an unusable answer.
    Reported,
    /// The tool's own server crashed during the evaluation.
    Crashed,
    /// The server was lost or silent during the evaluation.
    Lost,
}

/// One failure of an evaluation that was the only one on its server.
#[derive(Debug, Clone)]
pub(crate) struct Failure {
    pub server: u64,
    /// Instance of the server, if it announces one.
    pub instance: Option<String>,
    pub reason: String,
    pub kind: FailureKind,
    /// Whether the server is bitwise deterministic and its previous evaluation succeeded.
    pub certain: bool,
    pub at: Instant,
}

/// Final decision on an evaluation.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Verdict {
    /// All attempts have failed.
    Failed,
    /// The evaluation crashed too many servers.
    Quarantined,
}

#[derive(Debug, Clone, Default)]
struct Record {
    /// Failures, each with whether it is confirmed: its server has succeeded with another evaluation since.
    failures: Vec<(Failure, bool)>,
    /// Number of servers lost with the evaluation, whatever the cause, and the time of the first loss.
    lost: u32,
    since: Option<Instant>,
    /// The evaluation, while it waits for its failures to be confirmed.
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
        // If servers are bitwise deterministic, a third one would report what two of them report.
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

/// Decision on an evaluation that was put aside.
pub(crate) enum Resolved {
    /// It has failed permanently; with the number of losses and the last reason.
    Failed(Piece, Verdict, u32, String),
    /// Some of its failures do not count, so it is retried.
    Again(Piece),
}

/// Failures attributed to the evaluations of the current work.
#[derive(Debug, Default)]
pub(crate) struct Attribution {
    by_evaluation: BTreeMap<usize, Record>,
    /// Number of successes of each server since any server was last lost.
    proven: BTreeMap<u64, u32>,
    /// Recent losses of servers: the time, and the evaluation if the server had only one.
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

    /// Returns whether servers were lost with any evaluation that has not ended.
    pub fn has_suspects(&self) -> bool {
        self.by_evaluation.values().any(|record| record.lost > 0)
    }

    /// Returns whether servers were lost with an evaluation.
    pub fn is_suspect(&self, evaluation: usize) -> bool {
        let record = self.by_evaluation.get(&evaluation);
        record.is_some_and(|record| record.lost > 0)
    }

    /// Returns whether another dubious evaluation must end before this one is retried, since each would excuse the
    /// other.
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

    /// Forgets an evaluation that has ended.
    pub fn forget(&mut self, evaluation: usize) {
        self.by_evaluation.remove(&evaluation);
    }

    /// Attributes a failure to an evaluation. Returns the verdict on the evaluation, which applies once its failures
    /// are confirmed.
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

    /// Records that a server was lost with this single evaluation. Returns the number of losses with it so far, and
    /// whether the cause counts as undecidable.
    pub fn lost_with(&mut self, evaluation: usize, faults: &Faults, now: Instant) -> (u32, bool) {
        let record = self.by_evaluation.entry(evaluation).or_default();
        record.lost += 1;
        let since = *record.since.get_or_insert(now);
        let most = MOST_LOST * faults.quarantine.max(LEAST_LOST);
        let long = now.saturating_duration_since(since) >= LONG;
        (record.lost, record.lost >= most && long)
    }

    /// Records that a server was lost, with a single evaluation if `with` is set. All servers must prove themselves
    /// again, since others may be affected by the same unknown cause. Losses at the same time with other evaluations
    /// stop counting against those. Returns whether other servers were lost at the same time without this evaluation.
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

    /// Returns whether a server was lost a moment ago and may soon be back.
    pub fn lost_lately(&self, now: Instant) -> bool {
        let last = self.losses.back();
        last.is_some_and(|(at, _)| now.saturating_duration_since(*at) <= TOGETHER)
    }

    /// Records that a server has succeeded, which confirms the failures that it reported. Of several reports on one
    /// evaluation since its last success, only one counts, since the server may have been broken for a moment.
    /// `same_installation` returns whether another server belongs to the same installation.
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
            // This instance cannot confirm reports of another one, which may have run on another machine.
            record.failures.retain(|(failure, confirmed)| {
                let same = failure.server != server || failure.instance.as_ref() == instance;
                *confirmed || same || failure.kind != FailureKind::Reported
            });
            let mut servers = BTreeSet::new();
            // Keep the last failure of each server.
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

    /// Returns whether a server failed an evaluation and has not succeeded since.
    pub fn is_open(&self, evaluation: usize, server: u64) -> bool {
        let record = self.by_evaluation.get(&evaluation);
        let open = |(failure, confirmed): &(Failure, bool)| {
            !confirmed && failure.server == server && failure.kind == FailureKind::Reported
        };
        record.is_some_and(|record| record.failures.iter().any(open))
    }

    /// Drops the unconfirmed failures that a server reported.
    pub fn discredit(&mut self, server: u64) {
        for record in self.by_evaluation.values_mut() {
            let counts =
                |(failure, confirmed): &(Failure, bool)| *confirmed || failure.server != server;
            record.failures.retain(counts);
        }
    }

    /// Puts an evaluation aside until its failures are confirmed.
    pub fn put_aside(&mut self, piece: Piece) {
        let record = self.by_evaluation.entry(piece.first()).or_default();
        record.aside = Some(piece);
    }

    /// Returns the servers that must confirm the failures of evaluations put aside.
    pub fn awaited(&self) -> BTreeSet<u64> {
        let aside = self
            .by_evaluation
            .values()
            .filter(|record| record.aside.is_some());
        let failures = aside.flat_map(|record| &record.failures);
        let open = failures.filter(|(_, confirmed)| !confirmed);
        open.map(|(failure, _)| failure.server).collect()
    }

    /// Resolves the evaluations put aside whose failures are confirmed; `all`: also unconfirmed ones, unless one of the
    /// evaluations is to be retried, which may still succeed.
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

    /// Takes back one evaluation that was put aside and has not failed on a server.
    pub fn take_aside_for(&mut self, server: u64) -> Option<Piece> {
        let mut aside = self
            .by_evaluation
            .values_mut()
            .map(|record| &mut record.aside);
        let is_untried_here = |piece: &mut Piece| !piece.has_failed_on(server);
        aside.find_map(|piece| piece.take_if(is_untried_here))
    }
}
