//! A server that is used: what it has to do and how fast it is.

use std::time::Instant;

use swarmwright_protocol::{Capabilities, NORMAL, Waiting};

use crate::mode::Way;
use crate::scheduler::fleet::lag::Answers;
use crate::scheduler::fleet::pace::{DECAY, Pace};
use crate::scheduler::job::Job;

/// Work may take this many times as long as expected before its server is a straggler.
pub(crate) const LATENESS_FACTOR: f64 = 4.0;
/// The same, of the longest evaluation of late: where some take much longer than others, or the machine is busy.
const LONGEST_FACTOR: f64 = 2.0;

/// Work of a server that others have finished.
#[derive(Debug, Clone)]
pub(crate) struct Overtaken {
    /// As it was waited for when the first of it was finished.
    pub first: Waiting,
    /// Since when the server has said nothing.
    pub since: Instant,
}

/// A server that answered a discovery and fits.
#[derive(Debug, Clone)]
pub(crate) struct Slot {
    pub way: Way,
    /// What it has to do, the oldest first.
    pub jobs: Vec<Job>,
    /// It failed; not before this time again.
    pub backs_off_until: Option<Instant>,
    /// It may be broken: it has to succeed with what succeeded before it gets new work.
    pub suspended: bool,
    /// When anything was heard of it last.
    pub heard: Instant,
    /// When it last said something of work that it had.
    pub answered_at: Instant,
    /// What others have finished of its work since it was last heard of.
    pub overtaken: Option<Overtaken>,
    pub instance: Option<String>,
    pub capabilities: Capabilities,
    /// Measured speed, episodes a second.
    pub rate: Option<f64>,
    /// Seconds of the longest evaluation of late, as a part of what it was made with.
    pub longest: f64,
    /// It was silent for too long, and gets no work until it sends a message.
    pub silent: bool,
    /// Time from one message of an episode or a batch to the next.
    pub steps: Pace,
    /// Episodes that are stepped one at a time.
    pub episodes: Pace,
    pub answers: Answers,
    /// How often in a row another tool was faster.
    pub preempted: u32,
    /// Since when there is work for it that others should have done before it could.
    pub passed_over: Option<Instant>,
    /// The last round of discovery that it answered.
    pub round: u64,
    /// Last hash that it ran for this tool.
    pub last_hash: Option<String>,
    /// Whether it computed something for this tool, and so is held for it.
    pub held: bool,
}

impl Slot {
    /// Whether it may get work.
    pub fn usable(&self) -> bool {
        self.backs_off_until.is_none() && !self.silent && !self.suspended
    }

    /// Whether it makes samples of normal distributions itself.
    pub fn makes_samples(&self) -> bool {
        let announced = self.capabilities.swarmwright.as_ref();
        announced.is_some_and(|announced| announced.distributions.iter().any(|name| name == NORMAL))
    }

    /// Seconds after which this many evaluations take suspiciously long; `None` while its speed is unknown.
    pub fn doubtful_after(&self, evaluations: usize) -> Option<f64> {
        let usual = LATENESS_FACTOR / self.rate?;
        let each = usual.max(LONGEST_FACTOR * self.longest);
        #[expect(
            clippy::cast_precision_loss,
            reason = "far fewer than 2^53 evaluations"
        )]
        let evaluations = evaluations as f64;
        Some(evaluations * each)
    }

    /// Learns from `episodes` that took `seconds`.
    pub fn measured(&mut self, episodes: usize, seconds: f64) {
        #[expect(clippy::cast_precision_loss, reason = "far fewer than 2^53 episodes")]
        let rate = episodes as f64 / seconds.max(1e-7);
        self.longest = (self.longest * DECAY).max(1.0 / rate);
        if rate.is_finite() {
            self.rate = Some(self.rate.map_or(rate, |before| (before + rate) / 2.0));
        }
    }
}
