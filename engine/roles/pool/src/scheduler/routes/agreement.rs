//! Routes for audits and for servers with wrong results; see [`audit`](super::audit).

use std::time::Instant;

use crate::scheduler::Scheduler;
use crate::scheduler::audit::Compared;
use crate::scheduler::queue::blame::{Blame, Cause};
use crate::scheduler::queue::piece::Piece;
use crate::scheduler::queue::results::ServerResult;

impl Scheduler {
    /// Returns whether an evaluation must be repeated on another server before its result counts.
    pub(super) fn is_to_be_audited(&mut self, evaluation: usize, server: u64) -> bool {
        if self.ledger.repeats() {
            return false;
        }
        let share = self.config.faults.audit;
        let seed = self.config.first_instance ^ self.work_number;
        let fleet = &self.fleet;
        let drawn = self.audits.draws(share, seed, evaluation, server, fleet);
        if drawn && !self.fleet.has_auditor_but(&[server]) {
            self.leave_audit_out(server);
            return false;
        }
        drawn
    }

    /// Accepts a result without the audit drawn for it, because no other server can repeat it.
    fn leave_audit_out(&mut self, server: u64) {
        self.counts.audits_left_out += 1;
        self.outbox.warn_unaudited(
            format!(
                "results of server {server} count without the audits that faults.audit requires, since no other usable server \
                 can repeat them"
            ),
        );
    }

    /// Queues an audit of an evaluation; its first result waits.
    pub(super) fn audit(&mut self, evaluation: usize, first: ServerResult) {
        let Some(never) = self.fleet.auditors_but(&[first.server]) else {
            return;
        };
        self.counts.audits += 1;
        self.ledger.queue(Piece::audit(evaluation, never));
        self.audits.wait(evaluation, first, None);
    }

    /// Handles the result of an audit.
    pub(super) fn audited(&mut self, evaluation: usize, result: ServerResult, now: Instant) {
        match self.audits.compare(evaluation, result, &self.fleet) {
            Compared::Late => self.counts.late += 1,
            Compared::Double => self.counts.double += 1,
            Compared::Agreed(result) => self.confirm(evaluation, &result, now),
            Compared::Differ(first, second) => {
                self.counts.disagreements += 1;
                self.ask_third(evaluation, first, second, now);
            }
            Compared::Wrong { right, wrong } => {
                self.confirm(evaluation, &right[0], now);
                self.exclude(evaluation, &wrong, &right, now);
            }
            Compared::AllDiffer(results) => self.disagree(evaluation, &results),
        }
    }

    fn confirm(&mut self, evaluation: usize, result: &ServerResult, now: Instant) {
        self.ledger.unqueue(evaluation);
        self.count(evaluation, result, now);
    }

    /// Lets a third server decide between two that disagree, if there is one.
    fn ask_third(
        &mut self,
        evaluation: usize,
        first: ServerResult,
        second: ServerResult,
        now: Instant,
    ) {
        let description = self
            .ledger
            .describe(evaluation, &[first.clone(), second.clone()]);
        let servers = [first.server, second.server];
        let Some(never) = self.fleet.auditors_but(&servers) else {
            return self.disagree(evaluation, &[first, second]);
        };
        self.outbox
            .warn(format!("{description}; a third server decides"));
        // Dispatch at once: until the decision, the wrong server would get more work.
        self.ledger.queue_first(Piece::audit(evaluation, never));
        self.audits.wait(evaluation, first, Some(second));
        self.dispatch(now);
    }

    /// Records that it is unknown which server is wrong.
    fn disagree(&mut self, evaluation: usize, results: &[ServerResult]) {
        let description = self.ledger.describe(evaluation, results);
        self.outlook.disagree(format!(
            "{description}; which one is right can only be decided with more servers that agree{}",
            self.fleet.other_cause(results)
        ));
    }

    /// Excludes a server that two others have proved wrong, and repeats its evaluations.
    fn exclude(
        &mut self,
        evaluation: usize,
        wrong: &ServerResult,
        right: &[ServerResult],
        now: Instant,
    ) {
        let server = wrong.server;
        let mut results = right.to_vec();
        results.push(wrong.clone());
        let reason = format!(
            "server {server} gives wrong results and is no longer used: {}",
            self.ledger.describe(evaluation, &results)
        );
        let cause = self.fleet.other_cause(&results);
        self.let_go(server);
        let jobs = self.fleet.distrust(server, &reason);
        let (reopened, lost) = self.redo(server, now);
        let handed = match lost {
            0 => String::new(),
            _ => format!("; {lost} of its evaluations had already been used and stay as they are"),
        };
        self.outbox.warn(format!(
            "{reason}{cause}; {reopened} of its evaluations are repeated{handed}"
        ));
        self.fail_jobs(jobs, Cause::server(&reason, Blame::None), now);
    }

    /// Repeats the evaluations of an excluded server. Returns the number of repeated evaluations, and the number that
    /// cannot be repeated because they have been returned.
    pub(super) fn redo(&mut self, server: u64, now: Instant) -> (usize, usize) {
        let (reopened, lost) = self.ledger.reopen(server);
        self.counts.recomputed += reopened as u64;
        for (evaluation, mut results) in self.audits.take_all() {
            results.retain(|result| result.server != server);
            match <[ServerResult; 1]>::try_from(results) {
                Ok([first]) => {
                    self.ledger.unqueue(evaluation);
                    self.audit(evaluation, first.clone());
                    if !self.audits.has(evaluation) {
                        self.confirm(evaluation, &first, now);
                    }
                }
                Err(results) if results.is_empty() => {
                    self.ledger.unqueue(evaluation);
                    self.ledger.put_back(&Piece::again(evaluation));
                }
                Err(mut both) => {
                    let second = both.pop();
                    if let Some(first) = both.pop() {
                        self.audits.wait(evaluation, first, second);
                    }
                }
            }
        }
        (reopened, lost)
    }

    /// Retries a failed audit, or gives it up after the last attempt.
    pub(super) fn retry_audit(
        &mut self,
        piece: Piece,
        server: u64,
        reason: &str,
        blame: Blame,
        now: Instant,
    ) {
        let evaluation = piece.first();
        if !self.audits.has(evaluation) {
            return;
        }
        if matches!(blame, Blame::None | Blame::Broker) {
            return self.ledger.put_back(&piece);
        }
        if piece.tries + 1 < self.config.faults.attempts {
            self.counts.retries += 1;
            return self.ledger.put_back(&piece.failed(server));
        }
        self.outbox.warn_counted(format!(
            "an audit failed after {} attempts: {reason}",
            piece.tries + 1
        ));
        self.let_pass(evaluation, now);
    }

    /// Accepts results without an audit if no second server is left.
    pub(super) fn settle_unchecked(&mut self, now: Instant) {
        for (evaluation, server) in self.audits.unchecked(&self.fleet, &self.in_flight) {
            if let Some(server) = server {
                self.counts.audits = self.counts.audits.saturating_sub(1);
                self.leave_audit_out(server);
            }
            self.let_pass(evaluation, now);
        }
    }

    fn let_pass(&mut self, evaluation: usize, now: Instant) {
        match self.audits.end(evaluation) {
            Some((first, None)) => self.confirm(evaluation, &first, now),
            Some((first, Some(second))) => self.disagree(evaluation, &[first, second]),
            None => {}
        }
    }
}
