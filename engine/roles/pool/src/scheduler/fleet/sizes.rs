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
        let found = capabilities.swarmwright.as_ref()?;
        [
            ("sensors", found.sensors, self.sensors),
            ("actuators", found.actuators, self.actuators),
        ]
        .into_iter()
        .find_map(|(what, found, wanted)| {
            let found = found.filter(|found| *found != wanted)?;
            Some(format!(
                "announces {found} {what}, but this run has {wanted}, which server {} announces; if {found} is right, add \
                 `{what}: {found}` to the experiment, else start the server with the simulation of the others",
                self.server
            ))
        })
    }
}
