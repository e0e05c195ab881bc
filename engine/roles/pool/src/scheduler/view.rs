//! Read-only view of the scheduler's parts, for decisions.

use crate::config::Config;
use crate::scheduler::fleet::Fleet;
use crate::scheduler::fleet::processes::Processes;
use crate::scheduler::limits::Limits;
use crate::scheduler::modes::in_flight::InFlight;
use crate::scheduler::queue::ledger::Ledger;

/// Read-only view of a scheduler's parts, for decisions that need several of them.
#[derive(Clone, Copy)]
pub(crate) struct View<'a> {
    pub config: &'a Config,
    pub fleet: &'a Fleet,
    pub processes: &'a Processes,
    pub ledger: &'a Ledger,
    pub in_flight: &'a InFlight,
    pub limits: &'a Limits,
    /// Number of agents, if the parameters determine it.
    pub agents: Option<u64>,
    /// Factor by which a busy machine slows down its programs, at least 1.
    pub slowdown: f64,
}

impl View<'_> {
    /// Returns the numbers of sensors and actuators, as given in the experiment or announced by a fitting server.
    pub fn sizes(&self) -> Option<(usize, usize)> {
        let (sensors, actuators) = self.known_sizes();
        Some((sensors?, actuators?))
    }

    /// Returns each of the two numbers if it is known.
    pub fn known_sizes(&self) -> (Option<usize>, Option<usize>) {
        let demand = &self.config.demand;
        let (sensors, actuators) = self.fleet.sizes();
        (demand.sensors.or(sensors), demand.actuators.or(actuators))
    }
}
