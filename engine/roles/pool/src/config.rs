//! What the scheduler is told at the start.

use std::time::Duration;

use serde_json::{Map, Value};
use swarmwright_protocol::Topics;

use crate::demand::Demand;
use crate::sections::{Faults, Timeouts};

/// What the scheduler is to know at the start.
#[derive(Debug, Clone)]
pub struct Config {
    /// What a server must offer.
    pub demand: Demand,
    /// Sent to the server before each episode, with `seed` replaced by the episode's.
    pub parameters: Map<String, Value>,
    /// Name of the tool, unique on the broker.
    pub tool: String,
    /// Last level of the topic on which servers answer requests: letters and digits, unique like `tool`.
    pub token: String,
    /// Topic names.
    pub topics: Topics,
    /// Whether servers are to show their runs.
    pub visual: bool,
    /// How long to wait.
    pub timeouts: Timeouts,
    /// How failing, slow and wrong servers and evaluations are treated.
    pub faults: Faults,
    /// Most evaluations in one request.
    pub largest: usize,
    /// How long a server that is new waits for its first work; zero where no two can have one id.
    pub probation: Duration,
    /// The first instance number; random, so that no two tools use the same hashes.
    pub first_instance: u64,
}
