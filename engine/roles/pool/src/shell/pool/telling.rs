//! What users and those who watch are told.

use std::time::{Duration, Instant};

use swarmwright_mqtt::PublishOptions;
use swarmwright_protocol::{Activity, Status, Topic};

use super::{Pool, REPEATS_INTERVAL};
use crate::journal::Warning;
use crate::shell::report::Report;

/// A connection that ends so soon after a status ended because of it, if it does so again and again: some brokers end
/// that of a client that publishes where the access rules deny it (Mosquitto 2.0.11).
const IMMEDIATELY: Duration = Duration::from_millis(100);
const CONFIRMATIONS: u32 = 2;

/// How often those who watch are told how it stands.
const STATUS_INTERVAL: Duration = Duration::from_secs(1);

impl Pool {
    /// How it stands, and with what.
    pub(super) fn current_status(&self, now: Instant) -> Status {
        let mut status = self.scheduler.status(now);
        status.run = self.about.run.clone();
        (status.generation, status.generations) = (self.about.generation, self.about.generations);
        if let Some((before, total)) = self.about.evaluations {
            (status.done, status.total) = (status.done + before, total);
        }
        status
    }

    /// Tells those who watch how it stands.
    pub(super) fn tell(&mut self, left: bool, now: Instant) {
        self.tell_at = now + STATUS_INTERVAL;
        let mut status = self.current_status(now);
        if left {
            status.state = Activity::Left;
        }
        self.reporter.tell(&Report::Status {
            status: &status,
            traffic: self.connection.traffic(),
            counts: *self.scheduler.counts(),
        });
        if self.ended_at_once < CONFIRMATIONS {
            self.told_at = Some(now);
            self.connection.publish_logged(
                &self.status,
                &status.encode(),
                &PublishOptions::CONFIRMED,
            );
        }
    }

    /// Tells what the user should know.
    pub(super) fn warn(&mut self, text: String) {
        self.reporter.tell(&Report::Warning { message: &text });
        self.warnings.push(Warning::now(text));
    }

    /// Tells of the warnings that were like those before.
    pub(super) fn count_alike(&mut self, now: Instant) {
        self.count_at = now + REPEATS_INTERVAL;
        for text in self.scheduler.take_repeated() {
            self.warn(text);
        }
    }

    /// The broker does not distribute what this tool publishes on a topic.
    pub(super) fn is_denied(&mut self, topic: &str, message: String) {
        if topic == self.topics.name(Topic::Discovery) {
            self.denied = Some(message);
        } else if topic == self.status {
            self.ended_at_once = CONFIRMATIONS;
            self.warn(format!(
                "{message}; until then monitors of servers and tools do not see this tool"
            ));
        } else {
            self.warn(message);
        }
    }

    /// The connection ended: perhaps on the large packet that the broker has not read, or for how this tool stands.
    pub(super) fn suspect(&mut self, unread: usize, now: Instant) {
        let at_once = |published: Instant| now.saturating_duration_since(published) < IMMEDIATELY;
        if unread == 0 {
            self.suspect_status(now);
        } else if !self.told_at.take().is_some_and(at_once) || self.ended_at_once >= CONFIRMATIONS {
            // Otherwise it may be either.
            self.scheduler.ended_on(unread, now);
        }
    }

    /// The connection ended: perhaps since the broker does not let this tool say how it stands.
    fn suspect_status(&mut self, now: Instant) {
        let at_once = |published: Instant| now.saturating_duration_since(published) < IMMEDIATELY;
        if !self.told_at.take().is_some_and(at_once) {
            if self.ended_at_once < CONFIRMATIONS {
                self.ended_at_once = 0;
            }
            return;
        }
        self.ended_at_once += 1;
        if self.ended_at_once == CONFIRMATIONS {
            let text = format!(
                "the broker ends the connection whenever this tool publishes on {}, so it no longer does: monitors of \
                 servers and tools do not see it; correct the broker's access rules",
                self.status
            );
            self.warn(text);
        }
    }
}
