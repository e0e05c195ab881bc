//! A usable server: its jobs and its speed.

use std::time::Instant;

use swarmwright_protocol::{Capabilities, NORMAL, Waiting};

use crate::mode::Way;
use crate::scheduler::fleet::lag::Answers;
use crate::scheduler::fleet::pace::{DECAY, Pace};
use crate::scheduler::job::Job;

/// Factor by which work may exceed its expected duration before its server is a straggler.
pub(crate) const LATENESS_FACTOR: f64 = 4.0;
/// The same factor for the longest recent evaluation, in case some take much longer than others or the machine is busy.
const LONGEST_FACTOR: f64 = 2.0;

/// Unanswered work of a server that others have finished.
#[derive(Debug, Clone)]
pub(crate) struct Overtaken {
    /// The work as it was waited for when the first part of it was finished.
    pub first: Waiting,
    /// Start of the server's silence.
    pub since: Instant,
}

/// A server that answered a discovery and fits.
#[derive(Debug, Clone)]
pub(crate) struct Slot {
    pub way: Way,
    /// Current jobs, the oldest first.
    pub jobs: Vec<Job>,
    /// End of the pause after a failure.
    pub backs_off_until: Option<Instant>,
    /// Whether the server may be broken: it must succeed with an evaluation that succeeded before before it gets new
    /// work.
    pub suspended: bool,
    /// Time of the last message.
    pub heard: Instant,
    /// Time of the last message about its work.
    pub answered_at: Instant,
    /// Work of this server that others have finished since it was last heard.
    pub overtaken: Option<Overtaken>,
    pub instance: Option<String>,
    pub capabilities: Capabilities,
    /// Measured speed in episodes per second.
    pub rate: Option<f64>,
    /// Duration of the longest recent evaluation in seconds, averaged over the block it was part of.
    pub longest: f64,
    /// Whether the server was silent for too long; it gets no work until it sends a message.
    pub silent: bool,
    /// Time between two messages of an episode or a batch.
    pub steps: Pace,
    /// Durations of episodes in stepwise mode.
    pub episodes: Pace,
    pub answers: Answers,
    /// Number of times in a row that another tool got the server first.
    pub preempted: u32,
    /// Since when the server has been passed over because others should finish the work earlier.
    pub passed_over: Option<Instant>,
    /// Last round of discovery that the server answered.
    pub round: u64,
    /// Hash of the last episode that the server ran for this tool.
    pub last_hash: Option<String>,
    /// Whether the server has computed for this tool and so is held for it.
    pub held: bool,
}

impl Slot {
    /// Returns whether the server may get work.
    pub fn usable(&self) -> bool {
        self.backs_off_until.is_none() && !self.silent && !self.suspended
    }

    /// Returns whether the server draws samples of normal distributions itself.
    pub fn makes_samples(&self) -> bool {
        let announced = self.capabilities.swarmwright.as_ref();
        announced.is_some_and(|announced| announced.distributions.iter().any(|name| name == NORMAL))
    }

    /// Returns the seconds after which this many evaluations are suspiciously late; `None` while the speed is unknown.
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

    /// Updates the measured speed with `episodes` that took `seconds`.
    pub fn measured(&mut self, episodes: usize, seconds: f64) {
        #[expect(clippy::cast_precision_loss, reason = "far fewer than 2^53 episodes")]
        let rate = episodes as f64 / seconds.max(1e-7);
        self.longest = (self.longest * DECAY).max(1.0 / rate);
        if rate.is_finite() {
            self.rate = Some(self.rate.map_or(rate, |before| (before + rate) / 2.0));
        }
    }
}
