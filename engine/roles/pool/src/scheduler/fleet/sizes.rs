//! Numbers of sensors and actuators that servers announce: those of one run have the same.

use swarmwright_protocol::Capabilities;

/// The numbers of a run, and one of the servers that announced them.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Sizes {
    pub sensors: usize,
    pub actuators: usize,
    pub server: u64,
}

/// Sensors and actuators, where a server announces both.
pub(crate) fn announced(capabilities: &Capabilities) -> Option<(usize, usize)> {
    let announced = capabilities.swarmwright.as_ref()?;
    Some((announced.sensors?, announced.actuators?))
}

impl Sizes {
    /// Why a server with these capabilities does not belong to the run; none if it does.
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
