//! Routes for two servers with one id.
//!
//! Servers that announce their instance are told apart by it, and each ignores messages meant for the other. Two
//! servers that do not may step the same episode, which makes its result wrong; so the results under the id are
//! computed again, unless they have been returned.

use std::time::Instant;

use crate::scheduler::Scheduler;
use crate::scheduler::job::Job;
use crate::scheduler::queue::blame::{Blame, Cause};

impl Scheduler {
    /// Handles an id whose server answered a discovery during an episode; no server does, so there must be two.
    pub(super) fn found_two(&mut self, id: u64, round: u64, now: Instant) {
        let (jobs, news) = self.fleet.are_two(id, round);
        self.are_two(id, jobs, news, now);
    }

    /// Handles two servers with one id: it is not used until only one is left, and results under it do not count.
    pub(super) fn are_two(&mut self, id: u64, jobs: Vec<Job>, news: bool, now: Instant) {
        for job in &jobs {
            if let Job::Episode(hash) = job {
                self.end_run(id, hash);
            }
        }
        let (redone, handed) = self.redo(id, now);
        let doubtful = handed.max(self.unproven.take(id));
        if news || redone + doubtful > 0 {
            let mut text = format!(
                "two servers answer to the id {id}, so neither is used; give one another --id"
            );
            if redone > 0 {
                text += &format!("; {redone} evaluations under this id are repeated");
            }
            if doubtful > 0 {
                text += &format!(
                    "; {doubtful} recent evaluations under this id have already been used and may be wrong"
                );
            }
            self.outbox.warn(text);
        }
        let reason = format!("two servers answer to the id {id}");
        self.fail_jobs(jobs, Cause::server(&reason, Blame::None), now);
    }

    /// Records that results are returned. Servers that announce their instance cannot be confused, so they are not
    /// recorded.
    pub(super) fn hands_out(&mut self) {
        if self.ledger.is_revised() {
            return;
        }
        let doubtful = self.fleet.without_instance();
        if !doubtful.is_empty() {
            self.unproven.handed_out(self.ledger.authors(), &doubtful);
        }
    }
}
