//! CONNECT: MQTT 5.0 and 3.1.1, chapter 3.1.

use crate::properties::{self as p, Value, each};
use crate::{Refusal, Version, reader::Reader, reason};

/// The contents of a CONNECT.
#[derive(Debug, PartialEq, Eq)]
pub struct Connect<'a> {
    /// The rules of the connection.
    pub version: Version,
    /// Empty where the broker is to choose one.
    pub client_id: &'a str,
    /// Discard an earlier session with this identifier (clean start).
    pub clean: bool,
    /// Keep-alive interval in seconds; 0 = none.
    pub keep_alive: u16,
    /// Seconds that the session outlives the connection, `u32::MAX` = for ever.
    pub session_expiry: u32,
    /// QoS 1 and 2 messages that the client accepts before it acknowledges one.
    pub receive_maximum: u16,
    /// The largest packet that the client accepts, bytes.
    pub maximum_packet: u32,
    /// Published when the client is lost.
    pub will: Option<Will<'a>>,
    /// User name.
    pub user: Option<&'a str>,
    /// Any bytes.
    pub password: Option<&'a [u8]>,
}

/// What is published when the client is lost.
#[derive(Debug, PartialEq, Eq)]
pub struct Will<'a> {
    /// As sent, which may be one that cannot be published to.
    pub topic: &'a str,
    /// The message.
    pub payload: &'a [u8],
    /// Those of the PUBLISH to come, the will delay taken out.
    pub properties: Vec<u8>,
    /// 0 to 2.
    pub qos: u8,
    /// Whether the broker keeps it.
    pub retain: bool,
    /// Seconds between the loss and the message.
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

/// The version of a CONNECT, as far as it can be read: a client is refused in its own.
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
    // MQTT 3.1 leaves the lowest bit to any use.
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
