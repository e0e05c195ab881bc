//! Decoding of packets: MQTT 5.0 and 3.1.1, chapters 2 and 3.

use crate::connect::{Connect, connect};
use crate::properties::{self as p, Value, each};
use crate::topic;
use crate::{Refusal, Version, reader::Reader, reason};

/// A packet from a client, borrowed from the received bytes.
#[derive(Debug, PartialEq, Eq)]
pub enum Packet<'a> {
    /// CONNECT, the first packet.
    Connect(Connect<'a>),
    /// A message.
    Publish(Publish<'a>),
    /// PUBACK, PUBREC, PUBREL or PUBCOMP, with packet identifier and reason code.
    Acknowledge(Answer, u16, u8),
    /// SUBSCRIBE.
    Subscribe {
        /// Packet identifier.
        id: u16,
        /// Subscription identifier (MQTT 5).
        identifier: Option<u32>,
        /// Topic filters, at least one.
        filters: Vec<Filter<'a>>,
    },
    /// UNSUBSCRIBE.
    Unsubscribe {
        /// Packet identifier.
        id: u16,
        /// Topic filters, at least one.
        filters: Vec<&'a str>,
    },
    /// PINGREQ.
    Ping,
    /// DISCONNECT, the last packet.
    Disconnect {
        /// Reason code; 0 in MQTT 3.
        reason: u8,
        /// Seconds that replace the session expiry in CONNECT.
        session_expiry: Option<u32>,
    },
}

/// The four answers to a PUBLISH; the discriminant is the packet type.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Answer {
    /// PUBACK.
    Acknowledged = 4,
    /// PUBREC.
    Received = 5,
    /// PUBREL.
    Release = 6,
    /// PUBCOMP.
    Complete = 7,
}

/// A message, as received.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Publish<'a> {
    /// Topic as sent; it may be empty or have wildcards if the sender is faulty.
    pub topic: &'a str,
    /// Payload of the message.
    pub payload: &'a [u8],
    /// Properties as received and checked, without their length.
    pub properties: &'a [u8],
    /// Quality of service, 0 to 2.
    pub qos: u8,
    /// Retain flag.
    pub retain: bool,
    /// Packet identifier; 0 for QoS 0.
    pub id: u16,
}

/// One filter of a SUBSCRIBE, with its options.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Filter<'a> {
    /// Filter as sent; in MQTT 5, its wildcards may be invalid.
    pub filter: &'a str,
    /// Highest requested QoS, 0 to 2.
    pub qos: u8,
    /// Whether to exclude messages of the same client (MQTT 5).
    pub no_local: bool,
    /// Whether to keep the retain flag as published (MQTT 5).
    pub retain_as_published: bool,
    /// 0: send retained messages; 1: only if the subscription is new; 2: never.
    pub retain_handling: u8,
}

const OF_PUBLISH: &[u8] = &[
    p::PAYLOAD_FORMAT,
    p::MESSAGE_EXPIRY,
    p::CONTENT_TYPE,
    p::RESPONSE_TOPIC,
    p::CORRELATION_DATA,
    p::TOPIC_ALIAS,
    p::SUBSCRIPTION_ID,
    p::USER_PROPERTY,
];
/// Reason codes of PUBACK and PUBREC, and of PUBREL and PUBCOMP: MQTT 5.0, 3.4.2.1 and 3.6.2.1.
const OF_PUBACK: &[u8] = &[0x00, 0x10, 0x80, 0x83, 0x87, 0x90, 0x91, 0x97, 0x99];
const OF_PUBREL: &[u8] = &[0x00, 0x92];

/// Returns the first byte, the length of the fixed header and the length of the body of the packet at the start of
/// `bytes`; `None` if more bytes are needed.
pub fn frame(bytes: &[u8], maximum: usize) -> Result<Option<(u8, usize, usize)>, Refusal> {
    let Some((&first, rest)) = bytes.split_first() else {
        return Ok(None);
    };
    let mut length = 0usize;
    for (index, byte) in rest.iter().take(4).enumerate() {
        length |= usize::from(byte & 0x7f) << (7 * index);
        if byte & 0x80 == 0 {
            if length + index + 2 > maximum {
                return Err(Refusal::new(
                    reason::PACKET_TOO_LARGE,
                    "a packet larger than the maximum",
                ));
            }
            return Ok(Some((first, index + 2, length)));
        }
    }
    if rest.len() < 4 {
        Ok(None)
    } else {
        Err(Refusal::malformed(
            "the length of a packet has more than four bytes",
        ))
    }
}

/// Decodes one packet; `first` is its first byte, `body` the bytes after the fixed header.
pub fn decode(first: u8, body: &[u8], version: Version) -> Result<Packet<'_>, Refusal> {
    let mut reader = Reader::new(body);
    let reader = &mut reader;
    check_flags(first)?;
    let answer = |kind, reader: &mut Reader<'_>| {
        let (id, code, _) = acknowledge(kind, reader, version)?;
        Ok(Packet::Acknowledge(kind, id, code))
    };
    let packet = match first >> 4 {
        1 => Packet::Connect(connect(reader)?),
        3 => Packet::Publish(publish(first, reader, version, Side::Client)?),
        4 => answer(Answer::Acknowledged, reader)?,
        5 => answer(Answer::Received, reader)?,
        6 => answer(Answer::Release, reader)?,
        7 => answer(Answer::Complete, reader)?,
        8 => subscribe(reader, version)?,
        10 => unsubscribe(reader, version)?,
        12 => Packet::Ping,
        14 => disconnect(reader, version)?,
        15 => return Err(Refusal::protocol("AUTH without an authentication method")),
        _ => return Err(Refusal::protocol("a packet that only a server may send")),
    };
    reader.end()?;
    Ok(packet)
}

/// Checks the flags in the first byte of a packet other than PUBLISH.
pub(crate) fn check_flags(first: u8) -> Result<(), Refusal> {
    let is_right = match first >> 4 {
        3 => true,
        6 | 8 | 10 => first & 0x0f == 2,
        _ => first & 0x0f == 0,
    };
    if is_right {
        Ok(())
    } else {
        Err(Refusal::malformed(
            "wrong flags in the first byte of a packet",
        ))
    }
}

/// Sender of a packet.
#[derive(Clone, Copy, PartialEq, Eq)]
pub(crate) enum Side {
    Client,
    Broker,
}

pub(crate) fn publish<'a>(
    first: u8,
    reader: &mut Reader<'a>,
    version: Version,
    side: Side,
) -> Result<Publish<'a>, Refusal> {
    let qos = first >> 1 & 3;
    if qos == 3 || (qos == 0 && first & 8 != 0) {
        return Err(Refusal::malformed(
            "a PUBLISH with QoS 3, or a duplicate with QoS 0",
        ));
    }
    let topic = reader.string()?;
    let id = if qos == 0 { 0 } else { identifier(reader)? };
    let mut properties: &[u8] = &[];
    if version == Version::Five {
        properties = each(reader, OF_PUBLISH, |id, _| match id {
            p::TOPIC_ALIAS => Err(Refusal::new(
                reason::BAD_TOPIC_ALIAS,
                "topic aliases are not offered",
            )),
            p::SUBSCRIPTION_ID if side == Side::Client => Err(Refusal::protocol(
                "a subscription identifier, which only a server may send with a message",
            )),
            _ => Ok(()),
        })?;
    }
    Ok(Publish {
        topic,
        payload: reader.take(reader.rest().len())?,
        properties,
        qos,
        retain: first & 1 != 0,
        id,
    })
}

/// Reads packet identifier, reason code and reason string of an answer to a PUBLISH.
pub(crate) fn acknowledge<'a>(
    kind: Answer,
    reader: &mut Reader<'a>,
    version: Version,
) -> Result<(u16, u8, Option<&'a str>), Refusal> {
    let id = identifier(reader)?;
    let (mut code, mut text) = (reason::SUCCESS, None);
    if version == Version::Five && !reader.is_empty() {
        code = reader.u8()?;
        let codes = match kind {
            Answer::Acknowledged | Answer::Received => OF_PUBACK,
            Answer::Release | Answer::Complete => OF_PUBREL,
        };
        if !codes.contains(&code) {
            return Err(Refusal::protocol(
                "a reason code that this packet does not have",
            ));
        }
        if !reader.is_empty() {
            text = p::explanation(reader, &[p::REASON_STRING, p::USER_PROPERTY])?;
        }
    }
    Ok((id, code, text))
}

fn subscribe<'a>(reader: &mut Reader<'a>, version: Version) -> Result<Packet<'a>, Refusal> {
    let id = identifier(reader)?;
    let mut subscription = None;
    if version == Version::Five {
        each(
            reader,
            &[p::SUBSCRIPTION_ID, p::USER_PROPERTY],
            |_, value| match value {
                Value::Variable(number) if subscription.replace(number).is_some() => {
                    Err(Refusal::protocol("a property occurs twice"))
                }
                _ => Ok(()),
            },
        )?;
    }
    let mut filters = Vec::new();
    while !reader.is_empty() {
        let filter = filter(reader, version)?;
        let options = reader.u8()?;
        let (qos, retain_handling) = (options & 3, options >> 4 & 3);
        let reserved = if version == Version::Five { 0xc0 } else { 0xfc };
        if qos == 3 || retain_handling == 3 || options & reserved != 0 {
            return Err(Refusal::malformed("unknown subscription options"));
        }
        filters.push(Filter {
            filter,
            qos,
            no_local: options & 4 != 0,
            retain_as_published: options & 8 != 0,
            retain_handling,
        });
    }
    if filters.is_empty() {
        return Err(Refusal::protocol("SUBSCRIBE without a topic filter"));
    }
    Ok(Packet::Subscribe {
        id,
        identifier: subscription,
        filters,
    })
}

fn unsubscribe<'a>(reader: &mut Reader<'a>, version: Version) -> Result<Packet<'a>, Refusal> {
    let id = identifier(reader)?;
    if version == Version::Five {
        each(reader, &[p::USER_PROPERTY], |_, _| Ok(()))?;
    }
    let mut filters = Vec::new();
    while !reader.is_empty() {
        filters.push(filter(reader, version)?);
    }
    if filters.is_empty() {
        return Err(Refusal::protocol("UNSUBSCRIBE without a topic filter"));
    }
    Ok(Packet::Unsubscribe { id, filters })
}

fn disconnect<'a>(reader: &mut Reader<'a>, version: Version) -> Result<Packet<'a>, Refusal> {
    let mut code = reason::SUCCESS;
    let mut session_expiry = None;
    if version == Version::Five && !reader.is_empty() {
        code = reader.u8()?;
        if !reader.is_empty() {
            each(
                reader,
                &[p::SESSION_EXPIRY, p::REASON_STRING, p::USER_PROPERTY],
                |_, value| {
                    if let Value::Long(seconds) = value {
                        session_expiry = Some(seconds);
                    }
                    Ok(())
                },
            )?;
        }
    }
    Ok(Packet::Disconnect {
        reason: code,
        session_expiry,
    })
}

/// Reads a topic filter. MQTT 5 has a reason code for invalid wildcards; MQTT 3 ends the connection (3.1.1, 4.8).
fn filter<'a>(reader: &mut Reader<'a>, version: Version) -> Result<&'a str, Refusal> {
    match reader.string()? {
        "" => Err(Refusal::malformed("an empty topic filter")),
        filter if version == Version::Three && !topic::is_filter(filter) => Err(
            Refusal::malformed("a topic filter whose wildcards are not valid"),
        ),
        filter => Ok(filter),
    }
}

pub(crate) fn identifier(reader: &mut Reader<'_>) -> Result<u16, Refusal> {
    match reader.u16()? {
        0 => Err(Refusal::protocol("packet identifier 0")),
        id => Ok(id),
    }
}
