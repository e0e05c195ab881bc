//! Routes for failures: attribution, retries, and warnings.
//!
//! A server in doubt is probed with an evaluation that has succeeded before.

use std::time::{Duration, Instant};

use crate::journal::{Attempt, FailedEvaluation, Outcome};
use crate::scheduler::Scheduler;
use crate::scheduler::job::Job;
use crate::scheduler::queue::blame::{Blame, Cause, Resolved, Verdict};
use crate::scheduler::queue::ledger::failures::Failed;
use crate::scheduler::queue::piece::{Piece, Purpose};

impl Scheduler {
    /// Ends jobs of a server without results; see [`retry`](Self::retry). Only the oldest job is blamed, since the
    /// others were waiting.
    pub(super) fn fail_jobs(&mut self, jobs: Vec<Job>, cause: Cause<'_>, now: Instant) {
        self.fail_each(jobs, cause, now);
        self.dispatch(now);
    }

    pub(super) fn fail_each(&mut self, jobs: Vec<Job>, mut cause: Cause<'_>, now: Instant) {
        for job in jobs {
            match job {
                Job::Episode(hash) => self.fail_episode(&hash, cause, now),
                Job::Request(number) => self.fail_request(number, cause, now),
            }
            cause = cause.of_others();
        }
    }

    /// Records a failure of a server and lets it back off.
    pub(super) fn failed(&mut self, server: u64, reason: &str, now: Instant) {
        self.counts.server_failures += 1;
        self.counts.benched += 1;
        self.fleet.back_off(server, reason, now);
    }

    /// Like [`failed`](Self::failed), for a server that no other tool has; the failure counts towards its uselessness.
    pub(super) fn failed_in_vain(&mut self, server: u64, reason: &str, now: Instant) {
        self.fleet.failed_in_vain(server);
        self.failed(server, reason, now);
    }

    /// Queues work that returned no result again, or ends it.
    ///
    /// If several evaluations were sent together, it is unknown which one was to blame; smaller parts are retried until
    /// one is alone. [`blame`](crate::scheduler::queue::blame) decides what counts against an evaluation.
    pub(super) fn retry(
        &mut self,
        piece: Piece,
        server: u64,
        reason: &str,
        blame: Blame,
        now: Instant,
    ) {
        let counts = match blame {
            Blame::Gone | Blame::Lost | Blame::Silent { .. } => {
                self.lost(&piece, server, reason, blame, now)
            }
            _ => piece.len() == 1,
        };
        match piece.purpose {
            Purpose::Audit => return self.retry_audit(piece, server, reason, blame, now),
            Purpose::Probe => return self.probe_failed(server, reason, blame, now),
            Purpose::Work | Purpose::Backup => {}
        }
        let failed = Failed {
            server,
            instance: self.fleet.instance(server),
            reason,
            blame,
            sound: !self.fleet.health().has_failed(server) && self.fleet.repeats_itself(server),
            at: now,
        };
        if matches!(blame, Blame::Evaluation | Blame::Answer | Blame::Crash) {
            let candidate = piece.first() / self.ledger.episodes();
            self.fleet.failed_candidate(server, candidate);
        }
        let again = self
            .ledger
            .failed(piece, failed, counts, &self.config.faults);
        self.counts.retries += u64::from(again);
    }

    /// Records that a server was lost or silent for too long. Returns whether that counts against its evaluation.
    fn lost(
        &mut self,
        piece: &Piece,
        server: u64,
        reason: &str,
        blame: Blame,
        now: Instant,
    ) -> bool {
        let faults = &self.config.faults;
        let loss = self.ledger.lost(piece, server, blame, faults, now);
        if let Some(times) = loss.hopeless {
            let evaluation = self.ledger.name_of(piece.first());
            self.outlook.cannot_decide(format!(
                "servers were lost or silent {times} times with {evaluation}, and it is unclear whether the evaluation or the \
                 servers' environment is the cause; last reason: {reason}"
            ));
        }
        loss.counts
    }

    /// Ends evaluations that have failed permanently.
    pub(super) fn give_up(&mut self, piece: &Piece, everywhere: bool, now: Instant) {
        for evaluation in piece.evaluations.clone() {
            let failed = self.ledger.give_up(evaluation, everywhere);
            self.counts.failed += u64::from(failed);
            if failed && everywhere {
                self.drop_copies(
                    evaluation,
                    Outcome::Dropped,
                    "the evaluation is given up",
                    now,
                );
            }
        }
    }

    /// Adds a line to the journal.
    pub(super) fn record(
        &mut self,
        attempt: Attempt,
        piece: &Piece,
        started: Instant,
        now: Instant,
    ) {
        let (candidates, episodes) = self.ledger.extent(piece);
        let attempt = Attempt {
            candidate: candidates.start,
            candidates: candidates.len(),
            episode: episodes.start,
            episodes: episodes.len(),
            attempt: piece.tries + 1,
            seconds: now.saturating_duration_since(started).as_secs_f64(),
            ..attempt
        };
        self.journal.push(attempt, started);
    }

    /// Records that a server has succeeded, which confirms its earlier failures with other evaluations.
    pub(super) fn server_succeeded(&mut self, server: u64, times: u32) {
        self.fleet.succeeded(server);
        self.outlook.some_work();
        let processes = &self.processes;
        let supervised = processes.are_watched(server);
        // All supervised servers are one installation.
        let alike = |other: u64| supervised && processes.are_watched(other);
        let instance = self.fleet.instance(server);
        let attribution = self.ledger.attribution_mut();
        attribution.succeeded(server, times, instance.as_ref(), alike);
    }

    /// Sends an evaluation that succeeded to idle servers that must prove that they are sound.
    pub(super) fn probe(&mut self, now: Instant) {
        let Some(good) = self.ledger.good() else {
            return;
        };
        if self.finished() {
            return self.drop_probes(now);
        }
        if self.ledger.attribution().is_empty() && !self.fleet.health().has_doubtful() {
            return;
        }
        for server in self.view().probes_due() {
            self.start(Piece::probe(good), server, now);
        }
    }

    /// Handles a server that failed an evaluation that had succeeded before.
    pub(super) fn probe_failed(&mut self, server: u64, reason: &str, blame: Blame, now: Instant) {
        match blame {
            Blame::None | Blame::Broker | Blame::Lost | Blame::Gone | Blame::Silent { .. } => {}
            Blame::Evaluation | Blame::Answer | Blame::Crash => {
                self.counts.server_failures += 1;
                self.counts.benched += 1;
                self.fleet.broke(server, reason, now);
                self.ledger.attribution_mut().discredit(server);
                self.outbox.warn_once(format!(
                    "server {server} is broken: it fails evaluations that succeeded before; it gets no other work until they \
                     succeed on it, and its failed evaluations go to other servers; the reason: {reason}"
                ));
            }
        }
    }

    /// Decides on evaluations that were put aside: they have failed permanently, or are retried.
    pub(super) fn resolve(&mut self, now: Instant) {
        if !self.ledger.attribution().any_aside() {
            return;
        }
        self.discredit_absent(now);
        let all = self.nothing_succeeds(now);
        for resolved in self
            .ledger
            .attribution_mut()
            .resolve(&self.config.faults, all)
        {
            match resolved {
                Resolved::Again(piece) => {
                    self.counts.retries += 1;
                    self.ledger.put_back(&piece);
                }
                Resolved::Failed(piece, verdict, downs, reason) => {
                    self.fail_for_good(&piece, verdict, downs, &reason, now);
                }
            }
        }
    }

    /// Drops the reports of servers that do not return, if others can be asked instead.
    fn discredit_absent(&mut self, now: Instant) {
        let awaited = self.ledger.attribution().awaited();
        for server in self
            .outlook
            .absent(awaited, &self.fleet, &self.processes, now)
        {
            self.ledger.attribution_mut().discredit(server);
        }
    }

    /// Returns whether every server has been tried and nothing has succeeded; faults of servers and of evaluations
    /// cannot be told apart then.
    fn nothing_succeeds(&mut self, now: Instant) -> bool {
        let busy = !self.in_flight.is_empty();
        let lost = self.ledger.attribution().lost_lately(now);
        if self.ledger.good().is_some() || busy || lost || self.ledger.queued() > 0 {
            return false;
        }
        let Some(untried) = self.fleet.untried() else {
            return false;
        };
        let mut dispatched = false;
        for server in untried {
            // Bypass the queue, which would pass over a slow server.
            if let Some(piece) = self.ledger.take_aside_for(server) {
                dispatched = true;
                self.start(piece, server, now);
            }
        }
        !dispatched
    }

    fn fail_for_good(
        &mut self,
        piece: &Piece,
        verdict: Verdict,
        downs: u32,
        reason: &str,
        now: Instant,
    ) {
        let quarantined = verdict == Verdict::Quarantined;
        let text = if quarantined {
            format!(
                "an evaluation is quarantined: servers failed {downs} times while evaluating nothing else; last reason: {reason}"
            )
        } else {
            format!(
                "an evaluation failed after {} attempts: {reason}",
                piece.tries
            )
        };
        let (candidates, episodes) = self.ledger.extent(piece);
        let evaluation = FailedEvaluation {
            candidate: candidates.start,
            episode: episodes.start,
            quarantined: quarantined.then_some(downs),
        };
        self.outbox.evaluation_failed(evaluation, text);
        self.counts.quarantined += u64::from(quarantined);
        self.give_up(piece, quarantined, now);
    }

    /// Returns why the work cannot be done although its candidates may be sound. `patience`: how long to wait for
    /// servers that fail evaluations that succeeded before.
    #[must_use]
    pub fn undecided(&self, patience: Duration, now: Instant) -> Option<String> {
        if let Some(reason) = self.outlook.undecided() {
            return Some(reason.to_owned());
        }
        let reason = self.outlook.useless(&self.fleet, patience, now)?;
        Some(format!("{reason}: {}", self.describe()))
    }
}
