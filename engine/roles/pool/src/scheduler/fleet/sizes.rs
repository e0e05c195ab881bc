//! Numbers of sensors and actuators that servers announce; they are the same for all servers of a run.

use swarmwright_protocol::Capabilities;

/// Numbers of sensors and actuators of a run, and one of the servers that announced them.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Sizes {
    pub sensors: usize,
    pub actuators: usize,
    pub server: u64,
}

/// Returns the numbers of sensors and actuators, if the server announces both.
pub(crate) fn announced(capabilities: &Capabilities) -> Option<(usize, usize)> {
    let announced = capabilities.swarmwright.as_ref()?;
    Some((announced.sensors?, announced.actuators?))
}

impl Sizes {
    /// Returns why a server with these capabilities does not belong to the run; `None` if it does.
    pub fn misfit(&self, capabilities: &Capabilities) -> Option<String> {
        let announced = capabilities.swarmwright.as_ref()?;
        [
            ("sensors", announced.sensors, self.sensors),
            ("actuators", announced.actuators, self.actuators),
        ]
        .into_iter()
        .find_map(|(noun, count, expected)| {
            let count = count.filter(|count| *count != expected)?;
            Some(format!(
                "announces {count} {noun}, but this run has {expected}, as announced by server {}; if {count} is right, add \
                 `{noun}: {count}` to the experiment, otherwise start the server with the simulation of the others",
                self.server
            ))
        })
    }
}
