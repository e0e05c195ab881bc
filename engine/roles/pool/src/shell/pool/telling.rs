//! Reports to users and monitors.

use std::time::{Duration, Instant};

use swarmwright_mqtt::PublishOptions;
use swarmwright_protocol::{Activity, Status, Topic};

use super::{Pool, REPEATS_INTERVAL};
use crate::journal::Warning;
use crate::shell::report::Report;

/// A connection that repeatedly ends within this time of a status ends because of the status: some brokers disconnect a
/// client that publishes where the access rules deny it (Mosquitto 2.0.11).
const IMMEDIATELY: Duration = Duration::from_millis(100);
const CONFIRMATIONS: u32 = 2;

/// Interval between two statuses for monitors.
const STATUS_INTERVAL: Duration = Duration::from_secs(1);

impl Pool {
    /// Returns the current status, including the purpose of the work.
    pub(super) fn current_status(&self, now: Instant) -> Status {
        let mut status = self.scheduler.status(now);
        status.run = self.about.run.clone();
        (status.generation, status.generations) = (self.about.generation, self.about.generations);
        if let Some((before, total)) = self.about.evaluations {
            (status.done, status.total) = (status.done + before, total);
        }
        status
    }

    /// Publishes the status for monitors.
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

    /// Issues a warning.
    pub(super) fn warn(&mut self, text: String) {
        self.reporter.tell(&Report::Warning { message: &text });
        self.warnings.push(Warning::now(text));
    }

    /// Reports the repeated warnings.
    pub(super) fn count_alike(&mut self, now: Instant) {
        self.count_at = now + REPEATS_INTERVAL;
        for text in self.scheduler.take_repeated() {
            self.warn(text);
        }
    }

    /// Handles a topic on which the broker denies publishing.
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

    /// Finds the cause of a lost connection: a large packet that the broker has not read, or the status.
    pub(super) fn suspect(&mut self, unread: usize, now: Instant) {
        let at_once = |published: Instant| now.saturating_duration_since(published) < IMMEDIATELY;
        if unread == 0 {
            self.suspect_status(now);
        } else if !self.told_at.take().is_some_and(at_once) || self.ended_at_once >= CONFIRMATIONS {
            // Otherwise, either may be the cause.
            self.scheduler.ended_on(unread, now);
        }
    }

    /// Checks whether a lost connection is due to a denied status.
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
