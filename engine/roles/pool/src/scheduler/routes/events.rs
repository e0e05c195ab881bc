//! Events from outside: messages, time, the state of the connection.

use std::time::{Duration, Instant};

use swarmwright_protocol::{
    Announcement, Capabilities, EXTENSION_VERSION, Message, SensorReading, ToTool, Topic,
};

use crate::journal::Outcome;
use crate::scheduler::Scheduler;
use crate::scheduler::queue::blame::{Blame, Cause};

/// Minimum interval between queries for the next tick, per server.
const TICK_QUERY_INTERVAL: Duration = Duration::from_micros(5);

impl Scheduler {
    /// Handles a message. Retained messages other than presence are remnants of earlier runs.
    pub fn receive(&mut self, topic: &str, payload: &[u8], retained: bool, now: Instant) {
        let Some(kind) = self.config.topics.parse(topic) else {
            return;
        };
        if retained && kind != Topic::Presence {
            return self.outbox.warn_once(format!(
                "ignoring a retained message on {topic}; remove it with: mosquitto_pub -r -n -t {topic}"
            ));
        }
        if kind == Topic::Presence && payload.is_empty() {
            let id = topic
                .rsplit('/')
                .next()
                .and_then(|id| id.parse().ok())
                .unwrap_or(u64::MAX);
            let jobs = self.fleet.on_leave(id);
            let reason = format!("server {id} left");
            return self.fail_jobs(jobs, Cause::server(&reason, Blame::None), now);
        }
        if kind == Topic::Sensor {
            match SensorReading::decode(payload) {
                Ok(sensor) => self.sensor(&sensor, now),
                Err(error) => self.undecodable(topic, payload, &error, now),
            }
            return;
        }
        if kind == Topic::ToTool {
            if !topic.ends_with(self.messages.reply()) {
                return;
            }
            match ToTool::decode(payload) {
                Ok(message) => self.answered(message, now),
                Err(error) => self.unreadable_answer(topic, payload, &error, now),
            }
            return;
        }
        match Message::decode(kind, payload) {
            Ok(Message::Fitness(fitness)) => self.fitness(&fitness, payload, now),
            Ok(Message::Server(message)) => {
                self.misannounced(
                    message.server,
                    &message.simulations,
                    &message.capabilities,
                    payload,
                );
                self.server(message, now);
            }
            Ok(Message::Presence(presence)) => {
                self.misannounced(
                    presence.server,
                    &presence.simulations,
                    &presence.capabilities,
                    payload,
                );
                self.presence(presence, now);
            }
            Ok(_) => {}
            Err(error) => {
                if kind == Topic::Server {
                    self.fleet.refused_answer(&error);
                }
                self.undecodable(topic, payload, &error, now);
            }
        }
    }

    /// Warns once about announcements that cannot be read, if the server has this simulation; they are ignored.
    fn misannounced(
        &mut self,
        server: u64,
        simulations: &[String],
        capabilities: &Capabilities,
        payload: &[u8],
    ) {
        if !simulations.contains(&self.config.demand.simulation) {
            return;
        }
        let announced = capabilities.swarmwright.as_ref();
        if let Some(other) = announced.filter(|announced| announced.version != EXTENSION_VERSION) {
            self.outbox.warn_once(format!(
                "server {server}: capabilities.swarmwright: \"version\" is {}, but this tool knows {EXTENSION_VERSION}; it uses \
                 only the mode stepwise of this server",
                other.version
            ));
        }
        for wrong in Announcement::mistakes(payload) {
            self.outbox.warn_once(format!(
                "server {server}: capabilities.swarmwright: {wrong}; it counts as not announced"
            ));
        }
    }

    /// Handles the answer to [`Action::AskBroker`]: whether the broker at `address` holds small packets back, or why
    /// this could not be determined.
    pub fn broker_holds_back(&mut self, answer: Result<bool, String>, address: &str) {
        if let Some(text) = self.fleet.lag().describe(answer, address) {
            self.outbox.warn(text);
        }
    }

    /// Records that the broker has read a packet of `bytes` bytes.
    pub fn was_read(&mut self, bytes: usize) {
        self.limits.was_read(bytes);
    }

    /// Records that this tool's connection ended after a packet of `bytes` bytes that the broker may not have read.
    /// Call [`disconnected`](Self::disconnected) as well.
    pub fn ended_on(&mut self, bytes: usize, now: Instant) {
        self.limits.ended_on(bytes, now);
    }

    /// Returns the time at which to call `tick` next, if no message comes first.
    #[must_use]
    pub fn next_tick(&self) -> Instant {
        let deadline = self.in_flight.next_deadline(&self.config);
        let straggler = self.view().next_straggler();
        [
            deadline,
            straggler,
            self.recheck.at(),
            self.fleet.next_back_off_end(),
        ]
        .into_iter()
        .flatten()
        .fold(self.discovery.next(), Instant::min)
    }

    /// Returns how long the value of [`next_tick`](Self::next_tick) may be reused: computing it scans all servers.
    #[must_use]
    pub fn tick_query_interval(&self) -> Duration {
        let servers = u32::try_from(self.fleet.len()).unwrap_or(u32::MAX);
        TICK_QUERY_INTERVAL * servers
    }

    /// Handles everything that is due by `now`.
    pub fn tick(&mut self, now: Instant) {
        self.late_episodes(now);
        self.late_requests(now);
        self.back_up_stragglers(now);
        self.fleet.end_back_offs(now);
        self.settle_unchecked(now);
        self.limits.tick(now);
        if self.discovery.next() <= now {
            if self.view().wants_servers(self.work_number == 0) {
                self.discover(now);
            } else {
                self.discovery.postpone(now);
            }
        }
        self.dispatch(now);
        let unserved = !self.finished() && self.in_flight.is_empty();
        self.outlook.unserved(unserved, now);
    }

    /// Handles a broken connection: work in flight is lost, and neither servers nor evaluations are to blame.
    pub fn disconnected(&mut self, now: Instant) {
        self.counts.broker_losses += 1;
        // It is also unknown whether servers received the ends of these episodes.
        for (server, hash) in self.in_flight.take_unanswered() {
            self.fleet.left_behind().add(server, Some(hash));
        }
        self.fleet.clear();
        // The servers were silent because of the connection.
        self.outlook.some_work();
        let jobs = self.in_flight.jobs();
        let cause = Cause {
            outcome: Outcome::Disconnected,
            blame: Blame::Broker,
            reason: "the connection to the broker broke",
        };
        self.fail_jobs(jobs, cause, now);
    }
}
