//! Control messages that arrive before their parameters.
//!
//! MQTT preserves the order of messages within a topic. Many brokers also preserve it across topics, but not all do:
//! Artemis and rumqttd deliver some control messages before parameters that were published earlier.

use std::time::{Duration, Instant};

use swarmwright_protocol::Control;

use super::{KEPT, Machine, asker};

/// How long a control message waits for its parameters.
const OVERTAKEN: Duration = Duration::from_secs(1);

/// A waiting control message, and the time until which it waits.
pub(super) type Early = (Control, Instant);

impl Machine {
    /// Keeps a control message until its parameters arrive.
    pub(super) fn keep_early(&mut self, control: Control, now: Instant) {
        self.forget_early(&control.simulation_hash, &control.tool);
        if self.early.len() >= KEPT {
            self.early.pop_front();
        }
        self.early.push_back((control, now + OVERTAKEN));
    }

    /// Forgets the control message of a tool for an episode; messages of other tools for it stay.
    pub(super) fn forget_early(&mut self, hash: &str, tool: &Option<String>) {
        self.early.retain(|(control, _)| {
            (control.simulation_hash.as_str(), &control.tool) != (hash, tool)
        });
    }

    /// Starts the run that waits for these parameters, if there is one.
    pub(super) fn start_early(&mut self, hash: &str, now: Instant) {
        let position = self
            .early
            .iter()
            .position(|(control, _)| control.simulation_hash == hash);
        if let Some((control, _)) = position.and_then(|index| self.early.remove(index)) {
            self.control(control, now);
        }
    }

    pub(super) fn next_early(&self) -> Option<Instant> {
        self.early.front().map(|(_, until)| *until)
    }

    /// Refuses the control messages that have waited for too long.
    pub(super) fn refuse_early(&mut self, now: Instant) {
        while self.next_early().is_some_and(|until| until <= now) {
            if let Some((control, _)) = self.early.pop_front() {
                self.complain(format!(
                    "refusing to start a run for {}: no parameters arrived for its hash within {} s of its control message",
                    asker(&control),
                    OVERTAKEN.as_secs()
                ));
            }
        }
    }
}
