//! Identity of a server: its id, and an instance that distinguishes it from others with the same id.

use swarmwright_controllers::{KINDS, PYTHON_MODULES, TEAM};
use swarmwright_protocol::{AnnouncedSide, Announcement, Capabilities, ModuleCode, NORMAL};
use swarmwright_worlds::{Description, Side};

/// Id of a server, and its process.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Identity {
    /// Id in the protocol.
    pub id: u64,
    /// Random text that is new for each process.
    pub instance: String,
    /// Name of the machine.
    pub host: String,
    /// Process id on that machine.
    pub pid: u64,
    /// Python behaviours and conditions that the server has.
    pub modules: Vec<ModuleCode>,
}

impl Identity {
    /// Creates an identity for this process with the given id.
    #[must_use]
    pub fn new(id: u64) -> Self {
        Self {
            id,
            instance: format!("{:016x}", fastrand::u64(..)),
            host: host(),
            pid: u64::from(std::process::id()),
            modules: Vec::new(),
        }
    }

    /// Returns the capabilities announced for a simulation. `varies`: its description depends on parameters; `sides`: those of
    /// a match; `batch`: largest number of episodes per batch; `lanes`: number of episodes computed in about the time of one; `scenes`:
    /// whether it has scenes.
    #[must_use]
    pub fn capabilities(
        &self,
        simulation: &Description,
        varies: bool,
        sides: &[Side],
        batch: usize,
        lanes: usize,
        scenes: bool,
    ) -> Capabilities {
        let mut controllers = texts(&[KINDS, &[TEAM]].concat());
        if !self.modules.is_empty() {
            controllers.push(PYTHON_MODULES.to_owned());
        }
        Capabilities {
            dimensions: f64::from(simulation.dimensions),
            max_agents: simulation.max_agents.map(f64::from),
            swarmwright: Some(Announcement {
                version: 1,
                modes: texts(&["stepwise", "batched", "offloaded"]),
                controllers,
                modules: self.modules.clone(),
                batch: Some(batch),
                lanes: Some(lanes).filter(|lanes| *lanes > 1),
                distributions: texts(&[NORMAL]),
                // Values that depend on parameters cannot be announced.
                sensors: Some(simulation.sensors).filter(|_| !varies),
                actuators: Some(simulation.actuators).filter(|_| !varies),
                metrics: simulation
                    .metrics
                    .iter()
                    .filter(|_| !varies)
                    .map(|metric| metric.name.to_string())
                    .collect(),
                sides: sides.iter().filter(|_| !varies).map(announced).collect(),
                determinism: simulation.determinism.name().map(str::to_owned),
                tolerance: simulation.determinism.tolerance(),
                scenes,
                control: true,
                instance: Some(self.instance.clone()),
                host: Some(self.host.clone()),
                pid: Some(self.pid),
            }),
        }
    }
}

fn announced(side: &Side) -> AnnouncedSide {
    AnnouncedSide {
        name: side.name.to_string(),
        groups: side.groups.iter().map(ToString::to_string).collect(),
        fitness: side.fitness.as_ref().map(ToString::to_string),
    }
}

fn host() -> String {
    gethostname::gethostname().to_string_lossy().into_owned()
}

/// Returns whether a process is known to be dead: it was on this machine and does not exist. A broker that was killed
/// keeps the presence of servers that ended with it.
pub fn is_dead(other: Option<&str>, pid: Option<u64>) -> bool {
    let process = |pid: u64| std::path::PathBuf::from(format!("/proc/{pid}"));
    other == Some(&*host()) && !pid.is_some_and(|pid| process(pid).exists())
}

fn texts(texts: &[&str]) -> Vec<String> {
    texts.iter().map(ToString::to_string).collect()
}
