//! MQTT 3.1, 3.1.1 and 5.0 as a server sees it: packets borrowed from the bytes received, packets written to a buffer.
//!
//! Properties of a PUBLISH are checked, then kept as the bytes they were: user properties, response topic and the others
//! pass through the broker unchanged and in order, as MQTT 5.0 (3.3.2.3) demands.

mod connect;
mod decode;
mod encode;
#[cfg(test)]
mod fuzz;
mod properties;
mod reader;
pub mod topic;

pub use connect::{Connect, version_of};
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

/// Reason codes of MQTT 5.0, chapter 2.4, that this broker gives.
pub mod reason {
    /// Success; also a normal disconnection and a granted QoS 0.
    pub const SUCCESS: u8 = 0x00;
    /// No client subscribes to this topic.
    pub const NO_MATCHING_SUBSCRIBERS: u8 = 0x10;
    /// Nothing was subscribed under this filter.
    pub const NO_SUBSCRIPTION: u8 = 0x11;
    /// The bytes are not a valid MQTT packet.
    pub const MALFORMED: u8 = 0x81;
    /// A packet, but not one that is allowed here.
    pub const PROTOCOL_ERROR: u8 = 0x82;
    /// A protocol version other than 3.1, 3.1.1 and 5.0.
    pub const UNSUPPORTED_VERSION: u8 = 0x84;
    /// The client identifier is not allowed.
    pub const BAD_CLIENT_ID: u8 = 0x85;
    /// Wrong user name or password.
    pub const BAD_PASSWORD: u8 = 0x86;
    /// The user may not do this.
    pub const NOT_AUTHORIZED: u8 = 0x87;
    /// The broker is busy; a later attempt may succeed.
    pub const BUSY: u8 = 0x89;
    /// The broker is stopping.
    pub const SHUTTING_DOWN: u8 = 0x8b;
    /// Enhanced authentication is not supported.
    pub const BAD_AUTHENTICATION_METHOD: u8 = 0x8c;
    /// Silence for one and a half keep-alive intervals.
    pub const KEEP_ALIVE_TIMEOUT: u8 = 0x8d;
    /// Another connection came with the same client identifier.
    pub const TAKEN_OVER: u8 = 0x8e;
    /// The topic filter is not valid.
    pub const BAD_FILTER: u8 = 0x8f;
    /// The packet identifier is not known.
    pub const UNKNOWN_PACKET_ID: u8 = 0x92;
    /// More unacknowledged messages than the receive maximum allows.
    pub const RECEIVE_MAXIMUM: u8 = 0x93;
    /// Topic aliases are not supported.
    pub const BAD_TOPIC_ALIAS: u8 = 0x94;
    /// The packet is larger than the broker accepts.
    pub const PACKET_TOO_LARGE: u8 = 0x95;
    /// The reader is too far behind, or a store is full.
    pub const QUOTA_EXCEEDED: u8 = 0x97;
    /// The operator of the broker has ended the connection.
    pub const ADMINISTRATIVE: u8 = 0x98;
    /// Shared subscriptions are not supported.
    pub const NO_SHARED_SUBSCRIPTIONS: u8 = 0x9e;
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
    pub const fn new(reason: u8, what: &'static str) -> Self {
        Self { reason, what }
    }

    /// Bytes that are not a valid MQTT packet.
    pub const fn malformed(what: &'static str) -> Self {
        Self::new(reason::MALFORMED, what)
    }

    /// A packet that is not allowed here.
    pub const fn protocol(what: &'static str) -> Self {
        Self::new(reason::PROTOCOL_ERROR, what)
    }
}
