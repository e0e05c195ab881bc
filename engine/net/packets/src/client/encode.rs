//! Encoding of client packets, appended to a buffer.

use std::fmt;

use crate::encode::{self, string, variable};
use crate::properties as p;
use crate::{Connect, Filter, Outgoing, Version, Will, topic};

/// PINGREQ.
pub const PINGREQ: [u8; 2] = [0xc0, 0];
/// An orderly DISCONNECT.
pub const DISCONNECT: [u8; 2] = [0xe0, 0];

/// Largest length that a fixed header can express.
const LONGEST: usize = 268_435_455;

const TOO_LONG: &str = "is longer than 65,535 bytes";

/// A packet that cannot be sent; nothing was written.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Invalid {
    /// The invalid part.
    pub what: &'static str,
    /// The problem with it.
    pub why: &'static str,
}

impl Invalid {
    const fn new(part: &'static str, why: &'static str) -> Self {
        Self { what: part, why }
    }
}

impl fmt::Display for Invalid {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(formatter, "{} {}", self.what, self.why)
    }
}

impl std::error::Error for Invalid {}

/// Properties of a message (MQTT 5).
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Properties<'a> {
    /// Seconds after which the broker may discard the message.
    pub expiry: Option<u32>,
    /// Media type of the payload.
    pub content_type: Option<&'a str>,
    /// Topic on which an answer is expected.
    pub response_topic: Option<&'a str>,
    /// Data that identifies the answer.
    pub correlation: Option<&'a [u8]>,
}

impl Properties<'_> {
    /// Encodes the properties without their length. Does not allocate if there are none.
    ///
    /// # Errors
    /// Fails if a property cannot be sent.
    pub fn encoded(&self) -> Result<Vec<u8>, Invalid> {
        let mut out = Vec::new();
        if let Some(seconds) = self.expiry {
            out.push(p::MESSAGE_EXPIRY);
            out.extend(seconds.to_be_bytes());
        }
        if let Some(kind) = self.content_type {
            check_text(kind, "the content type")?;
            out.push(p::CONTENT_TYPE);
            string(&mut out, kind);
        }
        if let Some(topic) = self.response_topic {
            check_topic(topic, "the response topic")?;
            out.push(p::RESPONSE_TOPIC);
            string(&mut out, topic);
        }
        if let Some(data) = self.correlation {
            out.push(p::CORRELATION_DATA);
            binary(&mut out, data, "the correlation data")?;
        }
        Ok(out)
    }
}

/// Appends a CONNECT.
///
/// # Errors
/// Fails if a text cannot be sent.
pub fn connect(out: &mut Vec<u8>, packet: &Connect<'_>) -> Result<(), Invalid> {
    let five = packet.version == Version::Five;
    let mut flags = u8::from(packet.clean) << 1;
    if let Some(will) = &packet.will {
        flags |= 0x04 | will.qos << 3 | u8::from(will.retain) << 5;
    }
    flags |= u8::from(packet.password.is_some()) << 6 | u8::from(packet.user.is_some()) << 7;
    let mut body = Vec::new();
    string(&mut body, "MQTT");
    body.extend([if five { 5 } else { 4 }, flags]);
    body.extend(packet.keep_alive.to_be_bytes());
    if five {
        let mut properties = Vec::new();
        if packet.session_expiry > 0 {
            properties.push(p::SESSION_EXPIRY);
            properties.extend(packet.session_expiry.to_be_bytes());
        }
        if packet.receive_maximum < u16::MAX {
            properties.push(p::RECEIVE_MAXIMUM);
            properties.extend(packet.receive_maximum.to_be_bytes());
        }
        if packet.maximum_packet < u32::MAX {
            properties.push(p::MAXIMUM_PACKET_SIZE);
            properties.extend(packet.maximum_packet.to_be_bytes());
        }
        variable(&mut body, properties.len());
        body.extend(properties);
    }
    check_text(packet.client_id, "the client identifier")?;
    string(&mut body, packet.client_id);
    if let Some(will) = &packet.will {
        last_will(&mut body, will, five)?;
    }
    if let Some(user) = packet.user {
        check_text(user, "the user name")?;
        string(&mut body, user);
    }
    if let Some(password) = packet.password {
        binary(&mut body, password, "the password")?;
    }
    out.push(0x10);
    variable(out, body.len());
    out.extend(body);
    Ok(())
}

fn last_will(body: &mut Vec<u8>, will: &Will<'_>, five: bool) -> Result<(), Invalid> {
    if five {
        let delay = if will.delay > 0 { 5 } else { 0 };
        variable(body, delay + will.properties.len());
        if will.delay > 0 {
            body.push(p::WILL_DELAY);
            body.extend(will.delay.to_be_bytes());
        }
        body.extend_from_slice(&will.properties);
    }
    check_topic(will.topic, "the topic of the last will")?;
    string(body, will.topic);
    binary(body, will.payload, "the message of the last will")
}

/// Appends a SUBSCRIBE; the options of MQTT 5 are omitted in MQTT 3.
///
/// # Errors
/// Fails if there is no filter, or if a filter cannot be sent.
pub fn subscribe(
    out: &mut Vec<u8>,
    id: u16,
    filters: &[Filter<'_>],
    version: Version,
) -> Result<(), Invalid> {
    if filters.is_empty() {
        return Err(Invalid::new("SUBSCRIBE", "has no topic filter"));
    }
    let mut body = id.to_be_bytes().to_vec();
    if version == Version::Five {
        body.push(0);
    }
    for filter in filters {
        check_text(filter.filter, "a topic filter")?;
        if !topic::is_filter(filter.filter) {
            let why = "is empty, or its wildcards are not valid";
            return Err(Invalid::new("a topic filter", why));
        }
        string(&mut body, filter.filter);
        body.push(match version {
            Version::Three => filter.qos,
            Version::Five => {
                filter.qos
                    | u8::from(filter.no_local) << 2
                    | u8::from(filter.retain_as_published) << 3
                    | filter.retain_handling << 4
            }
        });
    }
    if body.len() > LONGEST {
        return Err(Invalid::new("SUBSCRIBE", "has too many topic filters"));
    }
    out.push(0x82);
    variable(out, body.len());
    out.extend(body);
    Ok(())
}

/// Appends a PUBLISH of at most `largest` bytes, with properties encoded by [`Properties::encoded`].
///
/// # Errors
/// Fails if the packet would be larger, or if the topic cannot be published to.
pub fn publish(
    out: &mut Vec<u8>,
    message: &Outgoing<'_>,
    version: Version,
    largest: usize,
) -> Result<(), Invalid> {
    check_topic(message.topic, "the topic")?;
    let length = message.length(version);
    if length > LONGEST || encode::size_with_header(length) > largest {
        return Err(Invalid::new(
            "the message",
            "is larger than the broker accepts",
        ));
    }
    encode::publish(out, message, version);
    Ok(())
}

/// Checks that a text is a valid MQTT string (1.5.4).
fn check_text(text: &str, part: &'static str) -> Result<(), Invalid> {
    if text.len() > usize::from(u16::MAX) {
        return Err(Invalid::new(part, TOO_LONG));
    }
    if text.as_bytes().contains(&0) {
        return Err(Invalid::new(part, "contains the character U+0000"));
    }
    Ok(())
}

/// Checks that a topic can be published to.
fn check_topic(name: &str, part: &'static str) -> Result<(), Invalid> {
    check_text(name, part)?;
    if !topic::is_name(name) {
        return Err(Invalid::new(part, "is empty or has wildcards"));
    }
    Ok(())
}

fn binary(out: &mut Vec<u8>, data: &[u8], part: &'static str) -> Result<(), Invalid> {
    let Ok(length) = u16::try_from(data.len()) else {
        return Err(Invalid::new(part, TOO_LONG));
    };
    out.extend(length.to_be_bytes());
    out.extend_from_slice(data);
    Ok(())
}
