//! Arbitrary bytes are decoded as a packet or refused with a reason, with memory in proportion to their length.

use super::*;
use proptest::prelude::*;
use swarmwright_fuzzing::{config, mutated, noise, packets_of_brokers, packets_of_clients, peak};

fn check(bytes: &[u8], version: Version) {
    let frame = match frame(bytes, 1 << 20) {
        Ok(Some(frame)) => frame,
        Ok(None) => return,
        Err(refusal) => return assert!(!refusal.what.is_empty()),
    };
    let (first, head, length) = frame;
    let Some(body) = bytes.get(head..head + length) else {
        return;
    };
    match decode(first, body, version) {
        Err(refusal) => assert!(refusal.reason >= 0x80 && !refusal.what.is_empty()),
        Ok(Packet::Publish(message)) => {
            let mut written = Vec::new();
            let outgoing = Outgoing {
                topic: message.topic,
                payload: message.payload,
                properties: message.properties,
                expiry: None,
                identifiers: &[],
                qos: message.qos,
                retain: message.retain,
                again: first & 8 != 0,
                id: message.id,
            };
            publish(&mut written, &outgoing, version);
            let (first, head, _) = super::frame(&written, usize::MAX).unwrap().unwrap();
            let again = decode(first, &written[head..], version);
            assert_eq!(again, Ok(Packet::Publish(message)));
        }
        Ok(Packet::Subscribe { filters, .. }) => {
            assert!(!filters.is_empty() && filters.len() <= length)
        }
        Ok(Packet::Unsubscribe { filters, .. }) => {
            assert!(!filters.is_empty() && filters.len() <= length)
        }
        Ok(_) => {}
    }
}

fn check_by_client(bytes: &[u8], version: Version) {
    let Ok(Some((first, head, length))) = frame(bytes, 1 << 20) else {
        return;
    };
    let Some(body) = bytes.get(head..head + length) else {
        return;
    };
    let (packet, held) = peak(|| client::decode(first, body, version));
    assert_eq!(held, 0, "{body:02x?}");
    if let Some((topic, payload)) = client::bare(first, body, version) {
        match packet {
            Ok(client::Packet::Publish(message)) => {
                assert_eq!(
                    (message.topic.as_bytes(), message.payload),
                    (topic, payload)
                );
                assert_eq!(
                    (message.qos, message.id, message.properties),
                    (0, 0, &[][..])
                );
            }
            // The topic is not valid.
            ref other => assert!(
                other.is_err() && std::str::from_utf8(topic).is_err() || topic.contains(&0),
                "{other:?}"
            ),
        }
    }
    match packet {
        Err(refusal) => assert!(refusal.reason >= 0x80 && !refusal.what.is_empty()),
        Ok(client::Packet::Publish(message)) => assert!(message.qos < 2),
        Ok(client::Packet::Connack(connack)) => {
            assert!(connack.code == 0 || connack.code >= 0x80);
            assert!(connack.receive_maximum > 0 && connack.maximum_packet > 0);
        }
        Ok(client::Packet::Suback { id, .. } | client::Packet::Puback { id, .. }) => {
            assert!(id > 0)
        }
        Ok(_) => {}
    }
}

proptest! {
    #![proptest_config(config())]

    #[test]
    fn packets_that_are_nearly_right(bytes in mutated(packets_of_clients())) {
        check(&bytes, Version::Three);
        check(&bytes, Version::Five);
    }

    #[test]
    fn what_is_never_right(bytes in noise()) {
        check(&bytes, Version::Three);
        check(&bytes, Version::Five);
    }

    #[test]
    fn packets_that_are_nearly_right_for_clients(bytes in mutated(packets_of_brokers())) {
        check_by_client(&bytes, Version::Three);
        check_by_client(&bytes, Version::Five);
    }

    #[test]
    fn what_is_never_right_for_clients(bytes in noise()) {
        check_by_client(&bytes, Version::Three);
        check_by_client(&bytes, Version::Five);
    }
}
