//! Routes for results: which of them count, and what they end.

use std::time::Instant;

use crate::journal::Outcome;
use crate::scheduler::Scheduler;
use crate::scheduler::modes::in_flight::{Dropped, LateFitness};
use crate::scheduler::queue::blame::Cause;
use crate::scheduler::queue::piece::{Piece, Purpose};
use crate::scheduler::queue::results::ServerResult;

/// Number of episodes with a repeated fitness before the user is warned; a single message may have been duplicated on
/// its way.
const MOST_REPEATED: usize = 3;

impl Scheduler {
    /// Handles a result. It counts unless the evaluation already has one, or must be audited first.
    pub(super) fn settle(
        &mut self,
        piece: &Piece,
        evaluation: usize,
        result: ServerResult,
        now: Instant,
    ) {
        self.server_succeeded(result.server, 1);
        self.settle_proven(piece, evaluation, result, now);
    }

    /// Like [`settle`](Self::settle), if the success of the server has been recorded already.
    pub(super) fn settle_proven(
        &mut self,
        piece: &Piece,
        evaluation: usize,
        result: ServerResult,
        now: Instant,
    ) {
        if piece.purpose == Purpose::Probe {
            return;
        }
        if piece.purpose == Purpose::Audit || self.audits.has(evaluation) {
            return self.audited(evaluation, result, now);
        }
        if self.ledger.has_ended(evaluation) {
            self.counts.double += 1;
            return;
        }
        if self.is_to_be_audited(evaluation, result.server) {
            return self.audit(evaluation, result);
        }
        self.count(evaluation, &result, now);
    }

    /// Like [`settle_proven`](Self::settle_proven), for a whole piece without metrics. Returns false without any effect
    /// if its evaluations must be handled one by one.
    pub(super) fn settle_whole(&mut self, piece: &Piece, server: u64, fitness: &[f64]) -> bool {
        let audits = self.config.faults.audit > 0.0 || !self.audits.is_empty();
        piece.purpose == Purpose::Work
            && !audits
            && self
                .ledger
                .settle_whole(&piece.evaluations, server, fitness)
    }

    /// Accepts a result and ends the copies of its evaluation.
    pub(super) fn count(&mut self, evaluation: usize, result: &ServerResult, now: Instant) {
        let shared = self.ledger.is_shared(evaluation);
        self.ledger
            .settle(evaluation, result.server, result.fitness, &result.metrics);
        if shared {
            self.doubt_overtaken(evaluation, now);
            let reason = format!("server {} was faster", result.server);
            self.drop_copies(evaluation, Outcome::Overtaken, &reason, now);
        }
    }

    /// Marks the other servers of an ended evaluation as doubtful if they have been silent for long.
    fn doubt_overtaken(&mut self, evaluation: usize, now: Instant) {
        for (server, job) in self
            .in_flight
            .jobs_of(|piece| self.ledger.is_over(piece, evaluation))
        {
            let since = self.view().ignored_since(server, &job, now);
            let waiting = self.in_flight.waiting_for(&job, now);
            if let (Some(since), Some(waiting)) = (since, waiting) {
                self.fleet.was_overtaken(server, waiting, since);
            }
        }
    }

    /// Ends all work in flight for an evaluation that has ended, unless other evaluations depend on it.
    pub(super) fn drop_copies(
        &mut self,
        evaluation: usize,
        outcome: Outcome,
        reason: &str,
        now: Instant,
    ) {
        self.drop_all(
            |scheduler, piece| scheduler.ledger.is_over(piece, evaluation),
            outcome,
            reason,
            now,
        );
    }

    /// Ends the probes in flight without recording them.
    pub(super) fn drop_probes(&mut self, now: Instant) {
        let reason = "all work is done";
        self.drop_all(
            |_, piece| piece.purpose == Purpose::Probe,
            Outcome::Dropped,
            reason,
            now,
        );
    }

    fn drop_all(
        &mut self,
        over: impl Fn(&Self, &Piece) -> bool,
        outcome: Outcome,
        reason: &str,
        now: Instant,
    ) {
        for (server, job) in self.in_flight.jobs_of(|piece| over(self, piece)) {
            self.fleet.finished(server, &job);
            match self.in_flight.drop_job(job) {
                Some(Dropped::Episode(hash, episode)) => {
                    if episode.piece.purpose != Purpose::Probe {
                        self.record_run(&episode, outcome, Some(reason.to_owned()), None, now);
                    }
                    self.end_run(server, &hash);
                }
                Some(Dropped::Request(number, request)) => {
                    if request.piece.purpose != Purpose::Probe {
                        self.record_request(&request, outcome, Some(reason.to_owned()), now);
                    }
                    if let Some(batch) = &request.batch {
                        // The message goes to the server's own topic, since every server receives control messages.
                        let step = batch.steps().saturating_sub(1);
                        self.end_batch(server, number, step);
                        continue;
                    }
                    // A single one of two requests cannot be ended.
                    let others = self.fleet.take_jobs(server);
                    self.let_go(server);
                    self.fail_each(others, Cause::lost(reason), now);
                }
                None => {}
            }
        }
    }

    /// Handles a fitness for an episode that is not in flight.
    pub(super) fn unexpected_fitness(&mut self, hash: &str, fitness: f64) {
        match self.in_flight.came_again(hash, fitness) {
            LateFitness::Other(server) => {
                self.counts.double += 1;
                // A single server may be at fault; results are kept so that the run can finish.
                self.outbox.warn_once(format!(
                    "server {server} has sent two different fitness values for one episode, of which the first counts: \
                     two servers may have this id, or it evaluates an episode twice; results of this run may be wrong"
                ));
            }
            LateFitness::Same(server, times) => {
                self.counts.double += 1;
                if times >= MOST_REPEATED {
                    self.outbox.warn_once(format!(
                        "server {server} sends every result twice; two servers may have this id: if so, end one of them, or \
                         give it another --id"
                    ));
                }
            }
            LateFitness::GivenUp => self.counts.late += 1,
            LateFitness::Unknown => {}
        }
    }
}
