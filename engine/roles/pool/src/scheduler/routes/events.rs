//! What comes in: messages, time, the state of the connection.

use std::time::{Duration, Instant};

use swarmwright_protocol::{
    Announcement, Capabilities, EXTENSION_VERSION, Message, SensorReading, ToTool, Topic,
};

use crate::journal::Outcome;
use crate::scheduler::Scheduler;
use crate::scheduler::queue::blame::{Blame, Cause};

/// How long it is not asked again for the next tick, for each server.
const TICK_QUERY_INTERVAL: Duration = Duration::from_micros(5);

impl Scheduler {
    /// A message came in. Retained messages are leftovers of earlier runs, except presence.
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

    /// Tells once what a server with this simulation announces that cannot be read: it counts as not announced.
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

    /// The answer to [`Action::AskBroker`]: whether the broker at `address` holds small packets back, or why that could
    /// not be found out.
    pub fn broker_holds_back(&mut self, answer: Result<bool, String>, address: &str) {
        if let Some(text) = self.fleet.lag().describe(answer, address) {
            self.outbox.warn(text);
        }
    }

    /// Notes that the broker has read a packet of `bytes` bytes.
    pub fn was_read(&mut self, bytes: usize) {
        self.limits.was_read(bytes);
    }

    /// This tool's connection ended, with a packet of so many bytes sent of which it is not known whether the broker read
    /// it; see [`disconnected`](Self::disconnected) for the rest.
    pub fn ended_on(&mut self, bytes: usize, now: Instant) {
        self.limits.ended_on(bytes, now);
    }

    /// The next time at which `tick` is needed, if no message comes first.
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

    /// How long [`next_tick`](Self::next_tick) need not be asked again: it looks at all servers, and a tick may be as late.
    #[must_use]
    pub fn tick_query_interval(&self) -> Duration {
        let servers = u32::try_from(self.fleet.len()).unwrap_or(u32::MAX);
        TICK_QUERY_INTERVAL * servers
    }

    /// Time has passed.
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

    /// The connection broke: the work under way on it is lost, and it is no fault of servers or evaluations.
    pub fn disconnected(&mut self, now: Instant) {
        self.counts.broker_losses += 1;
        // Whether servers have heard that these were over is not known, either.
        for (server, hash) in self.in_flight.take_unanswered() {
            self.fleet.left_behind().add(server, Some(hash));
        }
        self.fleet.clear();
        // What kept servers silent was the connection.
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
