//! Encoding of packets, appended to a buffer.

use crate::decode::Answer;
use crate::{Version, properties as p, reason};

/// A message to one client.
#[derive(Clone, Copy, Debug)]
pub struct Outgoing<'a> {
    /// Topic name.
    pub topic: &'a str,
    /// Payload of the message.
    pub payload: &'a [u8],
    /// Encoded properties, without the message expiry interval if part of it has passed.
    pub properties: &'a [u8],
    /// Remaining seconds of the expiry, written in addition to `properties`.
    pub expiry: Option<u32>,
    /// Identifiers of the matching subscriptions.
    pub identifiers: &'a [u32],
    /// Quality of service, 0 to 2.
    pub qos: u8,
    /// Retain flag.
    pub retain: bool,
    /// Duplicate flag: whether it may have been sent before.
    pub again: bool,
    /// Packet identifier; 0 for QoS 0.
    pub id: u16,
}

impl Outgoing<'_> {
    /// Returns the length in bytes of all properties, without their length field.
    fn properties_length(&self) -> usize {
        let expiry = self.expiry.map_or(0, |_| 5);
        let identifiers = self.identifiers.iter();
        let identifiers: usize = identifiers
            .map(|&identifier| 1 + size_of_variable(identifier as usize))
            .sum();
        expiry + identifiers + self.properties.len()
    }

    /// Returns the length in bytes of the packet without its fixed header.
    pub(crate) fn length(&self, version: Version) -> usize {
        let id = if self.qos > 0 { 2 } else { 0 };
        let properties = match version {
            Version::Three => 0,
            Version::Five => {
                let properties = self.properties_length();
                size_of_variable(properties) + properties
            }
        };
        2 + self.topic.len() + id + properties + self.payload.len()
    }
}

/// Appends a PUBLISH.
pub fn publish(out: &mut Vec<u8>, message: &Outgoing<'_>, version: Version) {
    let length = message.length(version);
    out.reserve(length + 5);
    out.push(0x30 | u8::from(message.again) << 3 | message.qos << 1 | u8::from(message.retain));
    variable(out, length);
    string(out, message.topic);
    if message.qos > 0 {
        out.extend(message.id.to_be_bytes());
    }
    if version == Version::Five {
        variable(out, message.properties_length());
        if let Some(seconds) = message.expiry {
            out.push(p::MESSAGE_EXPIRY);
            out.extend(seconds.to_be_bytes());
        }
        for &identifier in message.identifiers {
            out.push(p::SUBSCRIPTION_ID);
            variable(out, identifier as usize);
        }
        out.extend_from_slice(message.properties);
    }
    out.extend_from_slice(message.payload);
}

/// Properties of a CONNACK (MQTT 5).
pub struct Welcome<'a> {
    /// Identifier assigned to a client that sent none.
    pub assigned_id: Option<&'a str>,
    /// Session expiry in seconds, if it differs from the client's request.
    pub session_expiry: Option<u32>,
    /// Largest number of unacknowledged QoS 1 and 2 messages that the broker accepts.
    pub receive_maximum: u16,
    /// Size in bytes of the largest packet that the broker accepts.
    pub maximum_packet: u32,
}

/// Encodes the CONNACK for an accepted client.
pub fn connack(version: Version, present: bool, welcome: &Welcome<'_>) -> Vec<u8> {
    if version == Version::Three {
        return vec![0x20, 2, u8::from(present), 0];
    }
    let mut properties = Vec::new();
    if let Some(seconds) = welcome.session_expiry {
        properties.push(p::SESSION_EXPIRY);
        properties.extend(seconds.to_be_bytes());
    }
    properties.push(p::RECEIVE_MAXIMUM);
    properties.extend(welcome.receive_maximum.to_be_bytes());
    properties.push(p::MAXIMUM_PACKET_SIZE);
    properties.extend(welcome.maximum_packet.to_be_bytes());
    properties.extend([p::SHARED_AVAILABLE, 0]);
    if let Some(id) = welcome.assigned_id {
        properties.push(p::ASSIGNED_CLIENT_ID);
        string(&mut properties, id);
    }
    let mut out = vec![0x20];
    variable(
        &mut out,
        2 + size_of_variable(properties.len()) + properties.len(),
    );
    out.extend([u8::from(present), reason::SUCCESS]);
    variable(&mut out, properties.len());
    out.extend(properties);
    out
}

/// Appends the CONNACK for a refused client, with a reason string if the client accepts packets of that size. MQTT 3
/// has codes for some reasons; for others the connection is closed without an answer.
pub fn refuse(
    out: &mut Vec<u8>,
    code: u8,
    explanation: &str,
    version: Version,
    maximum_packet: usize,
) {
    match version {
        Version::Three => {
            let code = match code {
                reason::UNSUPPORTED_VERSION => 1,
                reason::BAD_CLIENT_ID => 2,
                reason::BAD_PASSWORD => 4,
                reason::NOT_AUTHORIZED => 5,
                // MQTT 3.1.1, 3.1.4: a CONNECT that violates the protocol.
                reason::MALFORMED | reason::PROTOCOL_ERROR => return,
                _ => 3,
            };
            out.extend([0x20, 2, 0, code]);
        }
        Version::Five => explained(out, 0x20, &[0, code], explanation, maximum_packet),
    }
}

/// Size in bytes of the largest packet that `explained` appends without a reason string.
pub const BARE: usize = 5;

/// Appends a packet of MQTT 5 with a reason string, which is omitted if the packet would become too large. Appends
/// nothing if the client does not even accept that.
fn explained(out: &mut Vec<u8>, first: u8, head: &[u8], explanation: &str, maximum_packet: usize) {
    let properties = 3 + explanation.len();
    let length = head.len() + size_of_variable(properties) + properties;
    let bare = head.len() + 1;
    if 2 + bare > maximum_packet {
        return;
    }
    out.push(first);
    if explanation.is_empty() || size_with_header(length) > maximum_packet {
        variable(out, bare);
        out.extend_from_slice(head);
        out.push(0);
        return;
    }
    variable(out, length);
    out.extend_from_slice(head);
    variable(out, properties);
    out.push(p::REASON_STRING);
    string(out, explanation);
}

/// Appends PUBACK, PUBREC, PUBREL or PUBCOMP.
pub fn acknowledge(out: &mut Vec<u8>, kind: Answer, id: u16, code: u8, version: Version) {
    let first = (kind as u8) << 4 | if kind == Answer::Release { 2 } else { 0 };
    let [high, low] = id.to_be_bytes();
    if version == Version::Five && code != reason::SUCCESS {
        out.extend([first, 3, high, low, code]);
    } else {
        out.extend([first, 2, high, low]);
    }
}

/// Appends a SUBACK with a code per filter.
pub fn suback(out: &mut Vec<u8>, id: u16, codes: &[u8], version: Version) {
    answer(out, 0x90, id, codes, version);
}

/// Appends an UNSUBACK with, in MQTT 5, a code per filter.
pub fn unsuback(out: &mut Vec<u8>, id: u16, codes: &[u8], version: Version) {
    answer(
        out,
        0xb0,
        id,
        if version == Version::Five { codes } else { &[] },
        version,
    );
}

fn answer(out: &mut Vec<u8>, first: u8, id: u16, codes: &[u8], version: Version) {
    let five = version == Version::Five;
    out.push(first);
    variable(out, 2 + usize::from(five) + codes.len());
    out.extend(id.to_be_bytes());
    if five {
        out.push(0);
        out.extend(codes);
    } else {
        // MQTT 3.1.1 has only one code for a refusal.
        out.extend(codes.iter().map(|&code| code.min(0x80)));
    }
}

/// Appends a PINGRESP.
pub fn pingresp(out: &mut Vec<u8>) {
    out.extend([0xd0, 0]);
}

/// Appends a DISCONNECT, with a reason string if the client accepts packets of that size. Appends nothing in MQTT 3, in
/// which brokers do not send this packet.
pub fn disconnect(
    out: &mut Vec<u8>,
    code: u8,
    explanation: &str,
    version: Version,
    maximum_packet: usize,
) {
    if version == Version::Five {
        explained(out, 0xe0, &[code], explanation, maximum_packet);
    }
}

/// Appends a variable byte integer.
pub(crate) fn variable(out: &mut Vec<u8>, mut value: usize) {
    loop {
        let low = (value & 0x7f) as u8;
        value >>= 7;
        out.push(if value > 0 { low | 0x80 } else { low });
        if value == 0 {
            return;
        }
    }
}

/// Returns the size in bytes of a packet whose body has `length` bytes.
pub(crate) fn size_with_header(length: usize) -> usize {
    1 + size_of_variable(length) + length
}

fn size_of_variable(value: usize) -> usize {
    match value {
        0..0x80 => 1,
        0x80..0x4000 => 2,
        0x4000..0x20_0000 => 3,
        _ => 4,
    }
}

pub(crate) fn string(out: &mut Vec<u8>, text: &str) {
    // No text is longer: it was received with a two-byte length, or has been checked.
    out.extend((text.len() as u16).to_be_bytes());
    out.extend_from_slice(text.as_bytes());
}
