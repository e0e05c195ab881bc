//! Arbitrary bytes are a packet or refused with a reason, in memory proportional to their length.

use super::*;
use proptest::prelude::*;
use swarmwright_fuzzing::{config, mutated, noise, packets_of_clients};

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
}
