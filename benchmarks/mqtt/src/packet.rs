//! The few MQTT packets that the tests need, encoded and cut apart by hand (MQTT 5.0 and 3.1.1, chapters 2 and 3).

/// CONNECT with a clean start, no keep-alive, no credentials.
pub fn connect(client: &str, five: bool) -> Vec<u8> {
    let mut body = string("MQTT");
    body.extend([if five { 5 } else { 4 }, 0b10, 0, 0]);
    if five {
        body.push(0);
    }
    body.extend(string(client));
    packet(0x10, &body)
}

/// SUBSCRIBE to one topic filter at QoS 0, packet identifier 1.
pub fn subscribe(filter: &str, five: bool) -> Vec<u8> {
    let mut body = vec![0, 1];
    if five {
        body.push(0);
    }
    body.extend(string(filter));
    body.push(0);
    packet(0x82, &body)
}

/// PUBLISH at QoS 0.
pub fn publish(topic: &str, payload: &[u8], five: bool) -> Vec<u8> {
    let mut body = string(topic);
    if five {
        body.push(0);
    }
    body.extend(payload);
    packet(0x30, &body)
}

/// Type (high half of the first byte) and whole length of the packet that `bytes` start with; None when they end too early to tell.
pub fn head(bytes: &[u8]) -> Option<(u8, usize)> {
    let kind = bytes.first()? >> 4;
    let mut length = 0usize;
    for (place, byte) in bytes[1..].iter().take(4).enumerate() {
        length |= usize::from(byte & 0x7f) << (7 * place);
        if byte & 0x80 == 0 {
            return Some((kind, length + place + 2));
        }
    }
    None
}

/// The payload of a PUBLISH packet at QoS 0.
pub fn payload(packet: &[u8], five: bool) -> Option<&[u8]> {
    let length_bytes = packet[1..].iter().position(|byte| byte & 0x80 == 0)? + 1;
    let body = packet.get(1 + length_bytes..)?;
    let topic = usize::from(u16::from_be_bytes([*body.first()?, *body.get(1)?]));
    let rest = body.get(2 + topic..)?;
    // Brokers add no property to a message that has none; should one, its length fits a byte.
    let properties = if five {
        1 + usize::from(*rest.first()?)
    } else {
        0
    };
    rest.get(properties..)
}

fn string(text: &str) -> Vec<u8> {
    let length = u16::try_from(text.len()).unwrap_or(u16::MAX);
    let mut bytes = length.to_be_bytes().to_vec();
    bytes.extend(&text.as_bytes()[..usize::from(length)]);
    bytes
}

fn packet(first: u8, body: &[u8]) -> Vec<u8> {
    let mut bytes = vec![first];
    let mut rest = body.len();
    loop {
        let low = (rest & 0x7f) as u8;
        rest >>= 7;
        bytes.push(if rest > 0 { low | 0x80 } else { low });
        if rest == 0 {
            break;
        }
    }
    bytes.extend(body);
    bytes
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn heads_give_the_length_of_what_was_encoded() {
        for size in [0, 1, 100, 127, 128, 200, 16_383, 16_384, 2_097_152] {
            for five in [false, true] {
                let bytes = publish("bare", &vec![0; size], five);
                assert_eq!(head(&bytes), Some((3, bytes.len())), "{size}");
            }
        }
    }

    #[test]
    fn a_payload_is_found_behind_any_topic() {
        for size in [0, 2, 127, 200, 20_000] {
            let sent: Vec<u8> = (0..size).map(|i| i as u8).collect();
            for (topic, five) in [("", true), ("bare/back", true), ("bare/back", false)] {
                let bytes = publish(topic, &sent, five);
                assert_eq!(payload(&bytes, five), Some(sent.as_slice()));
            }
        }
    }

    #[test]
    fn a_head_cut_short_is_not_guessed() {
        let bytes = publish("bare", &[0; 20_000], true);
        for end in 0..4 {
            assert_eq!(head(&bytes[..end]), None);
        }
    }
}
