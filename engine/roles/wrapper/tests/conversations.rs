//! Replays the golden conversations (`protocol/vectors/conversations`) against the server's state machine.
#![allow(clippy::unwrap_used, clippy::panic)] // helpers of tests

use std::fs;
use std::path::PathBuf;
use std::time::{Duration, Instant};

use serde_json::Value;
use swarmwright_protocol::{ToTool, Topic, Topics};
use swarmwright_worlds::Minisim;
use swarmwright_wrapper::{Action, Identity, Machine};

fn vectors() -> PathBuf {
    PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../../../protocol/vectors")
}

/// Returns whether a message has every key of the expected one with its value; sensor values are compared as binary32.
fn fits(expected: &Value, actual: &Value, binary32: bool) -> bool {
    match (expected, actual) {
        (Value::Object(expected), Value::Object(actual)) => expected.iter().all(|(key, value)| {
            actual
                .get(key)
                .is_some_and(|other| fits(value, other, key == "sensor"))
        }),
        (Value::Array(expected), Value::Array(actual)) => {
            expected.len() == actual.len()
                && expected
                    .iter()
                    .zip(actual)
                    .all(|(a, b)| fits(a, b, binary32))
        }
        (Value::Number(a), Value::Number(b)) => {
            let (a, b) = (a.as_f64().unwrap(), b.as_f64().unwrap());
            #[expect(clippy::cast_possible_truncation, reason = "meant")]
            if binary32 {
                a as f32 == b as f32
            } else {
                a == b
            }
        }
        _ => expected == actual,
    }
}

/// Takes the messages of the server on the seven topics and on those of tools.
fn said(machine: &mut Machine) -> Vec<(String, Value)> {
    machine
        .actions()
        .filter_map(|action| match action {
            Action::Publish(Topic::Presence, _) => None,
            Action::Publish(topic, payload) => {
                let message = serde_json::from_slice(&payload).unwrap();
                Some((topic.name().to_owned(), message))
            }
            Action::Reply { topic, payload, .. } => match ToTool::decode(&payload).unwrap() {
                ToTool::Failed(message) => {
                    let mut message = serde_json::to_value(message).unwrap();
                    message["kind"] = "failed".into();
                    Some((topic, message))
                }
                other => panic!("{other:?}"),
            },
            // No client requests this.
            action @ Action::Evaluate(_) => panic!("{action:?}"),
            Action::Notice(_) | Action::Frame(_) | Action::GiveWay(_) => None,
        })
        .collect()
}

fn replay(name: &str, conversation: &Value) {
    let id = conversation["server"]["server"].as_u64().unwrap();
    let mut machine = Machine::new(
        Identity::new(id),
        vec![Box::<Minisim>::default()],
        Topics::default(),
        Duration::from_secs(60),
    );
    let mut now = Instant::now();
    let mut pending: Vec<(String, Value)> = Vec::new();
    for (index, entry) in conversation["messages"]
        .as_array()
        .unwrap()
        .iter()
        .enumerate()
    {
        let location = format!("{name}, entry {index}: {entry}");
        now += Duration::from_millis(1);
        if entry.get("silence").is_some() {
            assert!(pending.is_empty(), "{location}: {pending:?}");
        } else if entry["from"] == "server" {
            assert!(!pending.is_empty(), "{location}: the server says nothing");
            let (topic, message) = pending.remove(0);
            let expected = match entry["token"].as_str() {
                Some(token) => Topics::default().to_tool(token),
                None => entry["topic"].as_str().unwrap().to_owned(),
            };
            assert_eq!(topic, expected, "{location}: {message}");
            assert!(
                fits(&entry["payload"], &message, false),
                "{location}: {message}"
            );
        } else {
            let payload = match (&entry["payload"], &entry["text"], &entry["file"]) {
                (_, Value::String(text), _) => text.clone().into_bytes(),
                (_, _, Value::String(file)) => fs::read(vectors().join(file)).unwrap(),
                (payload, ..) => payload.to_string().into_bytes(),
            };
            let retained = entry["retain"] == true;
            machine.receive(entry["topic"].as_str().unwrap(), &payload, retained, now);
            pending.extend(said(&mut machine));
            // Let the server do everything that is due without waiting.
            while machine.next_tick().is_some_and(|at| at <= now) {
                machine.tick(now, String::new);
                pending.extend(said(&mut machine));
            }
        }
    }
    assert!(
        pending.is_empty(),
        "{name}: the server says more: {pending:?}"
    );
}

#[test]
fn the_server_answers_as_in_the_golden_conversations() {
    let mut replayed = 0;
    for file in fs::read_dir(vectors().join("conversations")).unwrap() {
        let path = file.unwrap().path();
        let conversation: Value = serde_json::from_slice(&fs::read(&path).unwrap()).unwrap();
        replay(&path.file_name().unwrap().to_string_lossy(), &conversation);
        replayed += 1;
    }
    assert!(replayed >= 10, "{replayed} conversations found");
}
