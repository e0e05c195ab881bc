//! What is known, to decide by.

use crate::config::Config;
use crate::scheduler::fleet::Fleet;
use crate::scheduler::fleet::processes::Processes;
use crate::scheduler::limits::Limits;
use crate::scheduler::modes::in_flight::InFlight;
use crate::scheduler::queue::ledger::Ledger;

/// The parts of a scheduler, to be read only: decisions that need several of them are made on this.
#[derive(Clone, Copy)]
pub(crate) struct View<'a> {
    pub config: &'a Config,
    pub fleet: &'a Fleet,
    pub processes: &'a Processes,
    pub ledger: &'a Ledger,
    pub in_flight: &'a InFlight,
    pub limits: &'a Limits,
    /// The number of agents, if the parameters tell.
    pub agents: Option<u64>,
    /// The factor by which a busy machine slows down what runs on it, at least 1.
    pub slowdown: f64,
}

impl View<'_> {
    /// Sensors and actuators that a fitting server announces, or that the experiment says.
    pub fn sizes(&self) -> Option<(usize, usize)> {
        let (sensors, actuators) = self.known_sizes();
        Some((sensors?, actuators?))
    }

    /// The same, each for itself.
    pub fn known_sizes(&self) -> (Option<usize>, Option<usize>) {
        let demand = &self.config.demand;
        let (sensors, actuators) = self.fleet.sizes();
        (demand.sensors.or(sensors), demand.actuators.or(actuators))
    }
}
