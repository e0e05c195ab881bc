//! Requests to servers: blocks for offloaded evaluation, and batches of episodes (docs/reference/protocol.md).

use std::time::{Duration, Instant};

use swarmwright_protocol::{DecodeError, Refusal, RefusalKind, ToServer, ToTool};

use crate::journal::{Attempt, Outcome};
use crate::scheduler::job::Job;
use crate::scheduler::modes::batch::Batch;
use crate::scheduler::modes::request::Request;
use crate::scheduler::queue::blame::{Blame, Cause};
use crate::scheduler::queue::piece::Piece;
use crate::scheduler::{Action, Scheduler};

/// Number of refused requests in a row above which a server is reported, as it is not merely shared with other tools.
const OFTEN: u32 = 5;

impl Scheduler {
    pub(super) fn request(
        &mut self,
        message: &ToServer,
        piece: Piece,
        server: u64,
        lease: Duration,
        batch: Option<Batch>,
        now: Instant,
    ) {
        let request = Request::new(piece, server, lease, batch, now);
        let number = self.in_flight.begin_request(request);
        self.ask(server, number, message);
        self.fleet.began(server, Job::Request(number));
    }

    /// Handles a request that is too large to send; the broker would refuse it for any server.
    pub(crate) fn unsent(&mut self, number: u64, reason: &str, now: Instant) {
        let cause = Cause {
            outcome: Outcome::Unusable,
            blame: Blame::Evaluation,
            reason,
        };
        self.fail_request(number, cause, now);
        self.dispatch(now);
    }

    pub(super) fn ask(&mut self, server: u64, request: u64, message: &ToServer) {
        let payload = message.encode();
        let pending = self.in_flight.request(request);
        if pending.is_some_and(|request| request.piece.len() == 1) {
            self.limits.sent_whole(payload.len());
        }
        self.outbox.push(Action::Request {
            server,
            request,
            payload,
        });
    }

    /// Handles an answer to a request; answers that nothing waits for are ignored.
    pub(crate) fn answered(&mut self, message: ToTool, now: Instant) {
        let before = self.changes();
        self.answer(message, now);
        // Skip dispatch for steps that change nothing: most steps end no episode, and thousands of them arrive each
        // second.
        if self.changes() != before {
            self.tell_of_limits();
            self.dispatch(now);
        }
    }

    /// Handles an answer that cannot be read. If it names its request, the server has failed on it.
    pub(crate) fn unreadable_answer(
        &mut self,
        topic: &str,
        payload: &[u8],
        error: &DecodeError,
        now: Instant,
    ) {
        let addressee = ToTool::answered(payload).filter(|(server, number)| {
            let request = self.in_flight.request(*number);
            request.is_some_and(|request| request.server == *server)
        });
        match addressee {
            Some((server, number)) => {
                let reason = format!("its answer to request {number} cannot be used: {error}");
                self.misbehaved(server, &reason, now);
                self.dispatch(now);
            }
            None => self
                .outbox
                .warn_once(format!("refusing an answer on {topic}: {error}")),
        }
    }

    /// Returns counters that change when there is new work to dispatch, or a server for it.
    fn changes(&self) -> (usize, usize, usize) {
        (self.journal.len(), self.ledger.queued(), self.fleet.woken())
    }

    fn answer(&mut self, message: ToTool, now: Instant) {
        match message {
            ToTool::Evaluated(message) => {
                let number = message.request;
                match (
                    self.is_batch(number, message.server, message.fitness.0.len(), now),
                    &message.error,
                ) {
                    (Some(_), Some(refusal)) => self.refused(number, message.server, refusal, now),
                    (Some(false), None) => self.evaluated(number, message, now),
                    _ => {}
                }
            }
            ToTool::Sensors(message) => {
                let number = message.request;
                match (
                    self.is_batch(number, message.server, message.ended.0.len(), now),
                    &message.error,
                ) {
                    (Some(_), Some(refusal)) => self.refused(number, message.server, refusal, now),
                    (Some(true), None) => self.stepped(number, message, now),
                    (None, None) => self.end_stray_batch(&message),
                    _ => {}
                }
            }
            ToTool::Failed(message) => self.episode_failed(message, now),
            // The pool requests no scenes.
            ToTool::Scene(_) => {}
        }
    }

    /// Returns whether a request is a batch; `None` if it was not sent to this server or has ended, so that its
    /// `results` are late.
    fn is_batch(&mut self, number: u64, server: u64, results: usize, now: Instant) -> Option<bool> {
        let Some(request) = self.in_flight.request(number) else {
            self.counts.late += u64::from(results > 0);
            if !self.in_flight.was_asked(number) {
                self.outbox.warn_first(
                    format!("a request that was not sent, server {server}"),
                    format!(
                        "ignoring an answer of server {server} to request {number}, which this tool has not sent; \"request\" of \
                         an answer must be the number of the request that it answers"
                    ),
                );
            }
            return None;
        };
        let is_batch = request.batch.is_some();
        if request.server != server {
            let addressee = request.server;
            self.outbox.warn_once(format!(
                "ignoring an answer to request {number}, which was sent to server {addressee}: it claims to be of server {server}"
            ));
            return None;
        }
        self.fleet.answered_request(server, now);
        Some(is_batch)
    }

    /// Handles a failed evaluation of a request on a server that continues.
    pub(super) fn fail_one(
        &mut self,
        request: &Request,
        offset: usize,
        reason: String,
        stack: Option<String>,
        now: Instant,
    ) {
        let index = request.piece.first() + offset;
        let piece = request.piece.part(index..index + 1);
        let (reason, stack) = self.outbox.episode_failed(request.server, reason, stack);
        let attempt = Attempt {
            stack,
            ..request.attempt(Outcome::Failed, Some(reason.clone()))
        };
        self.record(attempt, &piece, request.started, now);
        self.retry(piece, request.server, &reason, Blame::Evaluation, now);
    }

    /// Handles a refusal of a server.
    pub(super) fn refused(&mut self, number: u64, server: u64, refusal: &Refusal, now: Instant) {
        let reason = &refusal.reason;
        let (jobs, cause) = match refusal.kind {
            // The server waited in vain for this tool or cannot do this request; the simulation is not at fault.
            RefusalKind::Failed => {
                let reason = format!("server {server}: {reason}");
                let blame = Blame::Silent { others: false };
                return self.fail_server(server, &reason, blame, now);
            }
            RefusalKind::Taken => {
                let times = self.fleet.refused_as_taken(server);
                if times.is_multiple_of(OFTEN) {
                    let reason = format!(
                        "server {server} answers discovery, but has refused {times} requests in a row, as another tool has it: \
                         {reason}"
                    );
                    self.outbox.warn(reason.clone());
                    self.failed(server, &reason, now);
                }
                (self.fleet.remove(server), Cause::handed_back(reason))
            }
            RefusalKind::Invalid => {
                self.outlook.refused(now);
                self.outbox
                    .warn(format!("server {server} refuses the work: {reason}"));
                let jobs = self.fleet.refuse(server, reason);
                (jobs, Cause::server(reason, Blame::None))
            }
        };
        // Even if the server was given up in the meantime.
        self.fail_request(number, cause, now);
        self.fail_jobs(jobs, cause.of_others(), now);
    }

    /// Ends a request without a result; see [`retry`](Self::retry).
    pub(crate) fn fail_request(&mut self, number: u64, cause: Cause<'_>, now: Instant) {
        let Some(request) = self.in_flight.take_request(number) else {
            return;
        };
        let server = request.server;
        self.fleet.finished(server, &Job::Request(number));
        self.record_request(&request, cause.outcome, Some(cause.reason.to_owned()), now);
        let alone = request.piece.len() == 1;
        for piece in request.rest() {
            let blame = cause.blame.of_begun(piece.len() == 1 && !alone);
            self.retry(piece, server, cause.reason, blame, now);
        }
    }

    pub(crate) fn record_request(
        &mut self,
        request: &Request,
        outcome: Outcome,
        error: Option<String>,
        now: Instant,
    ) {
        let attempt = Attempt {
            steps: request.batch.as_ref().map(Batch::steps),
            ..request.attempt(outcome, error)
        };
        self.record(attempt, &request.piece, request.started, now);
    }

    /// Handles requests that were not answered within their lease.
    pub(crate) fn late_requests(&mut self, now: Instant) {
        for number in self.in_flight.late_requests(now) {
            if let Some(request) = self.in_flight.request_mut(number) {
                if self.processes.are_watched(request.server) && request.asks_supervisor() {
                    self.outbox.push(Action::Overdue(request.server));
                    continue;
                }
                let (server, heard) = (request.server, request.heard());
                let reason = format!(
                    "{}; {}",
                    request.waiting_for(now),
                    self.config.timeouts.step_hint()
                );
                self.counts.time_outs += 1;
                self.fleet.fell_silent(server);
                let others = self.fleet.anyone_spoke(heard, now);
                self.fail_server(server, &reason, Blame::Silent { others }, now);
            }
        }
    }

    /// Handles an unusable message of a server.
    pub(super) fn misbehaved(&mut self, server: u64, reason: &str, now: Instant) {
        let reason = format!("server {server}: {reason}");
        self.fail_server(server, &reason, Blame::Answer, now);
    }

    /// Handles a failure of a server: its oldest job is blamed, all its jobs are retried elsewhere, and it backs off.
    fn fail_server(&mut self, server: u64, reason: &str, blame: Blame, now: Instant) {
        let retry = self.fleet.describe_retry(server);
        self.outbox
            .warn(format!("{reason}; the work is tried again{retry}"));
        self.let_go(server);
        self.failed_in_vain(server, reason, now);
        let jobs = match self.fleet.slot(server) {
            Some(slot) => slot.jobs.clone(),
            None => Vec::new(),
        };
        self.fail_jobs(jobs, Cause::server(reason, blame), now);
    }
}
