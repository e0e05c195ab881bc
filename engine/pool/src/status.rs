//! How it stands, in words and numbers.

use std::time::{Duration, Instant};

use crate::machine::Machine;

/// After how long silence is worth a word.
const SILENCE: Duration = Duration::from_secs(1);

/// How long other servers may take to answer when one refused the work.
const OTHERS: Duration = Duration::from_millis(500);

impl Machine {
    /// Sensors and actuators that a fitting server announces, or that the experiment says.
    #[must_use]
    pub fn sizes(&self) -> Option<(usize, usize)> {
        match (self.config.demand.sensors, self.config.demand.actuators) {
            (Some(sensors), Some(actuators)) => Some((sensors, actuators)),
            _ => self.offers.sizes(),
        }
    }

    /// Whether a fitting server is there for this tool.
    #[must_use]
    pub fn has_server(&self) -> bool {
        !self.offers.slots.is_empty()
    }

    /// A server that fits and serves somebody else.
    #[must_use]
    pub fn busy_elsewhere(&self) -> Option<String> {
        self.offers.busy_elsewhere(&self.config.demand)
    }

    /// Why the work cannot be done, when all servers that are there say so.
    #[must_use]
    pub fn rejected(&self, now: Instant) -> Option<String> {
        let settled = now.saturating_duration_since(self.refused_at?) >= OTHERS;
        let alone = settled && self.busy_elsewhere().is_none();
        alone.then(|| self.offers.refused()).flatten()
    }

    /// What was required and what was found, in words.
    #[must_use]
    pub fn describe(&self) -> String {
        format!(
            "required: {}; found: {}",
            self.config.demand.describe(),
            self.offers.describe(&self.config.demand)
        )
    }

    /// Titles that the servers offer.
    #[must_use]
    pub fn titles(&self) -> Vec<String> {
        self.offers.titles()
    }

    /// Metrics that servers with this simulation announce, those that do not fit too.
    #[must_use]
    pub fn metrics(&self) -> Vec<String> {
        self.offers.metrics()
    }

    /// How long there has been work and no server for it.
    #[must_use]
    pub fn lonely(&self, now: Instant) -> Duration {
        self.lonely_since
            .map_or(Duration::ZERO, |since| now.saturating_duration_since(since))
    }

    /// What is waited for, in words; empty while everything moves.
    #[must_use]
    pub fn waiting_for(&self, now: Instant) -> String {
        if self.finished() {
            return String::new();
        }
        let run = self.runs.values().min_by_key(|run| (run.heard, run.server));
        let request = self
            .requests
            .iter()
            .min_by_key(|(number, request)| (request.heard, **number))
            .map(|(_, request)| request);
        let is_silent = |heard: Instant| now.saturating_duration_since(heard) >= SILENCE;
        match (run, request) {
            (Some(run), other)
                if is_silent(run.heard) && other.is_none_or(|other| run.heard <= other.heard) =>
            {
                run.waiting_for(now)
            }
            (_, Some(request)) if is_silent(request.heard) => request.waiting_for(now),
            (None, None) => {
                let seconds = self.lonely(now).as_secs_f64();
                if seconds >= SILENCE.as_secs_f64() {
                    let found = self.offers.describe(&self.config.demand);
                    format!("no server for {seconds:.1} s ({found})")
                } else {
                    String::new()
                }
            }
            _ => String::new(),
        }
    }
}
