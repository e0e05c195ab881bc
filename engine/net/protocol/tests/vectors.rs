//! Replays the golden vectors of the contract (`protocol/vectors`).
#![allow(clippy::unwrap_used, clippy::panic)] // helpers of tests

use std::fs;
use std::path::PathBuf;

use base64::Engine;
use serde_json::{Value, json};
use swarmwright_protocol::{
    AnnouncedSide, Capabilities, EpisodeHasher, Message, State, Status, Topic, Topics, Used,
    Waiting,
};

fn vectors() -> PathBuf {
    PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../../../protocol/vectors")
}

fn load(name: &str) -> Vec<Value> {
    let text = fs::read_to_string(vectors().join(name)).unwrap();
    serde_json::from_str(&text).unwrap()
}

/// Returns the vectors of all JSON messages.
fn every_message() -> Vec<Value> {
    [load("messages.json"), load("status.json")].concat()
}

fn topic(name: &str) -> Topic {
    match name {
        "presence" => Topic::Presence,
        "to_server" => Topic::ToServer,
        "to_tool" => Topic::ToTool,
        "status" => Topic::Status,
        _ => Topic::SEED
            .into_iter()
            .find(|topic| topic.name() == name)
            .unwrap(),
    }
}

fn side(side: &AnnouncedSide) -> Value {
    json!({"name": side.name, "groups": side.groups, "fitness": side.fitness})
}

fn capabilities(capabilities: &Capabilities) -> Value {
    json!({
        "dimensions": capabilities.dimensions,
        "max_agents": capabilities.max_agents,
        "swarmwright": capabilities.swarmwright.as_ref().map(|announced| json!({
            "version": announced.version, "modes": announced.modes,
            "controllers": Some(&announced.controllers).filter(|kinds| !kinds.is_empty()), "batch": announced.batch, "sensors": announced.sensors,
            "actuators": announced.actuators, "metrics": Some(&announced.metrics).filter(|names| !names.is_empty()),
            "sides": Some(announced.sides.iter().map(side).collect::<Vec<_>>()).filter(|sides| !sides.is_empty()), "instance": announced.instance, "host": announced.host, "pid": announced.pid,
        })),
    })
}

/// Converts a status as in the vectors: absent fields are null.
fn status(message: &Status) -> Value {
    let waiting = |entry: &Waiting| {
        json!({"server": entry.server, "kind": entry.kind, "missing": entry.missing, "evaluations": entry.evaluations,
            "agent": entry.agent, "step": entry.step, "silent": entry.silent, "words": entry.to_string()})
    };
    let used = |entry: &Used| {
        json!({"server": entry.server, "mode": entry.mode, "speed": entry.speed, "failures": entry.failures,
            "reason": entry.reason, "benched": entry.benched})
    };
    json!({
        "tool": message.tool, "state": message.state, "simulation": message.simulation, "run": message.run,
        "generation": message.generation, "generations": message.generations, "done": message.done,
        "total": message.total, "no_server": message.no_server,
        "waiting_for": message.waiting_for.iter().map(waiting).collect::<Vec<_>>(),
        "servers": message.servers.iter().map(used).collect::<Vec<_>>(),
    })
}

/// Converts a message as in the vectors.
fn reading(message: &Message) -> Value {
    match message {
        Message::Discovery(m) => json!({
            "simulation": m.simulation, "simulation_hash": m.simulation_hash, "tool": m.tool,
            "requirements": {"dimensions": m.requirements.dimensions, "max_agents": m.requirements.max_agents},
        }),
        Message::Server(m) => json!({
            "server": m.server, "simulation_hash": m.simulation_hash, "simulations": m.simulations,
            "capabilities": capabilities(&m.capabilities),
        }),
        Message::Parameters(m) => {
            json!({"server": m.server, "simulation_hash": m.simulation_hash, "parameters": m.parameters})
        }
        Message::Control(m) => json!({
            "server": m.server, "simulation": m.simulation, "simulation_hash": m.simulation_hash,
            "run": m.run, "visual": m.visual, "tool": m.tool, "reply": m.reply, "instance": m.instance,
        }),
        Message::Sensor(m) => json!({
            "simulation": m.simulation, "simulation_hash": m.simulation_hash, "agent": m.agent, "sensor": m.sensor,
        }),
        Message::Actuator(m) => json!({
            "simulation": m.simulation, "simulation_hash": m.simulation_hash, "agent": m.agent, "actuator": m.actuator,
        }),
        Message::Fitness(m) => {
            let metrics = Some(&m.metrics).filter(|metrics| !metrics.is_empty());
            json!({"simulation": m.simulation, "simulation_hash": m.simulation_hash, "fitness": m.fitness, "metrics": metrics})
        }
        // MessagePack messages have their own vectors.
        Message::ToServer(_) | Message::ToTool(_) => Value::Null,
        Message::Presence(m) => json!({
            "server": m.server,
            "state": match m.state { State::Ready => "ready", State::Busy => "busy", State::Lost => "lost" },
            "simulations": m.simulations, "capabilities": capabilities(&m.capabilities), "tool": m.tool, "since": m.since,
        }),
        Message::Status(m) => status(m),
    }
}

/// Compares as JSON: 1 and 1.0 are the same number; `binary32` compares numbers as binary32.
fn same(left: &Value, right: &Value, binary32: bool) -> bool {
    match (left, right) {
        (Value::Number(a), Value::Number(b)) => {
            if let (Some(a), Some(b)) = (a.as_u64(), b.as_u64()) {
                return a == b;
            }
            let (a, b) = (a.as_f64().unwrap(), b.as_f64().unwrap());
            #[expect(clippy::cast_possible_truncation, reason = "meant")]
            if binary32 {
                (a as f32).to_bits() == (b as f32).to_bits() || a == b
            } else {
                a == b
            }
        }
        (Value::Array(a), Value::Array(b)) => {
            a.len() == b.len() && a.iter().zip(b).all(|(a, b)| same(a, b, binary32))
        }
        (Value::Object(a), Value::Object(b)) => {
            a.len() == b.len()
                && a.iter()
                    .all(|(key, a)| b.get(key).is_some_and(|b| same(a, b, binary32)))
        }
        _ => left == right,
    }
}

#[test]
fn messages_are_read_as_the_vectors_say() {
    for vector in every_message() {
        let payload = match (&vector["text"], &vector["bytes"], &vector["file"]) {
            (Value::String(text), ..) => text.clone().into_bytes(),
            (_, Value::String(bytes), _) => base64::engine::general_purpose::STANDARD
                .decode(bytes)
                .unwrap(),
            (.., Value::String(file)) => fs::read(vectors().join(file)).unwrap(),
            _ => panic!("a vector without payload: {vector}"),
        };
        let topic = topic(vector["topic"].as_str().unwrap());
        let decoded = Message::decode(topic, &payload);
        let name = &vector["name"];
        assert_eq!(
            decoded.is_ok(),
            vector["accept"].as_bool().unwrap(),
            "{name}: {decoded:?}; {}",
            vector["why"]
        );
        let Ok(message) = decoded else { continue };
        if let (Message::Sensor(_), Some(_)) = (&message, vector["binary32"].as_array()) {
            // `serde_json` rounds the vectors twice, so these are compared by their bits below.
        } else {
            let binary32 = matches!(topic, Topic::Sensor | Topic::Actuator);
            assert!(
                same(&reading(&message), &vector["reading"], binary32),
                "{name}: {message:?}"
            );
        }
        if let (Some(bits), Message::Sensor(sensor)) = (vector["binary32"].as_array(), &message) {
            let read: Vec<String> = sensor
                .sensor
                .iter()
                .map(|value| format!("{:08x}", value.to_bits()))
                .collect();
            let expected: Vec<String> = bits
                .iter()
                .map(|bits| {
                    bits.as_str().map_or_else(
                        || format!("{:08x}", bits.as_u64().unwrap()),
                        |text| text.trim_start_matches("0x").to_owned(),
                    )
                })
                .collect();
            assert_eq!(read, expected, "{name}");
        }
    }
}

#[test]
fn what_is_written_reads_back_the_same() {
    for vector in every_message()
        .iter()
        .filter(|vector| vector["accept"] == true)
    {
        let payload = match (&vector["text"], &vector["file"]) {
            (Value::String(text), _) => text.clone().into_bytes(),
            (_, Value::String(file)) => fs::read(vectors().join(file)).unwrap(),
            _ => continue,
        };
        let topic = topic(vector["topic"].as_str().unwrap());
        let message = Message::decode(topic, &payload).unwrap();
        let written = match &message {
            Message::Discovery(m) => m.encode(),
            Message::Server(m) => m.encode(),
            Message::Parameters(m) => m.encode(),
            Message::Control(m) => m.encode(),
            Message::Sensor(m) => m.encode(),
            Message::Actuator(m) => m.encode(),
            Message::Fitness(m) => m.encode(),
            Message::Presence(m) => m.encode(),
            Message::ToServer(m) => m.encode(),
            Message::ToTool(m) => m.encode(),
            Message::Status(m) => m.encode(),
        };
        assert_eq!(
            Message::decode(topic, &written),
            Ok(message),
            "{}",
            vector["name"]
        );
    }
}

#[test]
fn hashes_are_those_of_the_vectors() {
    for vector in load("hashes.json") {
        let value = &vector["value"];
        let Some(instance) = value["instance"].as_u64() else {
            continue;
        };
        let hasher = EpisodeHasher::new(
            value["simulation"].as_str().unwrap(),
            value["parameters"].as_object().unwrap(),
        );
        assert_eq!(
            hasher.hash(instance),
            vector["sha256"].as_str().unwrap(),
            "{}",
            vector["name"]
        );
    }
}

#[test]
fn topics_are_those_of_the_vectors() {
    let text = fs::read_to_string(vectors().join("topics.json")).unwrap();
    let vectors: Value = serde_json::from_str(&text).unwrap();
    for vector in vectors["names"].as_array().unwrap() {
        let topics = Topics::new(vector["prefix"].as_str().unwrap()).unwrap();
        let name = vector["topic"].as_str().unwrap();
        let meant = topic(vector["message"].as_str().unwrap());
        assert_eq!(topics.parse(name), Some(meant), "{name}");
        let server = || vector["server"].as_u64().unwrap();
        let written = match meant {
            Topic::Presence => topics.presence(server()),
            Topic::ToServer => topics.to_server(server()),
            Topic::ToTool => topics.to_tool(vector["token"].as_str().unwrap()),
            Topic::Status => topics.status(vector["token"].as_str().unwrap()),
            _ => topics.name(meant),
        };
        assert_eq!(written, name);
    }
    for vector in vectors["refused_prefixes"].as_array().unwrap() {
        assert!(
            Topics::new(vector["prefix"].as_str().unwrap()).is_err(),
            "{vector}"
        );
    }
    for vector in vectors["foreign"].as_array().unwrap() {
        let topics = Topics::new(vector["prefix"].as_str().unwrap()).unwrap();
        assert_eq!(
            topics.parse(vector["topic"].as_str().unwrap()),
            None,
            "{vector}"
        );
    }
}
