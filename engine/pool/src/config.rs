//! What the scheduler is told at the start.

use std::time::Duration;

use serde_json::{Map, Value};
use swarmwright_protocol::Topics;

use crate::demand::Demand;

/// What the scheduler is to know at the start.
#[derive(Debug, Clone)]
pub struct Config {
    /// What a server must offer.
    pub demand: Demand,
    /// Sent to the server before each episode, with `seed` replaced by the episode's.
    pub parameters: Map<String, Value>,
    /// Who asks, unique among the tools on the broker.
    pub tool: String,
    /// Last level of the topic on which servers answer requests: letters and digits, unique like `tool`.
    pub token: String,
    /// Topic names.
    pub topics: Topics,
    /// Whether servers are to show their runs.
    pub visual: bool,
    /// How long a server may be silent in an episode.
    pub step_timeout: Duration,
    /// What is done about servers and evaluations that fail, are slow, or wrong.
    pub faults: Faults,
    /// Most evaluations in one request.
    pub largest: usize,
    /// How long a server that is new waits for its first work; zero where no two can have one id.
    pub probation: Duration,
    /// The first instance number; random, so that no two tools use the same hashes.
    pub first_instance: u64,
}

/// What is done about servers and evaluations that fail, are slow, or wrong.
#[derive(Debug, Clone, PartialEq)]
pub struct Faults {
    /// How often an evaluation is tried, at most; tries together with other evaluations do not count.
    pub attempts: u32,
    /// After how many servers that went down with nothing but one evaluation no other server gets it.
    pub quarantine: u32,
    /// Whether an idle server gets a copy of what a slow or silent one has.
    pub backup: bool,
    /// The share of evaluations that are repeated on another server, 0 to 1.
    pub audit: f64,
    /// A server is a straggler when it is silent for much longer than ever before, and for this time at least.
    pub least: Duration,
    /// How long an episode may take, stepwise.
    pub episode: Duration,
}

impl Default for Faults {
    fn default() -> Self {
        Self {
            attempts: 3,
            quarantine: 3,
            backup: true,
            audit: 0.0,
            least: Duration::from_secs(1),
            episode: Duration::from_secs(86_400),
        }
    }
}
