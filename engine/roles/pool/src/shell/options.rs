//! How a pool is to work.

use serde_json::{Map, Value};
use swarmwright_mqtt::Settings;

use crate::demand::Demand;
use crate::sections::{Faults, Timeouts};

/// What the work is for, as those who watch are told.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct About {
    /// Name of the run.
    pub run: Option<String>,
    /// The generation under way, from 0.
    pub generation: Option<u64>,
    /// Generations of the whole run.
    pub generations: Option<u64>,
    /// In steady state: how many evaluations had been done before the work, and how many the whole run has.
    pub evaluations: Option<(u64, u64)>,
    /// What it is for where it belongs to no generation, such as `post-evaluation`; in the output of servers.
    pub purpose: Option<String>,
}

/// How a pool is to work.
#[derive(Debug, Clone)]
pub struct Options {
    /// Connection settings of the broker.
    pub settings: Settings,
    /// Topic prefix, empty for none.
    pub prefix: String,
    /// Name of the tool for people to read; host, process and a random number are added.
    pub tool: String,
    /// What a server must offer.
    pub demand: Demand,
    /// Parameters of the simulation.
    pub parameters: Map<String, Value>,
    /// Whether servers are to show their runs, which are stepwise then, whatever the demand says.
    pub visual: bool,
    /// How long to wait.
    pub timeouts: Timeouts,
    /// How failing, slow and wrong servers and evaluations are treated.
    pub faults: Faults,
    /// Most evaluations in one request.
    pub largest: usize,
    /// Whether all servers on the broker are the tool's own, so that no two of them have one id.
    pub alone: bool,
}
