//! Properties of MQTT 5.0, chapter 2.2.2.

use crate::topic;
use crate::{Refusal, reader::Reader};

/// Value of a property, by data type.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Value<'a> {
    Byte(u8),
    Short(u16),
    Long(u32),
    Variable(u32),
    Text(&'a str),
    Binary(&'a [u8]),
    Pair,
}

pub const PAYLOAD_FORMAT: u8 = 0x01;
pub const MESSAGE_EXPIRY: u8 = 0x02;
pub const CONTENT_TYPE: u8 = 0x03;
pub const RESPONSE_TOPIC: u8 = 0x08;
pub const CORRELATION_DATA: u8 = 0x09;
pub const SUBSCRIPTION_ID: u8 = 0x0b;
pub const SESSION_EXPIRY: u8 = 0x11;
pub const ASSIGNED_CLIENT_ID: u8 = 0x12;
pub const SERVER_KEEP_ALIVE: u8 = 0x13;
pub const AUTHENTICATION_METHOD: u8 = 0x15;
pub const AUTHENTICATION_DATA: u8 = 0x16;
pub const REQUEST_PROBLEM: u8 = 0x17;
pub const WILL_DELAY: u8 = 0x18;
pub const REQUEST_RESPONSE: u8 = 0x19;
pub const RESPONSE_INFORMATION: u8 = 0x1a;
pub const SERVER_REFERENCE: u8 = 0x1c;
pub const REASON_STRING: u8 = 0x1f;
pub const RECEIVE_MAXIMUM: u8 = 0x21;
pub const TOPIC_ALIAS_MAXIMUM: u8 = 0x22;
pub const TOPIC_ALIAS: u8 = 0x23;
pub const MAXIMUM_QOS: u8 = 0x24;
pub const RETAIN_AVAILABLE: u8 = 0x25;
pub const USER_PROPERTY: u8 = 0x26;
pub const MAXIMUM_PACKET_SIZE: u8 = 0x27;
pub const WILDCARD_AVAILABLE: u8 = 0x28;
pub const SUBSCRIPTION_IDS_AVAILABLE: u8 = 0x29;
pub const SHARED_AVAILABLE: u8 = 0x2a;

/// Reads the length and then each property. Properties that are not `allowed` or occur twice are refused, except that
/// user properties may be repeated, and so may subscription identifiers from a broker. Returns the bytes of all
/// properties, without the length.
pub fn each<'a>(
    reader: &mut Reader<'a>,
    allowed: &[u8],
    mut take: impl FnMut(u8, Value<'a>) -> Result<(), Refusal>,
) -> Result<&'a [u8], Refusal> {
    let length = reader.variable()? as usize;
    let all = reader.take(length)?;
    let mut inner = Reader::new(all);
    let mut mask = 0u64;
    while !inner.is_empty() {
        let id = inner.u8()?;
        let value = value(id, &mut inner)?;
        if !allowed.contains(&id) {
            // MQTT 5.0, 2.2.2.2.
            return Err(Refusal::malformed(
                "a property that is not allowed in this packet",
            ));
        }
        check(id, value)?;
        if !matches!(id, USER_PROPERTY | SUBSCRIPTION_ID) {
            let bit = 1 << (id & 63);
            if mask & bit != 0 {
                return Err(Refusal::protocol("a property occurs twice"));
            }
            mask |= bit;
        }
        take(id, value)?;
    }
    Ok(all)
}

/// Reads properties and returns the reason string.
pub fn explanation<'a>(
    reader: &mut Reader<'a>,
    allowed: &[u8],
) -> Result<Option<&'a str>, Refusal> {
    let mut text = None;
    each(reader, allowed, |id, value| {
        if let (REASON_STRING, Value::Text(reason)) = (id, value) {
            text = Some(reason);
        }
        Ok(())
    })?;
    Ok(text)
}

/// Refuses values that a property must not have in any packet.
fn check(id: u8, value: Value<'_>) -> Result<(), Refusal> {
    match (id, value) {
        // All one-byte properties are flags.
        (_, Value::Byte(2..)) => Err(Refusal::protocol("a property is neither 0 nor 1")),
        (RECEIVE_MAXIMUM, Value::Short(0)) | (MAXIMUM_PACKET_SIZE, Value::Long(0)) => Err(
            Refusal::protocol("a maximum packet size or receive maximum of 0"),
        ),
        (_, Value::Variable(0)) => Err(Refusal::protocol("subscription identifier 0")),
        (RESPONSE_TOPIC, Value::Text(topic)) if !topic::is_name(topic) => Err(Refusal::protocol(
            "a response topic that cannot be published to",
        )),
        _ => Ok(()),
    }
}

/// Like `each`, for properties that have been checked.
fn walk(mut all: Reader<'_>, mut take: impl FnMut(u8, Value<'_>, &[u8])) {
    while !all.is_empty() {
        let before = all.rest();
        let Ok(id) = all.u8() else { return };
        let Ok(value) = value(id, &mut all) else {
            return;
        };
        take(id, value, &before[..before.len() - all.rest().len()]);
    }
}

/// Returns the seconds after which a message expires, from properties that have been checked.
pub fn expiry_of(properties: &[u8]) -> Option<u32> {
    let mut expiry = None;
    walk(Reader::new(properties), |id, value, _| {
        if let (MESSAGE_EXPIRY, Value::Long(seconds)) = (id, value) {
            expiry = Some(seconds);
        }
    });
    expiry
}

/// Returns the properties without the message expiry, which is rewritten with the remaining time.
pub fn without_expiry(properties: &[u8]) -> Vec<u8> {
    without(properties, MESSAGE_EXPIRY)
}

/// Returns the properties without one of them.
pub fn without(properties: &[u8], unwanted: u8) -> Vec<u8> {
    let mut rest = Vec::with_capacity(properties.len());
    walk(Reader::new(properties), |id, _, bytes| {
        if id != unwanted {
            rest.extend_from_slice(bytes);
        }
    });
    rest
}

fn value<'a>(id: u8, reader: &mut Reader<'a>) -> Result<Value<'a>, Refusal> {
    Ok(match id {
        PAYLOAD_FORMAT
        | REQUEST_PROBLEM
        | REQUEST_RESPONSE
        | MAXIMUM_QOS
        | RETAIN_AVAILABLE
        | WILDCARD_AVAILABLE
        | SUBSCRIPTION_IDS_AVAILABLE
        | SHARED_AVAILABLE => Value::Byte(reader.u8()?),
        SERVER_KEEP_ALIVE | RECEIVE_MAXIMUM | TOPIC_ALIAS_MAXIMUM | TOPIC_ALIAS => {
            Value::Short(reader.u16()?)
        }
        MESSAGE_EXPIRY | SESSION_EXPIRY | WILL_DELAY | MAXIMUM_PACKET_SIZE => {
            Value::Long(reader.u32()?)
        }
        SUBSCRIPTION_ID => Value::Variable(reader.variable()?),
        CONTENT_TYPE
        | RESPONSE_TOPIC
        | ASSIGNED_CLIENT_ID
        | AUTHENTICATION_METHOD
        | RESPONSE_INFORMATION
        | SERVER_REFERENCE
        | REASON_STRING => Value::Text(reader.string()?),
        CORRELATION_DATA | AUTHENTICATION_DATA => Value::Binary(reader.binary()?),
        USER_PROPERTY => {
            reader.string()?;
            reader.string()?;
            Value::Pair
        }
        _ => return Err(Refusal::malformed("an unknown property")),
    })
}
