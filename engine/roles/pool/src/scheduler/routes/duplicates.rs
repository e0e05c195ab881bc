//! Two servers with one id.
//!
//! Servers that say which start of them answers are told apart by that, and what is meant for one is not done by the other.
//! Of others two step one episode, and its result is wrong: so what came under the id is computed again, as far as it has
//! not been handed out.

use std::collections::BTreeSet;
use std::time::Instant;

use crate::scheduler::Scheduler;
use crate::scheduler::job::Job;
use crate::scheduler::queue::blame::{Blame, Cause};

impl Scheduler {
    /// An episode goes on whose server has answered a discovery meanwhile, as none does that is at an episode.
    pub(super) fn found_two(&mut self, id: u64, round: u64, now: Instant) {
        let (jobs, news) = self.fleet.are_two(id, round);
        self.are_two(id, jobs, news, now);
    }

    /// Two servers have an id: it is not used until one is left, and what came under it counts no more.
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

    /// Results are handed out. Of servers that say which start of them answers there is no doubt.
    pub(super) fn hands_out(&mut self) {
        if self.ledger.is_revised() {
            return;
        }
        let slots = self.fleet.slots();
        let doubtful = slots.filter(|(_, slot)| slot.instance.is_none());
        let doubtful: BTreeSet<u64> = doubtful.map(|(id, _)| id).collect();
        if doubtful.is_empty() {
            return;
        }
        let authors = self.ledger.authors().into_iter();
        for id in authors.filter(|id| doubtful.contains(id)) {
            self.unproven.handed_out(id);
        }
    }
}
