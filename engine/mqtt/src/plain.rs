//! A fast path for PUBLISH at QoS 0, since nearly every packet of a run is one (MQTT 5.0 and 3.1.1, chapters 1.5, 2 and 3.3),
//! with the few properties that a request has. All other packets, and malformed ones, are left to
//! `mqtt-protocol-core`.

use std::ops::Range;

use crate::publication::PublishOptions;
use crate::session::Version;

/// Largest "remaining length" that four bytes can say.
const LONGEST: usize = 268_435_455;
/// Identifiers of properties (MQTT 5.0, 2.2.2.2).
const EXPIRY: u8 = 2;
const CONTENT_TYPE: u8 = 3;
const RESPONSE_TOPIC: u8 = 8;
const CORRELATION: u8 = 9;

/// How the next packet in a stream of bytes ends.
#[derive(Debug, PartialEq, Eq)]
pub(crate) enum Cut {
    /// It is incomplete.
    Incomplete,
    /// Its length is not valid.
    Malformed,
    /// It has a fixed header of `header` bytes and is `length` bytes long, header included.
    Whole { header: usize, length: usize },
}

/// Finds the end of the packet that `bytes` begin with.
pub(crate) fn cut(bytes: &[u8]) -> Cut {
    let mut remaining = 0;
    for place in 0..4 {
        let Some(&byte) = bytes.get(1 + place) else {
            return Cut::Incomplete;
        };
        remaining |= usize::from(byte & 0x7f) << (7 * place);
        if byte & 0x80 == 0 {
            let header = 2 + place;
            let length = header + remaining;
            return if bytes.len() < length {
                Cut::Incomplete
            } else {
                Cut::Whole { header, length }
            };
        }
    }
    Cut::Malformed
}

/// Where topic and payload of a whole packet lie, if it is a PUBLISH at QoS 0 with the properties above at most.
pub(crate) fn read(
    packet: &[u8],
    header: usize,
    version: Version,
) -> Option<(Range<usize>, Range<usize>)> {
    // Type 3, not a duplicate, QoS 0, retained or not.
    if packet.first()? & 0b1111_1110 != 0b0011_0000 {
        return None;
    }
    let length = [*packet.get(header)?, *packet.get(header + 1)?];
    let topic = header + 2..header + 2 + usize::from(u16::from_be_bytes(length));
    let payload = match version {
        Version::V5 if *packet.get(topic.end)? == 0 => topic.end + 1,
        Version::V5 => skip_properties(packet, topic.end)?,
        Version::V3 => topic.end,
    };
    (payload <= packet.len()).then_some((topic, payload..packet.len()))
}

/// Where the properties end that begin at `start`; none if there are others than those above, or one is malformed or
/// there twice.
fn skip_properties(packet: &[u8], start: usize) -> Option<usize> {
    // At most 127 bytes; more are left to the library.
    let length = usize::from(*packet.get(start).filter(|length| **length < 0x80)?);
    let end = start + 1 + length;
    let mut rest = packet.get(start + 1..end)?;
    let mut seen = 0u16;
    while let [id, values @ ..] = rest {
        let size = match *id {
            EXPIRY => 4,
            CONTENT_TYPE | RESPONSE_TOPIC | CORRELATION => {
                2 + usize::from(u16::from_be_bytes([*values.first()?, *values.get(1)?]))
            }
            _ => return None,
        };
        let value = values.get(..size)?;
        let fits = match *id {
            CONTENT_TYPE => std::str::from_utf8(&value[2..]).is_ok_and(|text| !text.contains('\0')),
            RESPONSE_TOPIC => std::str::from_utf8(&value[2..]).is_ok_and(is_topic),
            _ => true,
        };
        if !fits || seen & (1 << *id) != 0 {
            return None;
        }
        seen |= 1 << *id;
        rest = &values[size..];
    }
    Some(end)
}

/// The properties of a message, without their length; None if they are not valid, which the library reports.
fn properties(options: &PublishOptions<'_>) -> Option<Vec<u8>> {
    let mut bytes = Vec::new();
    if let Some(seconds) = options.expiry {
        bytes.push(EXPIRY);
        bytes.extend_from_slice(&seconds.to_be_bytes());
    }
    for (id, value) in [
        (CONTENT_TYPE, options.content_type.map(str::as_bytes)),
        (RESPONSE_TOPIC, options.response_topic.map(str::as_bytes)),
        (CORRELATION, options.correlation),
    ] {
        if let Some(value) = value {
            bytes.push(id);
            bytes.extend_from_slice(&u16::try_from(value.len()).ok()?.to_be_bytes());
            bytes.extend_from_slice(value);
        }
    }
    let text = options.content_type.is_none_or(|text| !text.contains('\0'));
    let topic = options.response_topic.is_none_or(is_topic);
    (text && topic).then_some(bytes)
}

/// Appends a number of one to four bytes, seven bits each.
fn push_length(mut rest: usize, out: &mut Vec<u8>) {
    loop {
        #[expect(clippy::cast_possible_truncation, reason = "seven bits")]
        let low = (rest & 0x7f) as u8;
        rest >>= 7;
        out.push(if rest > 0 { low | 0x80 } else { low });
        if rest == 0 {
            break;
        }
    }
}

/// Bytes that `push_length` appends.
fn length_size(length: usize) -> usize {
    match length {
        0..0x80 => 1,
        0x80..0x4000 => 2,
        0x4000..0x20_0000 => 3,
        _ => 4,
    }
}

/// Appends a PUBLISH at QoS 0, not retained, to `out`, unless it would be longer than `most` bytes, or is not
/// valid.
pub(crate) fn write(
    topic: &str,
    payload: &[u8],
    options: &PublishOptions<'_>,
    version: Version,
    most: usize,
    out: &mut Vec<u8>,
) -> bool {
    let Ok(topic_length) = u16::try_from(topic.len()) else {
        return false;
    };
    // Without properties nothing is allocated.
    let properties = match version {
        Version::V5 => match properties(options) {
            Some(properties) => Some(properties),
            None => return false,
        },
        Version::V3 => None,
    };
    let head = properties
        .as_ref()
        .map_or(0, |bytes| length_size(bytes.len()) + bytes.len());
    let remaining = 2 + topic.len() + head + payload.len();
    // A fixed header is 5 bytes at most.
    if remaining > LONGEST || remaining + 5 > most || !is_topic(topic) {
        return false;
    }
    out.reserve(remaining + 5);
    out.push(0b0011_0000);
    push_length(remaining, out);
    out.extend_from_slice(&topic_length.to_be_bytes());
    out.extend_from_slice(topic.as_bytes());
    if let Some(properties) = properties {
        push_length(properties.len(), out);
        out.extend_from_slice(&properties);
    }
    out.extend_from_slice(payload);
    true
}

/// These bytes as a topic name, if they are valid.
pub(crate) fn topic(bytes: &[u8]) -> Option<&str> {
    std::str::from_utf8(bytes)
        .ok()
        .filter(|name| is_topic(name))
}

/// Whether a name can be published to.
pub(crate) fn is_topic(name: &str) -> bool {
    !name.is_empty() && !name.bytes().any(|byte| matches!(byte, 0 | b'+' | b'#'))
}
