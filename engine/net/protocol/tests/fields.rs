//! Replays `protocol/vectors/fields.json`, which is generated from the schemas: each field is present, missing, or
//! mistyped.
#![allow(clippy::unwrap_used, clippy::panic)] // helpers of tests

use std::fs;
use std::path::PathBuf;

use base64::Engine;
use serde_json::Value;
use swarmwright_protocol::{Message, ToServer, ToTool, Topic};

fn vectors() -> Vec<Value> {
    let path = "../../../protocol/vectors/fields.json";
    let text = fs::read_to_string(PathBuf::from(env!("CARGO_MANIFEST_DIR")).join(path)).unwrap();
    serde_json::from_str(&text).unwrap()
}

fn payload(vector: &Value) -> Vec<u8> {
    match (&vector["text"], &vector["bytes"]) {
        (Value::String(text), _) => text.clone().into_bytes(),
        (_, Value::String(bytes)) => base64::engine::general_purpose::STANDARD
            .decode(bytes)
            .unwrap(),
        _ => panic!("a vector without payload: {vector}"),
    }
}

/// Decodes and encodes a message; an error if it is refused.
fn read_and_write(topic: &str, payload: &[u8]) -> Result<Vec<u8>, String> {
    let json = |topic| Message::decode(topic, payload).map_err(|error| error.to_string());
    Ok(match topic {
        "to_server" => ToServer::decode(payload)
            .map_err(|error| error.to_string())?
            .encode(),
        "to_tool" => ToTool::decode(payload)
            .map_err(|error| error.to_string())?
            .encode(),
        "presence" | "status" => match json(if topic == "status" {
            Topic::Status
        } else {
            Topic::Presence
        })? {
            Message::Presence(message) => message.encode(),
            Message::Status(message) => message.encode(),
            other => panic!("{other:?}"),
        },
        name => {
            let topic = Topic::SEED.into_iter().find(|topic| topic.name() == name);
            match json(topic.unwrap())? {
                Message::Discovery(message) => message.encode(),
                Message::Server(message) => message.encode(),
                Message::Parameters(message) => message.encode(),
                Message::Control(message) => message.encode(),
                Message::Sensor(message) => message.encode(),
                Message::Actuator(message) => message.encode(),
                Message::Fitness(message) => message.encode(),
                other => panic!("{other:?}"),
            }
        }
    })
}

/// Compares as JSON: 2 and 2.0 are the same number.
fn same(left: &Value, right: &Value) -> bool {
    match (left, right) {
        (Value::Number(a), Value::Number(b)) => a.as_f64() == b.as_f64(),
        (Value::Array(a), Value::Array(b)) => {
            a.len() == b.len() && a.iter().zip(b).all(|(a, b)| same(a, b))
        }
        (Value::Object(a), Value::Object(b)) => {
            a.len() == b.len()
                && a.iter()
                    .all(|(key, a)| b.get(key).is_some_and(|b| same(a, b)))
        }
        _ => left == right,
    }
}

#[test]
fn messages_are_accepted_or_refused_as_the_schemas_demand() {
    let vectors = vectors();
    assert!(vectors.len() >= 300, "{}", vectors.len());
    let mut wrong = Vec::new();
    for vector in vectors {
        let found = read_and_write(vector["topic"].as_str().unwrap(), &payload(&vector));
        if found.is_ok() != (vector["accept"] == true) {
            wrong.push(format!("{}: {:?}", vector["name"], found.err()));
        }
    }
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
}

#[test]
fn what_is_written_has_every_field_of_the_schemas() {
    let mut seen = 0;
    for vector in vectors().iter().filter(|vector| vector["written"] == true) {
        let topic = vector["topic"].as_str().unwrap();
        let payload = payload(vector);
        let written = read_and_write(topic, &payload).unwrap();
        if vector["bytes"].is_string() {
            // The MessagePack vectors are in canonical form.
            assert_eq!(written, payload, "{}", vector["name"]);
        } else {
            let (expected, found): (Value, Value) = (
                serde_json::from_slice(&payload).unwrap(),
                serde_json::from_slice(&written).unwrap(),
            );
            assert!(
                same(&expected, &found),
                "{}: {found}\nexpected {expected}",
                vector["name"]
            );
        }
        seen += 1;
    }
    assert!(seen >= 15, "{seen}");
}
