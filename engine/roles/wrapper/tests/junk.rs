//! The server stays usable whatever arrives on the topic of requests.
#![allow(clippy::unwrap_used, clippy::panic)] // helpers of tests

use crate::common;

use common::{Server, batch, request};
use proptest::prelude::*;
use swarmwright_protocol::{BatchActuators, EXTENSION_VERSION, F32s, ToServer, ToTool, Topics};

fn sound() -> Vec<Vec<u8>> {
    let actuators = BatchActuators {
        version: EXTENSION_VERSION,
        request: 1,
        step: 0,
        actuators: F32s(vec![0.5; 6]),
    };
    vec![
        ToServer::Evaluate(request(1)).encode(),
        ToServer::Start(batch(1)).encode(),
        ToServer::Actuators(actuators).encode(),
    ]
}

/// Generates messages with changed, removed and inserted bytes, and arbitrary bytes.
fn junk() -> impl Strategy<Value = Vec<u8>> {
    let edits = prop::collection::vec((any::<prop::sample::Index>(), 0u8..4, any::<u8>()), 0..6);
    let damaged = (prop::sample::select(sound()), edits).prop_map(|(mut bytes, edits)| {
        for (index, kind, byte) in edits {
            let at = index
                .index(bytes.len().max(1))
                .min(bytes.len().saturating_sub(1));
            match kind {
                0 if !bytes.is_empty() => bytes[at] = byte,
                1 => bytes.insert(at, byte),
                2 if !bytes.is_empty() => drop(bytes.remove(at)),
                _ => bytes.truncate(at),
            }
        }
        bytes
    });
    prop_oneof![4 => damaged, 1 => prop::collection::vec(any::<u8>(), 0..200)]
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(400))]

    #[test]
    fn nothing_that_comes_in_ends_the_server(messages in prop::collection::vec(junk(), 1..8)) {
        let mut server = Server::of_walks();
        let inbox = Topics::default().to_server(common::ID);
        for message in &messages {
            server.receive(&inbox, message);
            server.compute();
        }
        // All work ends with the time-outs; then the server serves requests.
        for _ in 0..3 {
            server.pass(common::STEP_TIMEOUT);
        }
        server.replies.clear();
        prop_assert!(server.answers(None));
        server.evaluate(request(77));
        server.compute();
        let results = server.results();
        prop_assert_eq!((results[0].request, results[0].fitness.0.len()), (77, 4));
    }

    #[test]
    fn what_is_read_is_written_alike(messages in prop::collection::vec(junk(), 1..8)) {
        for bytes in messages {
            if let Ok(message) = ToServer::decode(&bytes) {
                prop_assert_eq!(ToServer::decode(&message.encode()), Ok(message));
            }
            let _ = ToTool::decode(&bytes);
        }
    }
}

/// Announced lengths beyond the payload must not be trusted.
#[test]
fn lengths_that_lie_cost_nothing() {
    let inbox = Topics::default().to_server(common::ID);
    let mut server = Server::of_walks();
    for bytes in [
        &[0xdf, 0xff, 0xff, 0xff, 0xff][..], // a map of 2^32 - 1 keys
        &[0xdd, 0xff, 0xff, 0xff, 0xff],     // an array
        &[0x81, 0xa1, b'a', 0xc6, 0xff, 0xff, 0xff, 0xff], // 4 GiB of bytes
        &[0x81, 0xdb, 0xff, 0xff, 0xff, 0xff], // 4 GiB of text
        &[0x91; 100_000],                    // deep
        &[0x81, 0xa1, b'a', 0x91, 0x91],
    ] {
        server.receive(&inbox, bytes);
    }
    server.receive(&inbox, &vec![0xc1; 70 << 20]);
    assert!(server.answers(None));
    assert!(!server.warnings.is_empty());
}
