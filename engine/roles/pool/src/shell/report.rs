//! Events, reported to listeners as they happen.

use std::collections::BTreeMap;
use std::time::Instant;

use serde::{Serialize, Serializer};
use swarmwright_mqtt::Traffic;
use swarmwright_protocol::{Message, State, Status, Topic};

use crate::counts::Counts;
use crate::journal::Attempt;
use crate::scheduler::Scheduler;
use crate::shell::wall::Wall;

/// An event. It is serialized as an object whose `event` is the name of the variant.
#[derive(Debug, Serialize)]
#[serde(tag = "event", rename_all = "snake_case")]
pub enum Report<'a> {
    /// A server that offers the simulation changed its state.
    Server {
        /// Id of the server.
        server: u64,
        /// `None`, serialized as "left", if it left in an orderly way.
        #[serde(serialize_with = "state_or_left")]
        state: Option<State>,
    },
    /// An attempt at evaluations ended, with or without results.
    Attempt(&'a Attempt),
    /// A server failed and gets no work for some seconds.
    Benched {
        /// Id of the server.
        server: u64,
        /// Failures in a row.
        failures: u32,
        /// Reason for the last failure.
        reason: &'a str,
        /// Seconds of the pause.
        seconds: f64,
    },
    /// A warning for the user.
    Warning {
        /// Text of the warning.
        message: &'a str,
    },
    /// The connection to the broker broke.
    BrokerLost {
        /// Reason for the loss.
        reason: &'a str,
    },
    /// The connection to the broker was restored.
    BrokerBack,
    /// State of the work, once a second and when the work ends.
    Status {
        /// Status as published to other clients of the broker.
        status: &'a Status,
        /// Traffic of the connection.
        #[serde(with = "TrafficFields")]
        traffic: Traffic,
        /// Incidents so far.
        counts: Counts,
    },
}

/// Serialization of [`Traffic`].
#[derive(Serialize)]
#[serde(remote = "Traffic")]
struct TrafficFields {
    sent_bytes: u64,
    received_bytes: u64,
    sent_messages: u64,
    received_messages: u64,
}

#[expect(clippy::ref_option, reason = "serde hands fields over by reference")]
fn state_or_left<S: Serializer>(state: &Option<State>, serializer: S) -> Result<S::Ok, S::Error> {
    match state {
        Some(state) => state.serialize(serializer),
        None => serializer.serialize_str("left"),
    }
}

/// Receiver of reports.
pub type Listener = Box<dyn FnMut(&Report<'_>) + Send + Sync>;

/// Detects events that the scheduler does not report itself.
#[derive(Default)]
pub(crate) struct Reporter {
    listener: Option<Listener>,
    /// Number of lines of the scheduler's journal that have been reported.
    told: usize,
    states: BTreeMap<u64, State>,
    failures: BTreeMap<u64, u32>,
}

impl Reporter {
    pub fn new(listener: Listener) -> Self {
        Self {
            listener: Some(listener),
            ..Self::default()
        }
    }

    pub fn tell(&mut self, report: &Report<'_>) {
        if let Some(listener) = &mut self.listener {
            listener(report);
        }
    }

    /// Handles a message; reports presence.
    pub fn heard(&mut self, scheduler: &Scheduler, topic: &str, payload: &[u8]) {
        if self.listener.is_none()
            || scheduler.config().topics.parse(topic) != Some(Topic::Presence)
        {
            return;
        }
        if payload.is_empty() {
            let server = topic.rsplit('/').next().and_then(|id| id.parse().ok());
            if let Some(server) = server
                && self.states.remove(&server).is_some()
            {
                self.tell(&Report::Server {
                    server,
                    state: None,
                });
            }
            return;
        }
        if let Ok(Message::Presence(presence)) = Message::decode(Topic::Presence, payload)
            && presence
                .simulations
                .contains(&scheduler.config().demand.simulation)
            && self.states.insert(presence.server, presence.state) != Some(presence.state)
        {
            self.tell(&Report::Server {
                server: presence.server,
                state: Some(presence.state),
            });
        }
    }

    /// Reports the attempts that ended since the last call, and the servers benched because of them.
    pub fn look(&mut self, scheduler: &Scheduler, wall: Wall, now: Instant) {
        if self.listener.is_none() || self.told == scheduler.journal().len() {
            return;
        }
        let news = scheduler.journal().after(self.told);
        self.told = scheduler.journal().len();
        for (attempt, started) in news {
            self.tell(&Report::Attempt(&wall.dated(attempt.clone(), *started)));
        }
        if news.iter().all(|(attempt, _)| attempt.error.is_none()) {
            return;
        }
        for (server, slot) in scheduler.fleet().slots() {
            let past = scheduler.fleet().health().failures(server);
            let (failures, reason) = past.unwrap_or_default();
            let before = self.failures.insert(server, failures).unwrap_or(0);
            if failures > before
                && let Some(until) = slot.backs_off_until
            {
                self.tell(&Report::Benched {
                    server,
                    failures,
                    reason,
                    seconds: until.saturating_duration_since(now).as_secs_f64(),
                });
            }
        }
    }

    /// Records that the scheduler's journal was taken.
    pub fn taken(&mut self) {
        self.told = 0;
    }
}
