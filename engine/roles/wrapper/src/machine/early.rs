//! Control messages that come before their parameters.
//!
//! MQTT keeps the order of messages within a topic. Across topics many brokers keep it too, but not all: Artemis and rumqttd
//! deliver some control messages before the parameters that were published ahead of them.

use std::time::{Duration, Instant};

use swarmwright_protocol::Control;

use super::{KEPT, Machine, asker};

/// How long a control message waits for its parameters.
const OVERTAKEN: Duration = Duration::from_secs(1);

/// A control message that waits, and until when.
pub(super) type Early = (Control, Instant);

impl Machine {
    /// Keeps a control message for the parameters that are still to come.
    pub(super) fn keep_early(&mut self, control: Control, now: Instant) {
        self.forget_early(&control.simulation_hash, &control.tool);
        if self.early.len() >= KEPT {
            self.early.pop_front();
        }
        self.early.push_back((control, now + OVERTAKEN));
    }

    /// Forgets what a tool has sent for an episode; what another one has sent for it waits on.
    pub(super) fn forget_early(&mut self, hash: &str, tool: &Option<String>) {
        self.early.retain(|(control, _)| {
            (control.simulation_hash.as_str(), &control.tool) != (hash, tool)
        });
    }

    /// Parameters came: starts the run that waits for them, if there is one.
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

    /// Refuses what has waited for long enough.
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
