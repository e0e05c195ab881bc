//! Configuration of the scheduler.

use std::time::Duration;

use serde_json::{Map, Value};
use swarmwright_protocol::Topics;

use crate::demand::Demand;
use crate::sections::{Faults, Timeouts};

/// Configuration of the scheduler, fixed for its lifetime.
#[derive(Debug, Clone)]
pub struct Config {
    /// Requirements for servers.
    pub demand: Demand,
    /// Parameters sent to the server before each episode; `seed` is replaced by the seed of the episode.
    pub parameters: Map<String, Value>,
    /// Name of the tool, unique on the broker.
    pub tool: String,
    /// Last level of the topic on which servers answer requests: letters and digits, unique on the broker like `tool`.
    pub token: String,
    /// Topic names.
    pub topics: Topics,
    /// Whether servers should display their runs.
    pub visual: bool,
    /// Time limits.
    pub timeouts: Timeouts,
    /// How failing, slow and wrong servers and evaluations are treated.
    pub faults: Faults,
    /// Largest number of evaluations in one request.
    pub largest: usize,
    /// How long a new server waits for its first work; zero where two servers cannot share an id.
    pub probation: Duration,
    /// First instance number; random, so that no two tools generate the same hashes.
    pub first_instance: u64,
}
