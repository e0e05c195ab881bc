//! Routes for the ends of supervised processes, whose work at that moment is known.

use std::time::Instant;

use crate::journal::{Attempt, Outcome};
use crate::mode::Mode;
use crate::scheduler::Scheduler;
use crate::scheduler::fleet::processes::{At, Ending};
use crate::scheduler::job::Job;
use crate::scheduler::queue::blame::{Blame, Cause};

impl Scheduler {
    /// Declares the processes of these servers supervised; [`ended`](Self::ended) must be called when one ends.
    pub fn watch(&mut self, servers: impl IntoIterator<Item = u64>) {
        self.processes.watch(servers);
    }

    /// Returns the first candidate and the first episode of a request to a supervised server.
    pub(crate) fn place(&self, request: u64) -> Option<(usize, usize)> {
        let request = self.in_flight.request(request)?;
        if !self.processes.are_watched(request.server) {
            return None;
        }
        let (candidates, episodes) = self.ledger.extent(&request.piece);
        Some((candidates.start, episodes.start))
    }

    /// Records that a supervised server is still computing, which extends its lease.
    pub fn is_alive(&mut self, server: u64, now: Instant) {
        self.in_flight.is_alive(server, now);
    }

    /// Handles the end of a supervised process. The evaluations that it was computing are retried and blamed, if known;
    /// all its other work is queued again without blame.
    pub fn ended(&mut self, ending: &Ending, now: Instant) {
        let server = ending.server;
        self.processes.ended(server, ending.pid);
        self.counts.server_failures += 1;
        self.outbox
            .warn_counted(format!("{}; it is started again", ending.reason));
        let jobs = self.fleet.on_leave(server);
        let blame = ending.blame();
        let at = |job: &Job| matches!(job, Job::Request(number) if ending.at.is_some_and(|at| at.request == *number));
        // If the request that was being computed is known, the first one is not blamed unless it is that request.
        let is_known = jobs.iter().any(at);
        for (index, job) in jobs.into_iter().enumerate() {
            // Waiting requests are not to blame.
            let mut cause = Cause::server(&ending.reason, blame);
            if index > 0 || is_known {
                cause = cause.of_others();
            }
            match job {
                Job::Request(number) => match ending.at.filter(|at| at.request == number) {
                    Some(at) => self.fail_at(number, at, ending, now),
                    None => {
                        if self.in_flight.is_block(number) {
                            cause.blame = Blame::None;
                        }
                        self.fail_request(number, cause, now);
                    }
                },
                Job::Episode(hash) => self.fail_episode(&hash, cause, now),
            }
        }
        self.dispatch(now);
    }

    /// Handles the end of a process while it was computing a part of a block.
    fn fail_at(&mut self, number: u64, at: At, ending: &Ending, now: Instant) {
        let Some(request) = self.in_flight.take_request(number) else {
            return;
        };
        let whole = request.piece.clone();
        let columns = self.ledger.extent(&whole).1.len();
        let computed = at.evaluations(columns, &whole);
        let parts = whole.around(&computed);
        let reason = &ending.reason;
        if !parts.is_empty() {
            self.record_request(&request, Outcome::Lost, Some(reason.clone()), now);
        }
        for part in parts.into_iter().rev() {
            self.retry(part, ending.server, reason, Blame::None, now);
        }
        if computed.is_empty() {
            return;
        }
        let culprit = whole.part(computed);
        let attempt = Attempt {
            mode: Mode::Offloaded.name(),
            server: ending.server,
            outcome: Outcome::ServerFailed,
            error: Some(reason.clone()),
            stack: self.outbox.stack_once(reason, ending.stack.clone()),
            ..Attempt::default()
        };
        self.record(attempt, &culprit, request.started, now);
        self.retry(culprit, ending.server, reason, ending.blame(), now);
    }
}
