//! Who is there: rounds of discovery, the answers to them, presence.

use std::time::{Duration, Instant};

use swarmwright_protocol::{Presence, ServerMessage, State, Topic};

use crate::scheduler::Scheduler;
use crate::scheduler::fleet::offers::Answer;
use crate::scheduler::fleet::slot::Job;
use crate::scheduler::modes::episode::Episode;
use crate::scheduler::retry::Blame;
/// Pause between two rounds of discovery while no server is there; it doubles up to `LATER_ROUND`.
pub(crate) const FIRST_ROUND: Duration = Duration::from_millis(100);
pub(crate) const LATER_ROUND: Duration = Duration::from_secs(2);
/// Rounds whose answers are still understood.
const ROUNDS: usize = 16;
/// How long a server that is new waits for its first work, where two may have one id.
pub(crate) const PROBATION: Duration = Duration::from_millis(30);

impl Scheduler {
    pub(crate) fn server(&mut self, message: ServerMessage, now: Instant) {
        let Some((_, round)) = self
            .rounds
            .iter()
            .find(|(hash, _)| *hash == message.simulation_hash)
        else {
            return self.offers.answered_another(message, &self.config.demand);
        };
        let (id, round) = (message.server, *round);
        let announced = message.capabilities.swarmwright.as_ref();
        if self.has_ended(id, announced.and_then(|announced| announced.pid)) {
            return;
        }
        let instance = announced.and_then(|announced| announced.instance.clone());
        self.came_back(id, instance.as_deref(), now);
        match self
            .offers
            .answered(message, round, &self.config.demand, now)
        {
            // Were there another server with this id, its answer would come now: two that step one episode spoil it.
            Answer::Welcome => self.offers.introduce(id, now + self.config.probation, now),
            Answer::Known => {
                self.proven(id);
                self.vacant(id, round, now);
            }
            Answer::Unfit(None) => {}
            Answer::Unfit(Some(reason)) => self
                .outbox
                .warn(format!("server {id} answered, but {reason}")),
            Answer::Twins(jobs, news) => self.are_two(id, jobs, news, now),
        }
    }

    pub(crate) fn presence(&mut self, presence: Presence, now: Instant) {
        if presence.state == State::Lost && self.watched.contains(&presence.server) {
            let announced = presence.capabilities.swarmwright.as_ref();
            let pid = announced.and_then(|announced| announced.pid);
            // Whoever watches the process says more in a moment, or has.
            if !self.has_ended(presence.server, pid) {
                self.offers.fell_silent(presence.server);
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
        let lost = presence.state == State::Lost && self.offers.slots.contains_key(&id);
        let (ended, discover) = self.offers.present(presence, &self.config.tool);
        if lost && ended.as_ref().is_some_and(|ended| ended.jobs.is_empty()) {
            self.ledger.suspicions.shaken(None, now);
        }
        if let Some(mut ended) = ended {
            if !ended.own_fault {
                // A run that has begun is ours; the presence is older.
                ended.jobs.retain(|job| {
                    matches!(job, Job::Episode(hash) if !self.in_flight.episode(hash).is_some_and(Episode::begun))
                });
            }
            if !ended.jobs.is_empty() {
                self.offers.remove(ended.server);
                let blame = if ended.own_fault {
                    self.failed(ended.server, &ended.reason, now);
                    Blame::Lost
                } else {
                    Blame::Nobody
                };
                self.fail_jobs(ended.jobs, &ended.reason, blame, now);
            }
        }
        if discover {
            self.next_round = self.next_round.min(now);
        }
    }

    pub(crate) fn discover(&mut self, now: Instant) {
        self.round += 1;
        let hash = self.messages.new_hash();
        self.rounds.push_back((hash.clone(), self.round));
        if self.rounds.len() > ROUNDS {
            self.rounds.pop_front();
        }
        let discovery = self.messages.discovery(&self.config, hash);
        self.publish(Topic::Discovery, discovery.encode());
        self.round_pause = if self.has_server() {
            LATER_ROUND
        } else {
            (self.round_pause * 2).min(LATER_ROUND)
        };
        if self.ledger.suspicions.has_suspects() {
            // Before the next time-out it must be known who is there.
            let often = (self.config.step_timeout / 4).max(FIRST_ROUND);
            self.round_pause = self.round_pause.min(often);
        }
        self.next_round = now + self.round_pause;
    }

    /// The connection is back.
    pub fn connected(&mut self, now: Instant) {
        // Servers whose own connection held know nothing of it, and wait for the next step.
        for (server, hash) in std::mem::take(&mut self.left_behind) {
            let hash = hash.unwrap_or_else(|| self.messages.new_hash());
            self.end_run(server, &hash);
        }
        self.round_pause = FIRST_ROUND;
        self.next_round = now;
    }
}
