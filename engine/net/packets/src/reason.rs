//! Reason codes of MQTT 5.0, chapter 2.4: the codes used here, and the names of all failures.

/// Success; also a normal disconnection and a granted QoS 0.
pub const SUCCESS: u8 = 0x00;
/// No client subscribes to this topic.
pub const NO_MATCHING_SUBSCRIBERS: u8 = 0x10;
/// There was no subscription with this filter.
pub const NO_SUBSCRIPTION: u8 = 0x11;
/// No reason is given.
pub const UNSPECIFIED: u8 = 0x80;
/// The bytes are not a valid MQTT packet.
pub const MALFORMED: u8 = 0x81;
/// A valid packet that is not allowed here.
pub const PROTOCOL_ERROR: u8 = 0x82;
/// A protocol version other than 3.1, 3.1.1 and 5.0.
pub const UNSUPPORTED_VERSION: u8 = 0x84;
/// The client identifier is not allowed.
pub const BAD_CLIENT_ID: u8 = 0x85;
/// Wrong user name or password.
pub const BAD_PASSWORD: u8 = 0x86;
/// The user is not permitted to do this.
pub const NOT_AUTHORIZED: u8 = 0x87;
/// The broker is not available.
pub const UNAVAILABLE: u8 = 0x88;
/// The broker is busy; a later attempt may succeed.
pub const BUSY: u8 = 0x89;
/// The broker is stopping.
pub const SHUTTING_DOWN: u8 = 0x8b;
/// Enhanced authentication is not supported.
pub const BAD_AUTHENTICATION_METHOD: u8 = 0x8c;
/// Silence for one and a half keep-alive intervals.
pub const KEEP_ALIVE_TIMEOUT: u8 = 0x8d;
/// Another connection used the same client identifier.
pub const TAKEN_OVER: u8 = 0x8e;
/// The topic filter is not valid.
pub const BAD_FILTER: u8 = 0x8f;
/// The packet identifier is unknown.
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
/// Retained messages are not supported.
pub const NO_RETAIN: u8 = 0x9a;
/// This quality of service is not supported.
pub const QOS_NOT_SUPPORTED: u8 = 0x9b;
/// Shared subscriptions are not supported.
pub const NO_SHARED_SUBSCRIPTIONS: u8 = 0x9e;
/// Too many connections in a short time.
pub const CONNECTION_RATE: u8 = 0x9f;

/// Returns the name of a failure in the standard.
#[must_use]
pub fn name(code: u8) -> Option<&'static str> {
    Some(match code {
        0x80 => "unspecified error",
        0x81 => "malformed packet",
        0x82 => "protocol error",
        0x83 => "implementation specific error",
        0x84 => "unsupported protocol version",
        0x85 => "client identifier not valid",
        0x86 => "bad user name or password",
        0x87 => "not authorized",
        0x88 => "server unavailable",
        0x89 => "server busy",
        0x8a => "banned",
        0x8b => "server shutting down",
        0x8c => "bad authentication method",
        0x8d => "keep alive timeout",
        0x8e => "session taken over",
        0x8f => "topic filter invalid",
        0x90 => "topic name invalid",
        0x91 => "packet identifier in use",
        0x92 => "packet identifier not found",
        0x93 => "receive maximum exceeded",
        0x94 => "topic alias invalid",
        0x95 => "packet too large",
        0x96 => "message rate too high",
        0x97 => "quota exceeded",
        0x98 => "administrative action",
        0x99 => "payload format invalid",
        0x9a => "retain not supported",
        0x9b => "QoS not supported",
        0x9c => "use another server",
        0x9d => "server moved",
        0x9e => "shared subscriptions not supported",
        0x9f => "connection rate exceeded",
        0xa0 => "maximum connect time",
        0xa1 => "subscription identifiers not supported",
        0xa2 => "wildcard subscriptions not supported",
        _ => return None,
    })
}
