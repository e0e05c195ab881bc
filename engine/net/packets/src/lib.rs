//! Packets of MQTT 3.1, 3.1.1 and 5.0: decoded by borrowing from the received bytes, encoded by appending to a buffer.
//!
//! The crate root has the parts that both sides need, and the broker's side: [`decode`] decodes packets from clients.
//! The client's side is in [`client`]. Neither side keeps state or does I/O.
//!
//! Properties of a PUBLISH are checked, then kept as raw bytes: user properties, response topic and the others pass
//! through the broker unchanged and in order, as MQTT 5.0 (3.3.2.3) requires.

#[cfg(test)]
#[global_allocator]
static MEMORY: swarmwright_fuzzing::Counting = swarmwright_fuzzing::Counting;

pub mod client;
mod connect;
mod decode;
mod encode;
mod properties;
mod reader;
pub mod reason;
pub mod topic;

pub use connect::{Connect, Will, version_of};
pub use decode::{Answer, Filter, Packet, Publish, decode, frame};
pub use encode::{
    BARE, Outgoing, Welcome, acknowledge, connack, disconnect, pingresp, publish, refuse, suback,
    unsuback,
};
pub use properties::{expiry_of, without_expiry};

/// Protocol version of a connection.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Version {
    /// MQTT 3.1 and 3.1.1: no properties, short reason codes.
    Three,
    /// MQTT 5.0.
    Five,
}

/// Reason to end a connection: a reason code and, for the log, the violated rule.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Refusal {
    /// MQTT 5.0 reason code.
    pub reason: u8,
    /// Description of the reason.
    pub what: &'static str,
}

impl Refusal {
    /// Creates a refusal from a reason code and a description.
    pub const fn new(reason: u8, explanation: &'static str) -> Self {
        Self {
            reason,
            what: explanation,
        }
    }

    /// Creates the refusal of bytes that are not a valid MQTT packet.
    pub const fn malformed(explanation: &'static str) -> Self {
        Self::new(reason::MALFORMED, explanation)
    }

    /// Creates the refusal of a packet that is not allowed here.
    pub const fn protocol(explanation: &'static str) -> Self {
        Self::new(reason::PROTOCOL_ERROR, explanation)
    }
}

#[cfg(test)]
mod tests;
