//! What the experiment needs of a server, and why one does not fit.

use swarmwright_controllers::Architecture;
use swarmwright_protocol::{Capabilities, ModuleCode, Requirements, missing_module};

use crate::metrics::unannounced;
use crate::mode::{Mode, Way};

/// Sensors and actuators that a controller may have.
const MOST_NUMBERS: usize = 1_000_000;

/// What the experiment needs of a server.
#[derive(Debug, Clone, PartialEq)]
pub struct Demand {
    /// Title of the simulation.
    pub simulation: String,
    /// Dimensions and agents.
    pub requirements: Requirements,
    /// Numbers in a sensor message, if known.
    pub sensors: Option<usize>,
    /// Numbers in an actuator message, if known.
    pub actuators: Option<usize>,
    /// How servers are to evaluate.
    pub mode: Mode,
    /// Kind of the controllers, once it is known.
    pub kind: Option<String>,
    /// The behaviours and conditions in Python of these controllers.
    pub modules: Vec<ModuleCode>,
    /// Names of the metrics that are needed of every episode.
    pub metrics: Vec<String>,
}

impl Demand {
    /// Why a server does not fit; none if it does.
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
                // Where sensors depend on parameters metrics may, too: the server says what is wrong.
                let is_certain = announced.is_none_or(|a| a.sensors.is_some() || !names.is_empty());
                is_certain
                    .then(|| unannounced(&self.metrics, names))
                    .flatten()
            })
            .or_else(|| self.way(capabilities).err())
    }

    /// These controllers are to be evaluated.
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
        // They are computed where their code is: there is no way but one.
        let announced = capabilities.swarmwright.as_ref();
        let modules = announced.map_or(&[][..], |announced| &announced.modules);
        match missing_module(modules, &self.modules) {
            Some(reason) => Err(reason),
            None => Way::of(Mode::Offloaded, self.kind.as_deref(), capabilities),
        }
    }

    /// The demand in words.
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
