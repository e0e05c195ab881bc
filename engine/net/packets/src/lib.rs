//! The packets of MQTT 3.1, 3.1.1 and 5.0: borrowed from the bytes received, appended to a buffer.
//!
//! Here is what both sides need, and MQTT as a broker sees it: [`decode`] reads what clients send. MQTT as a client sees it is
//! in [`client`]. Neither side keeps any state or does I/O.
//!
//! Properties of a PUBLISH are checked, then kept as the bytes they were: user properties, response topic and the others
//! pass through the broker unchanged and in order, as MQTT 5.0 (3.3.2.3) demands.

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

/// Which rules a connection follows.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Version {
    /// MQTT 3.1 and 3.1.1: no properties, short reason codes.
    Three,
    /// MQTT 5.0.
    Five,
}

/// Why a connection has to end: a reason code and, for the log, the rule that was broken.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Refusal {
    /// MQTT 5.0 reason code.
    pub reason: u8,
    /// The same in words.
    pub what: &'static str,
}

impl Refusal {
    /// A refusal with its reason code and words.
    pub const fn new(reason: u8, explanation: &'static str) -> Self {
        Self {
            reason,
            what: explanation,
        }
    }

    /// Bytes that are not a valid MQTT packet.
    pub const fn malformed(explanation: &'static str) -> Self {
        Self::new(reason::MALFORMED, explanation)
    }

    /// A packet that is not allowed here.
    pub const fn protocol(explanation: &'static str) -> Self {
        Self::new(reason::PROTOCOL_ERROR, explanation)
    }
}

#[cfg(test)]
mod tests;
