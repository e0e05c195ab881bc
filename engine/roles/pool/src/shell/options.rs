//! Options of a pool.

use serde_json::{Map, Value};
use swarmwright_mqtt::Settings;

use crate::demand::Demand;
use crate::sections::{Faults, Timeouts};

/// Purpose of the work, as shown to monitors.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct About {
    /// Name of the run.
    pub run: Option<String>,
    /// Current generation, from 0.
    pub generation: Option<u64>,
    /// Number of generations of the whole run.
    pub generations: Option<u64>,
    /// In steady state: the number of evaluations done before this work, and that of the whole run.
    pub evaluations: Option<(u64, u64)>,
    /// Purpose of work outside of generations, such as `post-evaluation`; shown in the output of servers.
    pub purpose: Option<String>,
}

/// Options of a pool.
#[derive(Debug, Clone)]
pub struct Options {
    /// Connection settings of the broker.
    pub settings: Settings,
    /// Topic prefix, empty for none.
    pub prefix: String,
    /// Name of the tool for users; host, process id and a random number are added.
    pub tool: String,
    /// Requirements for servers.
    pub demand: Demand,
    /// Parameters of the simulation.
    pub parameters: Map<String, Value>,
    /// Whether servers should display their runs; the mode is then stepwise, whatever the demand says.
    pub visual: bool,
    /// Time limits.
    pub timeouts: Timeouts,
    /// Treatment of failing, slow and wrong servers and evaluations.
    pub faults: Faults,
    /// Largest number of evaluations in one request.
    pub largest: usize,
    /// Whether all servers on the broker belong to this tool, so that no two of them share an id.
    pub alone: bool,
}
