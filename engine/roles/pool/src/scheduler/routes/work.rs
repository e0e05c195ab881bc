//! Routes for the start and the end of work.

use std::time::Instant;

use swarmwright_protocol::Topic;

use crate::scheduler::Action;
use crate::scheduler::Scheduler;
use crate::scheduler::job::Job;
use crate::scheduler::modes::request::Request;
use crate::scheduler::queue::ledger::Ledger;
use crate::scheduler::queue::results::Results;
use crate::scheduler::queue::results::Settled;
use crate::work::{Work, WorkError};

impl Scheduler {
    /// Starts a block of work.
    pub fn submit(&mut self, work: Work, now: Instant) {
        self.cancel();
        self.messages.begin(&self.config, work.seeds());
        self.config
            .demand
            .set_controllers(work.kind(), work.architecture());
        for (server, reason) in self.fleet.assign(&self.config.demand) {
            self.outbox
                .warn(format!("server {server} is not used: it {reason}"));
        }
        self.settle_sizes();
        self.outlook.begin();
        self.fleet.new_work();
        self.work_number += 1;
        self.limits.begin(self.beside(&work));
        self.ledger = Ledger::new(work, self.config.demand.metrics.len());
        self.discovery.work_began(now);
        self.dispatch(now);
    }

    /// Settles the numbers of sensors and actuators when the run begins, and excludes servers that announce other
    /// numbers than most.
    pub(crate) fn settle_sizes(&mut self) {
        for (server, reason) in self.fleet.settle_sizes() {
            self.outbox
                .warn(format!("server {server} is not used: it {reason}"));
        }
    }

    /// Adds candidates to the work in progress; see [`Work::extend`].
    ///
    /// # Errors
    /// As [`Work::extend`].
    pub fn extend(&mut self, genomes: &[f32], now: Instant) -> Result<(), WorkError> {
        self.ledger.extend(genomes)?;
        self.dispatch(now);
        Ok(())
    }

    /// Takes the candidates whose episodes have all ended since the last call.
    pub fn take_settled(&mut self) -> Settled {
        self.hands_out();
        self.ledger.take_settled()
    }

    /// Takes the results of all candidates in all episodes, once all have ended.
    pub fn take_results(&mut self) -> Results {
        self.take_all().0
    }

    /// Like [`take_results`](Self::take_results), together with the submitted work.
    pub fn take_all(&mut self) -> (Results, Option<Work>) {
        self.hands_out();
        self.ledger.take_results()
    }

    /// Gives up all work, and ends the jobs of all servers.
    pub fn cancel(&mut self) {
        let requests = self.in_flight.clear();
        for (server, jobs) in self.fleet.take_all_jobs() {
            let mut offloaded = false;
            for job in &jobs {
                match job {
                    Job::Episode(hash) => {
                        self.in_flight.remember(hash, server, false);
                        self.end_run(server, hash);
                    }
                    Job::Request(number) => match requests.get(number) {
                        Some(Request {
                            batch: Some(batch), ..
                        }) => {
                            let step = batch.steps().saturating_sub(1);
                            self.end_batch(server, *number, step);
                        }
                        _ => offloaded = true,
                    },
                }
            }
            if offloaded {
                self.let_go(server);
            }
        }
        self.ledger = Ledger::default();
        self.audits.clear();
    }

    /// Frees all servers that this tool still holds.
    pub fn release(&mut self) {
        self.cancel();
        for (server, hash) in self.fleet.release() {
            let hash = hash.unwrap_or_else(|| self.messages.new_hash());
            self.end_run(server, &hash);
        }
    }

    /// Frees a server, and ends its remaining jobs for this tool.
    pub(crate) fn let_go(&mut self, server: u64) {
        let last = self.fleet.last_hash(server);
        let hash = last.unwrap_or_else(|| self.messages.new_hash());
        self.end_run(server, &hash);
    }

    pub(crate) fn publish(&mut self, topic: Topic, payload: Vec<u8>) {
        if matches!(topic, Topic::Parameters | Topic::Actuator) {
            self.limits.sent_whole(payload.len());
        }
        self.outbox.publish(topic, payload);
    }

    /// Starts or ends an episode. The message goes to the server's own topic if the server listens there.
    pub(crate) fn control(&mut self, server: u64, hash: String, run: bool) {
        // The instance selects one of two servers that share an id.
        let instance = run.then(|| self.fleet.instance(server)).flatten();
        let control = self
            .messages
            .control(&self.config, server, instance, hash, run);
        let payload = control.encode();
        if self.fleet.hears_own_topic(server) {
            self.outbox.push(Action::Control { server, payload });
        } else {
            self.publish(Topic::Control, payload);
        }
    }

    /// Warns the user once about the learnt limits of the broker.
    pub(crate) fn tell_of_limits(&mut self) {
        if let Some(text) = self.limits.take_news(self.finished()) {
            self.outbox.warn(text);
        }
    }
}
