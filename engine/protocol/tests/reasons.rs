//! Reasons for which messages are refused: they say in which field, and what was expected.
#![allow(clippy::unwrap_used, reason = "a test")]

use serde_json::{Value, json};
use swarmwright_protocol::{Message, SensorReading, ToServer, ToTool, Topic};

fn json_reason(topic: Topic, message: &Value) -> String {
    let payload = message.to_string().into_bytes();
    let reason = Message::decode(topic, &payload).unwrap_err().to_string();
    if topic == Topic::Sensor {
        // There are two ways to read one.
        let other = SensorReading::decode(&payload).unwrap_err();
        assert_eq!(other.to_string(), reason);
    }
    reason
}

#[test]
fn reasons_name_the_field_of_json_messages() {
    let server = |key: &str, value: Value| {
        let mut message = json!({"server": 1, "simulation_hash": "00", "simulations": ["line"],
            "capabilities": {"dimensions": 2}});
        match key {
            "" => message["capabilities"] = value,
            key => message[key] = value,
        }
        message
    };
    let presence = json!({"version": 1, "server": 1, "state": "asleep", "simulations": ["line"],
        "capabilities": {"dimensions": 2}, "since": "x"});
    let status = json!({"version": 1, "tool": "a", "state": "looking", "simulation": "line", "done": 0, "total": 1,
        "waiting_for": [], "servers": [{"server": 1, "mode": "stepwise", "failures": 0, "speed": -1.5}]});
    let sensor = |agent: Value, sensor: Value| json!({"simulation_hash": "00", "agent": agent, "sensor": sensor});
    for (topic, message, parts) in [
        (
            Topic::Server,
            server("simulations", json!(["line", 3])),
            ["\"simulations[1]\": ", "expected a string"],
        ),
        (
            Topic::Server,
            server("", json!({"dimensions": "2"})),
            ["\"capabilities.dimensions\": ", "expected a number"],
        ),
        (
            Topic::Server,
            server("", json!({})),
            ["required key \"capabilities.dimensions\"", "missing"],
        ),
        (
            Topic::Server,
            server("server", json!(-1)),
            ["\"server\": ", "expected an integer from 0"],
        ),
        (
            Topic::Discovery,
            json!({"simulation": "line", "simulation_hash": "00", "requirements": {}}),
            ["required key \"requirements.dimensions\"", "missing"],
        ),
        (
            Topic::Presence,
            presence,
            ["\"state\": ", "expected one of \"ready\""],
        ),
        (
            Topic::Status,
            status,
            ["\"servers[0].speed\" is -1.5", "expected 0 or more"],
        ),
        (
            Topic::Sensor,
            sensor(json!(0), json!([1, "x"])),
            ["\"sensor[1]\": ", "expected a number"],
        ),
        (
            Topic::Sensor,
            sensor(json!(1.5), json!([1])),
            ["\"agent\": ", "expected an integer from 0"],
        ),
        (
            Topic::Sensor,
            sensor(json!(0), json!([])),
            ["\"sensor\"", "is empty"],
        ),
        (
            Topic::Fitness,
            json!({"simulation_hash": "00", "fitness": null}),
            ["\"fitness\": ", "expected a number"],
        ),
    ] {
        let reason = json_reason(topic, &message);
        for part in parts {
            assert!(reason.contains(part), "{topic:?}: {reason}");
        }
    }
}

#[test]
fn reasons_name_the_field_of_messages_of_numbers() {
    let packed = |value: &Value| rmp_serde::to_vec_named(value).unwrap();
    let evaluate = json!({"kind": "evaluate", "version": 1, "request": 1, "tool": "a", "reply": "b", "simulation": "line",
        "parameters": {}, "controller": {}, "genomes": "no binary", "seeds": "", "attempt": 1, "lease": 0.0});
    let reason = ToServer::decode(&packed(&evaluate))
        .unwrap_err()
        .to_string();
    assert!(reason.contains("\"genomes\": "), "{reason}");
    let failed = json!({"candidate": 0, "episode": "first", "reason": "x"});
    let evaluated = json!({"kind": "evaluated", "version": 1, "request": 1, "server": 1, "seconds": 0.5,
        "failed": [failed]});
    let reason = ToTool::decode(&packed(&evaluated)).unwrap_err().to_string();
    assert!(
        reason.contains("\"failed[0].episode\": ")
            && reason.contains("expected the type of evaluated.schema.json"),
        "{reason}"
    );
}

#[test]
fn what_a_peer_sends_as_a_key_is_told_in_part() {
    let mut message = json!({"version": 1, "server": 1, "state": "ready", "simulations": ["line"], "capabilities": {},
        "since": "x"});
    message["x".repeat(100_000)] = 1.into();
    let reason = json_reason(Topic::Presence, &message);
    assert!(reason.chars().count() <= 400, "{reason}");
}
