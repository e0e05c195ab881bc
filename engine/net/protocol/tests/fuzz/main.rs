//! Decoders for arbitrary payloads refuse them with a reason or decode them, never panic, and use memory in proportion
//! to the payload. Whatever is decoded is encoded so that it decodes to the same message.
#![allow(clippy::unwrap_used, clippy::panic)] // helpers of tests

mod any;

use std::fs;
use std::path::PathBuf;

use any::message;
use base64::Engine;
use proptest::prelude::*;
use serde_json::Value;
use swarmwright_fuzzing::{Counting, config, mutated, noise, peak};
use swarmwright_protocol::{
    DecodeError, Envelope, Message, Requirements, Sensor, SensorReading, Topic, Topics,
};

#[global_allocator]
static MEMORY: Counting = Counting;

const ALL: [Topic; 11] = [
    Topic::Discovery,
    Topic::Server,
    Topic::Parameters,
    Topic::Control,
    Topic::Sensor,
    Topic::Actuator,
    Topic::Fitness,
    Topic::Presence,
    Topic::Status,
    Topic::ToServer,
    Topic::ToTool,
];

fn topic(name: &str) -> Topic {
    match name {
        "presence" => Topic::Presence,
        "status" => Topic::Status,
        "to_server" => Topic::ToServer,
        "to_tool" => Topic::ToTool,
        _ => *ALL.iter().find(|topic| topic.name() == name).unwrap(),
    }
}

/// Returns the golden payloads of a list of vectors, with their topics.
fn golden(name: &str) -> Vec<(Topic, Vec<u8>)> {
    let vectors = PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../../../protocol/vectors");
    let text = fs::read_to_string(vectors.join(name)).unwrap();
    let list: Vec<Value> = serde_json::from_str(&text).unwrap();
    let base64 = base64::engine::general_purpose::STANDARD;
    let payload = |vector: &Value| match (&vector["text"], &vector["bytes"], &vector["file"]) {
        (Value::String(text), ..) => text.clone().into_bytes(),
        (_, Value::String(bytes), _) => base64.decode(bytes).unwrap(),
        (.., Value::String(file)) => fs::read(vectors.join(file)).unwrap(),
        _ => panic!("a vector without payload: {vector}"),
    };
    list.iter()
        .map(|vector| (topic(vector["topic"].as_str().unwrap()), payload(vector)))
        .collect()
}

/// Generates mutated golden payloads, each for its own topic or, sometimes, another one.
fn nearly(name: &str) -> impl Strategy<Value = (Topic, Vec<u8>)> + use<> {
    let golden = golden(name);
    let topics: Vec<Topic> = golden.iter().map(|(topic, _)| *topic).collect();
    let payloads: Vec<Vec<u8>> = golden.into_iter().map(|(_, payload)| payload).collect();
    let by_topic = move |topic: Topic| -> Vec<Vec<u8>> {
        let pairs = topics.iter().zip(&payloads);
        let own = pairs.filter(|(other, _)| **other == topic);
        own.map(|(_, payload)| payload.clone()).collect()
    };
    let strategies: Vec<_> = ALL
        .into_iter()
        .map(|topic| (topic, by_topic(topic)))
        .filter(|(_, payloads)| !payloads.is_empty())
        .map(|(topic, payloads)| {
            mutated(payloads)
                .prop_map(move |bytes| (topic, bytes))
                .boxed()
        })
        .collect();
    let stray = prop::sample::select(ALL.to_vec());
    (prop::strategy::Union::new(strategies), stray, 0..16u8)
        .prop_map(|((own, bytes), stray, odd)| (if odd == 0 { stray } else { own }, bytes))
}

fn encode(message: &Message) -> Vec<u8> {
    match message {
        Message::Discovery(m) => m.encode(),
        Message::Server(m) => m.encode(),
        Message::Parameters(m) => m.encode(),
        Message::Control(m) => m.encode(),
        Message::Sensor(m) => m.encode(),
        Message::Actuator(m) => m.encode(),
        Message::Fitness(m) => m.encode(),
        Message::Presence(m) => m.encode(),
        Message::Status(m) => m.encode(),
        Message::ToServer(m) => m.encode(),
        Message::ToTool(m) => m.encode(),
    }
}

/// Bytes of memory per byte of a payload: an object of one key, seven characters, is a node of a tree with a capacity
/// of eleven.
const BYTES_PER_BYTE: usize = 200;

/// Decodes a payload, and checks error message and memory.
fn read<T>(payload: &[u8], decode: impl FnOnce(&[u8]) -> Result<T, DecodeError>) -> Option<T> {
    let (decoded, bytes) = peak(|| decode(payload));
    let most = 4096 + BYTES_PER_BYTE * payload.len();
    assert!(
        bytes <= most,
        "{bytes} bytes for {} of payload",
        payload.len()
    );
    match decoded {
        Ok(message) => Some(message),
        Err(error) => {
            let words = error.to_string();
            assert!((5..2000).contains(&words.len()), "{words:?}");
            None
        }
    }
}

/// Decodes a payload, encodes the message, and decodes the result.
fn there_and_back(topic: Topic, payload: &[u8]) {
    let Some(message) = read(payload, |payload| Message::decode(topic, payload)) else {
        return;
    };
    let written = encode(&message);
    let again = read(&written, |payload| Message::decode(topic, payload));
    let again = again.unwrap_or_else(|| panic!("{message:?} is written so that it cannot be read"));
    // Compare bytes, since NaN, which stands for a failed evaluation, differs from itself.
    assert_eq!(
        encode(&again),
        written,
        "{message:?} reads back as {again:?}"
    );
    assert_eq!(format!("{again:?}"), format!("{message:?}"));
}

proptest! {
    #![proptest_config(config())]

    #[test]
    fn messages_that_are_nearly_right((topic, payload) in nearly("messages.json")) {
        there_and_back(topic, &payload);
    }

    #[test]
    fn blocks_that_are_nearly_right((topic, payload) in nearly("extension.json")) {
        there_and_back(topic, &payload);
    }

    #[test]
    fn what_is_never_right(payload in noise()) {
        for topic in ALL {
            there_and_back(topic, &payload);
        }
        let (_, bytes) = peak(|| Envelope::decode(&payload));
        prop_assert!(bytes <= 4096 + BYTES_PER_BYTE * payload.len());
        read(&payload, Requirements::decode);
    }

    #[test]
    fn the_fast_reader_and_the_other_one_agree((topic, payload) in nearly("messages.json")) {
        if topic == Topic::Sensor {
            let fast = SensorReading::decode(&payload);
            match Message::decode(topic, &payload) {
                Ok(Message::Sensor(Sensor { simulation_hash, agent, sensor, .. })) => {
                    let fast = fast.unwrap();
                    prop_assert_eq!((&*fast.simulation_hash, fast.agent), (&*simulation_hash, agent));
                    prop_assert_eq!(&fast.sensor[..], &sensor[..]);
                }
                _ => prop_assert!(fast.is_err()),
            }
        }
    }

    #[test]
    fn topics(prefix in ".{0,20}", name in ".{0,40}", server in any::<u64>(), token in "[A-Za-z0-9_-]{1,20}") {
        let _ = Topics::default().parse(&name);
        let Ok(topics) = Topics::new(&prefix) else { return Ok(()) };
        let _ = topics.parse(&name);
        for topic in Topic::SEED {
            prop_assert_eq!(topics.parse(&topics.name(topic)), Some(topic));
        }
        prop_assert_eq!(topics.parse(&topics.presence(server)), Some(Topic::Presence));
        prop_assert_eq!(topics.parse(&topics.to_server(server)), Some(Topic::ToServer));
        prop_assert_eq!(topics.parse(&topics.to_tool(&token)), Some(Topic::ToTool));
    }

    #[test]
    fn every_message_reads_back_the_same(message in message()) {
        let topic = match &message {
            Message::Discovery(_) => Topic::Discovery,
            Message::Server(_) => Topic::Server,
            Message::Parameters(_) => Topic::Parameters,
            Message::Control(_) => Topic::Control,
            Message::Sensor(_) => Topic::Sensor,
            Message::Actuator(_) => Topic::Actuator,
            Message::Fitness(_) => Topic::Fitness,
            Message::Presence(_) => Topic::Presence,
            Message::Status(_) => Topic::Status,
            Message::ToServer(_) => Topic::ToServer,
            Message::ToTool(_) => Topic::ToTool,
        };
        prop_assert_eq!(Message::decode(topic, &encode(&message)), Ok(message));
    }
}

#[test]
fn what_is_refused_is_not_quoted_at_length() {
    let long = "\u{e4}".repeat(200_000);
    let control = format!(r#"{{"server": "{long}", "simulation_hash": "h"}}"#);
    let kind = [&b"\x81\xa4kind\xdb\0\x06\x1a\x80"[..], long.as_bytes()].concat();
    for (topic, payload) in [
        (Topic::Control, control.into_bytes()),
        (Topic::ToTool, kind.clone()),
        (Topic::ToServer, kind),
    ] {
        let words = Message::decode(topic, &payload).unwrap_err().to_string();
        assert!(
            words.chars().count() <= 420 && words.contains("..."),
            "{words}"
        );
    }
}
