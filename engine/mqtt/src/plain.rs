//! PUBLISH at QoS 0 without properties, by hand: nearly every packet of a stepwise run is one (MQTT 5.0 and 3.1.1,
//! chapters 1.5, 2 and 3.3). All other packets, and everything that is malformed, are the business of the crate.

use std::ops::Range;

use crate::session::Version;

/// Largest "remaining length" that four bytes can say.
const LONGEST: usize = 268_435_455;

/// How the next packet in a stream of bytes ends.
#[derive(Debug, PartialEq, Eq)]
pub(crate) enum Cut {
    /// It has not come whole.
    Incomplete,
    /// Its length is no length.
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

/// Where topic and payload of a whole packet lie, if it is a PUBLISH at QoS 0 without properties.
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
    if !is_topic(std::str::from_utf8(packet.get(topic.clone())?).ok()?) {
        return None;
    }
    let payload = match version {
        Version::V5 if *packet.get(topic.end)? == 0 => topic.end + 1,
        Version::V5 => return None,
        Version::V3 => topic.end,
    };
    Some((topic, payload..packet.len()))
}

/// Appends a PUBLISH at QoS 0 to `out`, unless it would be longer than `most` bytes or the topic is none.
pub(crate) fn write(
    topic: &str,
    payload: &[u8],
    version: Version,
    most: usize,
    out: &mut Vec<u8>,
) -> bool {
    let Ok(topic_length) = u16::try_from(topic.len()) else {
        return false;
    };
    let properties: &[u8] = if version == Version::V5 { &[0] } else { &[] };
    let remaining = 2 + topic.len() + properties.len() + payload.len();
    // A fixed header is 5 bytes at most.
    if remaining > LONGEST || remaining + 5 > most || !is_topic(topic) {
        return false;
    }
    out.reserve(remaining + 5);
    out.push(0b0011_0000);
    let mut rest = remaining;
    loop {
        #[expect(clippy::cast_possible_truncation, reason = "seven bits")]
        let low = (rest & 0x7f) as u8;
        rest >>= 7;
        out.push(if rest > 0 { low | 0x80 } else { low });
        if rest == 0 {
            break;
        }
    }
    out.extend_from_slice(&topic_length.to_be_bytes());
    out.extend_from_slice(topic.as_bytes());
    out.extend_from_slice(properties);
    out.extend_from_slice(payload);
    true
}

fn is_topic(name: &str) -> bool {
    !name.is_empty() && !name.bytes().any(|byte| matches!(byte, 0 | b'+' | b'#'))
}
