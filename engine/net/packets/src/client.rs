//! MQTT 3.1.1 and 5.0 from the client's side.
//!
//! Clients of this crate never use QoS 2, topic aliases or enhanced authentication, and never unsubscribe; packets that
//! belong to these features are refused.

mod encode;

pub use encode::{DISCONNECT, Invalid, PINGREQ, Properties, connect, publish, subscribe};

use crate::decode::{Side, acknowledge, check_flags, identifier, publish as read_publish};
use crate::properties::{self as p, Value, each};
use crate::{Answer, Publish, Refusal, Version, reader::Reader, reason};

/// A packet from a broker, borrowed from the received bytes.
#[derive(Debug, PartialEq, Eq)]
pub enum Packet<'a> {
    /// Answer to CONNECT.
    Connack(Connack<'a>),
    /// A message.
    Publish(Publish<'a>),
    /// Answer to a QoS 1 message.
    Puback {
        /// Packet identifier of the message.
        id: u16,
        /// Reason code; 0 in MQTT 3.
        code: u8,
        /// Reason string of the broker.
        text: Option<&'a str>,
    },
    /// Answer to a subscription.
    Suback {
        /// Packet identifier of the SUBSCRIBE.
        id: u16,
        /// For each filter, the granted QoS or the reason code of a refusal.
        codes: &'a [u8],
        /// Reason string of the broker.
        text: Option<&'a str>,
    },
    /// Answer to a ping.
    Pong,
    /// The broker ends the connection (MQTT 5).
    Disconnect {
        /// Reason code.
        code: u8,
        /// Reason string of the broker.
        text: Option<&'a str>,
    },
}

/// Answer to CONNECT, as far as a client needs it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Connack<'a> {
    /// Reason code of MQTT 5; return codes of MQTT 3 are converted.
    pub code: u8,
    /// Reason string of the broker.
    pub text: Option<&'a str>,
    /// Whether the broker has an earlier session of this client.
    pub present: bool,
    /// Keep-alive interval in seconds that replaces the one in CONNECT; 0 for none.
    pub keep_alive: Option<u16>,
    /// Largest number of unacknowledged QoS 1 and 2 messages that the broker accepts.
    pub receive_maximum: u16,
    /// Size in bytes of the largest packet that the broker accepts.
    pub maximum_packet: u32,
    /// Highest QoS that the broker accepts.
    pub maximum_qos: u8,
    /// Whether the broker retains messages for later subscribers.
    pub retains: bool,
}

const OF_CONNACK: &[u8] = &[
    p::SESSION_EXPIRY,
    p::ASSIGNED_CLIENT_ID,
    p::SERVER_KEEP_ALIVE,
    p::AUTHENTICATION_METHOD,
    p::AUTHENTICATION_DATA,
    p::RESPONSE_INFORMATION,
    p::SERVER_REFERENCE,
    p::REASON_STRING,
    p::RECEIVE_MAXIMUM,
    p::TOPIC_ALIAS_MAXIMUM,
    p::MAXIMUM_QOS,
    p::RETAIN_AVAILABLE,
    p::USER_PROPERTY,
    p::MAXIMUM_PACKET_SIZE,
    p::WILDCARD_AVAILABLE,
    p::SUBSCRIPTION_IDS_AVAILABLE,
    p::SHARED_AVAILABLE,
];

/// Decodes one packet; `first` is its first byte, `body` the bytes after the fixed header.
///
/// # Errors
/// Fails if the bytes are not a packet that a broker may send to such a client.
pub fn decode(first: u8, body: &[u8], version: Version) -> Result<Packet<'_>, Refusal> {
    let mut reader = Reader::new(body);
    let reader = &mut reader;
    check_flags(first)?;
    let packet = match first >> 4 {
        2 => Packet::Connack(connack(reader, version)?),
        3 => {
            let message = read_publish(first, reader, version, Side::Broker)?;
            if message.qos > 1 {
                return Err(Refusal::protocol(
                    "a message at QoS 2, which was not requested",
                ));
            }
            Packet::Publish(message)
        }
        4 => {
            let (id, code, text) = acknowledge(Answer::Acknowledged, reader, version)?;
            Packet::Puback { id, code, text }
        }
        9 => suback(reader, version)?,
        13 => Packet::Pong,
        14 if version == Version::Five => disconnect(reader)?,
        5..=7 => {
            return Err(Refusal::protocol(
                "an answer to a message at QoS 2 that was never sent",
            ));
        }
        11 => return Err(Refusal::protocol("UNSUBACK without an UNSUBSCRIBE")),
        14 => {
            return Err(Refusal::protocol(
                "DISCONNECT, which brokers of MQTT 3 do not send",
            ));
        }
        15 if version == Version::Five => {
            return Err(Refusal::protocol("AUTH without an authentication method"));
        }
        _ => {
            return Err(Refusal::protocol(
                "a packet that brokers do not send to clients",
            ));
        }
    };
    reader.end()?;
    Ok(packet)
}

/// Returns the unchecked topic and the payload of a QoS 0 message without properties, which nearly all messages are.
/// [`decode`] handles them too, but takes twice the time.
#[inline]
#[must_use]
pub fn bare(first: u8, body: &[u8], version: Version) -> Option<(&[u8], &[u8])> {
    let (length, rest) = body.split_first_chunk()?;
    let (topic, rest) = rest.split_at_checked(usize::from(u16::from_be_bytes(*length)))?;
    let payload = match version {
        Version::Three => rest,
        Version::Five => rest.strip_prefix(&[0])?,
    };
    (first & 0xfe == 0x30).then_some((topic, payload))
}

fn connack<'a>(reader: &mut Reader<'a>, version: Version) -> Result<Connack<'a>, Refusal> {
    let flags = reader.u8()?;
    if flags > 1 {
        return Err(Refusal::malformed("unknown flags in CONNACK"));
    }
    let code = reader.u8()?;
    let mut connack = Connack {
        code,
        text: None,
        present: flags == 1,
        keep_alive: None,
        receive_maximum: u16::MAX,
        maximum_packet: u32::MAX,
        maximum_qos: 2,
        retains: true,
    };
    // Brokers that support only MQTT 3 answer a CONNECT of MQTT 5 in the old format.
    if version == Version::Three || (code == 1 && reader.is_empty()) {
        connack.code = match code {
            0 => reason::SUCCESS,
            1 => reason::UNSUPPORTED_VERSION,
            2 => reason::BAD_CLIENT_ID,
            3 => reason::UNAVAILABLE,
            4 => reason::BAD_PASSWORD,
            5 => reason::NOT_AUTHORIZED,
            _ => {
                return Err(Refusal::malformed("an unknown return code in CONNACK"));
            }
        };
        return Ok(connack);
    }
    if matches!(code, 1..0x80) {
        return Err(Refusal::malformed("an unknown reason code in CONNACK"));
    }
    each(reader, OF_CONNACK, |id, value| {
        match (id, value) {
            (p::REASON_STRING, Value::Text(text)) => connack.text = Some(text),
            (p::SERVER_KEEP_ALIVE, Value::Short(seconds)) => connack.keep_alive = Some(seconds),
            (p::RECEIVE_MAXIMUM, Value::Short(count)) => connack.receive_maximum = count,
            (p::MAXIMUM_PACKET_SIZE, Value::Long(bytes)) => connack.maximum_packet = bytes,
            (p::MAXIMUM_QOS, Value::Byte(qos)) => connack.maximum_qos = qos,
            (p::RETAIN_AVAILABLE, Value::Byte(flag)) => connack.retains = flag == 1,
            _ => {}
        }
        Ok(())
    })?;
    Ok(connack)
}

fn suback<'a>(reader: &mut Reader<'a>, version: Version) -> Result<Packet<'a>, Refusal> {
    let id = identifier(reader)?;
    let mut text = None;
    if version == Version::Five {
        text = p::explanation(reader, &[p::REASON_STRING, p::USER_PROPERTY])?;
    }
    let codes = reader.take(reader.rest().len())?;
    if codes.iter().any(|code| matches!(code, 3..0x80)) {
        return Err(Refusal::malformed("an unknown code in SUBACK"));
    }
    Ok(Packet::Suback { id, codes, text })
}

fn disconnect<'a>(reader: &mut Reader<'a>) -> Result<Packet<'a>, Refusal> {
    let (mut code, mut text) = (reason::SUCCESS, None);
    if !reader.is_empty() {
        code = reader.u8()?;
    }
    if !reader.is_empty() {
        text = p::explanation(
            reader,
            &[
                p::SESSION_EXPIRY,
                p::SERVER_REFERENCE,
                p::REASON_STRING,
                p::USER_PROPERTY,
            ],
        )?;
    }
    Ok(Packet::Disconnect { code, text })
}
