//! Routes for announcements of servers: answers to discovery, and presence.

use std::time::Instant;

use swarmwright_protocol::{Presence, ServerMessage, State, Topic};

use crate::scheduler::Scheduler;
use crate::scheduler::fleet::offers::Answer;
use crate::scheduler::job::Job;
use crate::scheduler::modes::episode::Episode;
use crate::scheduler::queue::blame::{Blame, Cause};

impl Scheduler {
    pub(super) fn server(&mut self, message: ServerMessage, now: Instant) {
        let Some(round) = self.discovery.round_of(&message.simulation_hash) else {
            return self
                .fleet
                .answered_other_discovery(message, &self.config.demand);
        };
        let id = message.server;
        // A server that is running an episode does not answer discoveries.
        self.fleet.left_behind().remove(id);
        self.in_flight.forget_unanswered(id);
        let announced = message.capabilities.swarmwright.as_ref();
        if self
            .processes
            .has_ended(id, announced.and_then(|announced| announced.pid))
        {
            return;
        }
        let instance = announced.and_then(|announced| announced.instance.clone());
        self.came_back(id, instance.as_deref(), now);
        match self
            .fleet
            .answered(message, round, &self.config.demand, now)
        {
            // Another server with this id would answer now; two servers that step one episode spoil its result.
            Answer::Welcome => self.fleet.introduce(id, now + self.config.probation, now),
            Answer::Known => {
                self.unproven.proven(id);
                self.in_flight.server_answered(id, round, now);
            }
            Answer::Unfit(None) => {}
            Answer::Unfit(Some(reason)) => self
                .outbox
                .warn(format!("server {id} answered, but {reason}")),
            Answer::Duplicate(jobs, news) => self.are_two(id, jobs, news, now),
        }
    }

    pub(super) fn presence(&mut self, presence: Presence, now: Instant) {
        if presence.state == State::Lost && self.processes.are_watched(presence.server) {
            let announced = presence.capabilities.swarmwright.as_ref();
            let pid = announced.and_then(|announced| announced.pid);
            // The supervisor will report details in a moment, or has done so.
            if !self.processes.has_ended(presence.server, pid) {
                self.fleet.fell_silent(presence.server);
            }
            return;
        }
        let announced = presence.capabilities.swarmwright.as_ref();
        let instance = announced.and_then(|announced| announced.instance.clone());
        if presence.state == State::Lost {
            self.suspect(presence.server, instance.as_deref(), now);
        } else {
            self.came_back(presence.server, instance.as_deref(), now);
        }
        let id = presence.server;
        let lost = presence.state == State::Lost && self.fleet.slot(id).is_some();
        if presence.state == State::Busy {
            let tool = presence.tool.as_deref();
            self.in_flight
                .server_is_busy(id, tool, &self.config.tool, now);
        }
        let (ended, discover) = self.fleet.present(presence, &self.config.tool);
        if lost && ended.as_ref().is_some_and(|ended| ended.jobs.is_empty()) {
            self.ledger.attribution_mut().server_lost(None, now);
        }
        if let Some(mut ended) = ended {
            if !ended.server_fault {
                // An episode that has begun belongs to this tool; the presence is outdated.
                ended.jobs.retain(|job| {
                    matches!(job, Job::Episode(hash) if !self.in_flight.episode(hash).is_some_and(Episode::begun))
                });
            }
            if !ended.jobs.is_empty() {
                self.fleet.remove(ended.server);
                let cause = if ended.server_fault {
                    self.failed(ended.server, &ended.reason, now);
                    Cause::server(&ended.reason, Blame::Lost)
                } else {
                    Cause::handed_back(&ended.reason)
                };
                self.fail_jobs(ended.jobs, cause, now);
            }
        }
        if discover {
            self.discovery.hasten(self.fleet.audience(), now);
        }
    }

    pub(super) fn discover(&mut self, now: Instant) {
        self.end_left_behind(false, now);
        let hash = self.messages.new_hash();
        let message = self.messages.discovery(&self.config, hash.clone());
        self.publish(Topic::Discovery, message.encode());
        // If servers were lost with evaluations, the remaining servers must be known before the next time-out.
        let suspects = self.ledger.attribution().has_suspects();
        let within = suspects.then_some(self.config.timeouts.step);
        self.discovery.begin(hash, self.has_server(), within, now);
    }

    /// Handles a restored connection.
    pub fn connected(&mut self, now: Instant) {
        // Servers whose own connection held did not notice the loss and wait for the next step.
        self.end_left_behind(true, now);
        self.discovery.restart(now);
    }

    /// Ends what servers may still be running for this tool although its connection broke; `all`: include servers that
    /// were notified a moment ago.
    pub(super) fn end_left_behind(&mut self, all: bool, now: Instant) {
        for (server, hash) in self.fleet.left_behind().due(all, now) {
            let hash = hash.unwrap_or_else(|| self.messages.new_hash());
            self.end_run(server, &hash);
        }
    }

    /// Handles a server that is online.
    fn came_back(&mut self, server: u64, instance: Option<&str>, now: Instant) {
        if self.limits.came_back(server, instance, now) {
            self.fleet.forgive(server);
        }
    }

    /// Records that a server's connection ended, perhaps on a message that it had just sent.
    fn suspect(&mut self, server: u64, instance: Option<&str>, now: Instant) {
        let slot = self.fleet.slot(server);
        let at = slot.and_then(|slot| match slot.jobs.first()? {
            Job::Request(number) => Some((slot, self.in_flight.request(*number)?)),
            Job::Episode(_) => None,
        });
        let results = 1 + self.config.demand.metrics.len();
        self.limits.suspect(server, instance, at, results, now);
    }
}
