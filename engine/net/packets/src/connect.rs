//! CONNECT: MQTT 5.0 and 3.1.1, chapter 3.1.

use crate::properties::{self as p, Value, each};
use crate::{Refusal, Version, reader::Reader, reason};

/// Contents of a CONNECT.
#[derive(Debug, PartialEq, Eq)]
pub struct Connect<'a> {
    /// Protocol version of the connection.
    pub version: Version,
    /// Client identifier; empty if the broker should choose one.
    pub client_id: &'a str,
    /// Whether to discard an earlier session with this identifier (clean start).
    pub clean: bool,
    /// Keep-alive interval in seconds; 0 for none.
    pub keep_alive: u16,
    /// Seconds that the session outlives the connection; `u32::MAX` for ever.
    pub session_expiry: u32,
    /// Largest number of unacknowledged QoS 1 and 2 messages that the client accepts.
    pub receive_maximum: u16,
    /// Size in bytes of the largest packet that the client accepts.
    pub maximum_packet: u32,
    /// Message that is published when the client is lost.
    pub will: Option<Will<'a>>,
    /// User name.
    pub user: Option<&'a str>,
    /// Password, of arbitrary bytes.
    pub password: Option<&'a [u8]>,
}

/// A message that is published when the client is lost.
#[derive(Debug, PartialEq, Eq)]
pub struct Will<'a> {
    /// Topic as sent, which may be invalid for publishing.
    pub topic: &'a str,
    /// Payload of the message.
    pub payload: &'a [u8],
    /// Properties of the later PUBLISH, without the will delay.
    pub properties: Vec<u8>,
    /// Quality of service, 0 to 2.
    pub qos: u8,
    /// Whether the broker should retain the message.
    pub retain: bool,
    /// Seconds between the loss and the publication.
    pub delay: u32,
}

const OF_CONNECT: &[u8] = &[
    p::SESSION_EXPIRY,
    p::AUTHENTICATION_METHOD,
    p::AUTHENTICATION_DATA,
    p::REQUEST_PROBLEM,
    p::REQUEST_RESPONSE,
    p::RECEIVE_MAXIMUM,
    p::TOPIC_ALIAS_MAXIMUM,
    p::USER_PROPERTY,
    p::MAXIMUM_PACKET_SIZE,
];
const OF_WILL: &[u8] = &[
    p::WILL_DELAY,
    p::PAYLOAD_FORMAT,
    p::MESSAGE_EXPIRY,
    p::CONTENT_TYPE,
    p::RESPONSE_TOPIC,
    p::CORRELATION_DATA,
    p::USER_PROPERTY,
];

/// Returns the version in a CONNECT, if readable, so that a client is refused in its own version.
pub fn version_of(body: &[u8]) -> Option<Version> {
    let mut reader = Reader::new(body);
    match (reader.string().ok()?, reader.u8().ok()?) {
        ("MQTT", 5) => Some(Version::Five),
        ("MQTT", 4) | ("MQIsdp", 3) => Some(Version::Three),
        _ => None,
    }
}

pub fn connect<'a>(reader: &mut Reader<'a>) -> Result<Connect<'a>, Refusal> {
    let name = reader.string()?;
    let version = match (name, reader.u8()?) {
        ("MQTT", 5) => Version::Five,
        ("MQTT", 4) | ("MQIsdp", 3) => Version::Three,
        ("MQTT" | "MQIsdp", _) => {
            return Err(Refusal::new(
                reason::UNSUPPORTED_VERSION,
                "expected MQTT 3.1, 3.1.1 or 5.0",
            ));
        }
        _ => return Err(Refusal::malformed("the protocol is not MQTT")),
    };
    let flags = reader.u8()?;
    let will_qos = flags >> 3 & 3;
    let has_will = flags & 0x04 != 0;
    // MQTT 3.1 does not define the lowest bit.
    let is_reserved = flags & 1 != 0 && name == "MQTT";
    if is_reserved || will_qos == 3 || (!has_will && flags & 0x38 != 0) {
        return Err(Refusal::malformed(
            "the flags of CONNECT contradict each other",
        ));
    }
    if version == Version::Three && flags & 0xc0 == 0x40 {
        return Err(Refusal::malformed(
            "a password without a user name, which MQTT 3 does not allow",
        ));
    }
    let mut connect = Connect {
        version,
        client_id: "",
        clean: flags & 0x02 != 0,
        keep_alive: reader.u16()?,
        session_expiry: 0,
        receive_maximum: u16::MAX,
        maximum_packet: u32::MAX,
        will: None,
        user: None,
        password: None,
    };
    if version == Version::Five {
        properties_of_connect(reader, &mut connect)?;
    } else if !connect.clean {
        connect.session_expiry = u32::MAX;
    }
    connect.client_id = reader.string()?;
    if has_will {
        connect.will = Some(will(reader, version, will_qos, flags & 0x20 != 0)?);
    }
    if flags & 0x80 != 0 {
        connect.user = Some(reader.string()?);
    }
    if flags & 0x40 != 0 {
        connect.password = Some(reader.binary()?);
    }
    Ok(connect)
}

fn properties_of_connect<'a>(
    reader: &mut Reader<'a>,
    connect: &mut Connect<'a>,
) -> Result<(), Refusal> {
    let (mut has_method, mut has_data) = (false, false);
    each(reader, OF_CONNECT, |id, value| {
        match (id, value) {
            (p::SESSION_EXPIRY, Value::Long(seconds)) => connect.session_expiry = seconds,
            (p::RECEIVE_MAXIMUM, Value::Short(count)) => connect.receive_maximum = count,
            (p::MAXIMUM_PACKET_SIZE, Value::Long(bytes)) => connect.maximum_packet = bytes,
            (p::AUTHENTICATION_METHOD, _) => has_method = true,
            (p::AUTHENTICATION_DATA, _) => has_data = true,
            _ => {}
        }
        Ok(())
    })?;
    if has_method {
        return Err(Refusal::new(
            reason::BAD_AUTHENTICATION_METHOD,
            "enhanced authentication is not supported",
        ));
    }
    if has_data {
        return Err(Refusal::protocol(
            "authentication data without an authentication method",
        ));
    }
    Ok(())
}

fn will<'a>(
    reader: &mut Reader<'a>,
    version: Version,
    qos: u8,
    retain: bool,
) -> Result<Will<'a>, Refusal> {
    let mut delay = 0;
    let mut properties = Vec::new();
    if version == Version::Five {
        let mut delay_at_all = false;
        let all = each(reader, OF_WILL, |id, value| {
            if let (p::WILL_DELAY, Value::Long(seconds)) = (id, value) {
                delay = seconds;
                delay_at_all = true;
            }
            Ok(())
        })?;
        properties = if delay_at_all {
            p::without(all, p::WILL_DELAY)
        } else {
            all.to_vec()
        };
    }
    Ok(Will {
        topic: reader.string()?,
        payload: reader.binary()?,
        properties,
        qos,
        retain,
        delay,
    })
}
