//! Requirements of an experiment for its servers, and the reasons why a server does not meet them.

use swarmwright_controllers::Architecture;
use swarmwright_protocol::{Capabilities, ModuleCode, Requirements, missing_module};

use crate::metrics::unannounced;
use crate::mode::{Mode, Way};

/// Largest number of sensors or actuators of a controller.
const MOST_NUMBERS: usize = 1_000_000;

/// Requirements of an experiment for its servers.
#[derive(Debug, Clone, PartialEq)]
pub struct Demand {
    /// Title of the simulation.
    pub simulation: String,
    /// Required dimensions and number of agents.
    pub requirements: Requirements,
    /// Length of a sensor message, if known.
    pub sensors: Option<usize>,
    /// Length of an actuator message, if known.
    pub actuators: Option<usize>,
    /// Mode in which servers evaluate.
    pub mode: Mode,
    /// Kind of the controllers, once known.
    pub kind: Option<String>,
    /// Python behaviours and conditions that these controllers use.
    pub modules: Vec<ModuleCode>,
    /// Names of the metrics that every episode must return.
    pub metrics: Vec<String>,
}

impl Demand {
    /// Returns why a server does not fit; `None` if it fits.
    #[must_use]
    pub fn misfit(&self, simulations: &[String], capabilities: &Capabilities) -> Option<String> {
        if !simulations.contains(&self.simulation) {
            return Some(format!(
                "offers {}, not {}",
                simulations.join(", "),
                self.simulation
            ));
        }
        if !capabilities.fulfil(&self.requirements) {
            let agents = capabilities.max_agents.map_or_else(String::new, |agents| {
                format!(" and at most {agents} agents")
            });
            return Some(format!(
                "has {} dimensions{agents}",
                capabilities.dimensions
            ));
        }
        let announced = capabilities.swarmwright.as_ref();
        for (noun, count) in [
            ("sensors", announced.and_then(|a| a.sensors)),
            ("actuators", announced.and_then(|a| a.actuators)),
        ] {
            if let Some(count) = count.filter(|count| !(1..=MOST_NUMBERS).contains(count)) {
                return Some(format!(
                    "announces {count} {noun}, expected 1 to {MOST_NUMBERS}"
                ));
            }
        }
        let differs =
            |noun: &str, expected: Option<usize>, actual: Option<usize>| match (expected, actual) {
                (Some(expected), Some(actual)) if expected != actual => Some(format!(
                    "announces {actual} {noun}, but the experiment says {expected}"
                )),
                _ => None,
            };
        differs("sensors", self.sensors, announced.and_then(|a| a.sensors))
            .or_else(|| {
                differs(
                    "actuators",
                    self.actuators,
                    announced.and_then(|a| a.actuators),
                )
            })
            .or_else(|| {
                let names = announced.map_or(&[][..], |announced| &announced.metrics);
                // If the sensors depend on parameters, the metrics may too; the server then reports missing ones
                // itself.
                let is_certain = announced.is_none_or(|a| a.sensors.is_some() || !names.is_empty());
                is_certain
                    .then(|| unannounced(&self.metrics, names))
                    .flatten()
            })
            .or_else(|| self.way(capabilities).err())
    }

    /// Sets the controllers to evaluate.
    pub fn set_controllers(&mut self, kind: Option<&str>, architecture: &Architecture) {
        self.kind = kind.map(str::to_owned);
        let needed = architecture.in_python().into_iter();
        self.modules = needed
            .flat_map(|machine| machine.needed())
            .map(|module| ModuleCode {
                role: module.role.to_owned(),
                name: module.name.to_owned(),
                file: module.file.map(str::to_owned),
                sha256: module.sha256.map(str::to_owned),
            })
            .collect();
    }

    pub(crate) fn way(&self, capabilities: &Capabilities) -> Result<Way, String> {
        if self.modules.is_empty() {
            return Way::of(self.mode, self.kind.as_deref(), capabilities);
        }
        // Python modules run only where their code is, so the mode must be offloaded.
        let announced = capabilities.swarmwright.as_ref();
        let modules = announced.map_or(&[][..], |announced| &announced.modules);
        match missing_module(modules, &self.modules) {
            Some(reason) => Err(reason),
            None => Way::of(Mode::Offloaded, self.kind.as_deref(), capabilities),
        }
    }

    /// Describes the demand for users.
    #[must_use]
    pub fn describe(&self) -> String {
        let agents = self
            .requirements
            .max_agents
            .map_or_else(String::new, |agents| format!(", at least {agents} agents"));
        let counts = match (self.sensors, self.actuators) {
            (Some(sensors), Some(actuators)) => {
                format!(", {sensors} sensors, {actuators} actuators")
            }
            _ => String::new(),
        };
        let mode = match self.mode {
            Mode::Auto | Mode::Stepwise => String::new(),
            mode => format!(", mode {mode}"),
        };
        let metrics = match self.metrics.len() {
            0 => String::new(),
            _ => format!(", metrics {}", self.metrics.join(", ")),
        };
        format!(
            "simulation {}, {} dimensions{agents}{counts}{metrics}{mode}",
            self.simulation, self.requirements.dimensions
        )
    }
}
