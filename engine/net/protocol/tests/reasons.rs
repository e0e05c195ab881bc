//! Reasons why messages are refused: they name the field, and what was expected.
#![allow(clippy::panic, clippy::unwrap_used, reason = "a test")]

use serde_json::{Value, json};
use swarmwright_protocol::{
    Announcement, Fitness, Message, SensorReading, ToServer, ToTool, Topic,
};

fn json_reason(topic: Topic, message: &Value) -> String {
    let payload = message.to_string().into_bytes();
    let reason = Message::decode(topic, &payload).unwrap_err().to_string();
    if topic == Topic::Sensor {
        // There are two decoders of sensor messages.
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
fn reasons_have_the_same_words_for_every_topic() {
    for topic in [
        Topic::Discovery,
        Topic::Server,
        Topic::Parameters,
        Topic::Control,
        Topic::Sensor,
        Topic::Fitness,
        Topic::Presence,
        Topic::Status,
    ] {
        for (message, found) in [
            (json!([]), "a list"),
            (json!(91), "91"),
            (json!(null), "null"),
        ] {
            let error = Message::decode(topic, message.to_string().as_bytes()).unwrap_err();
            let reason = error.to_string();
            let expected = format!("{found} found, expected an object, at line 1");
            assert!(reason.starts_with(&expected), "{topic:?}: {reason}");
            assert_eq!(error.key(), "");
        }
    }
    let presence = json!({"version": 1, "server": 1, "state": {}, "simulations": ["line"],
        "capabilities": {"dimensions": 2}, "since": "x"});
    let reason = json_reason(Topic::Presence, &presence);
    assert!(
        reason.ends_with("\"state\": an object found, expected a string"),
        "{reason}"
    );
}

#[test]
fn errors_say_which_key_is_wrong_wherever_in_a_list() {
    let sensor = |message: Value| {
        let error = Message::decode(Topic::Sensor, message.to_string().as_bytes()).unwrap_err();
        error.key().to_owned()
    };
    assert_eq!(sensor(json!({"agent": "x"})), "agent");
    assert_eq!(sensor(json!({"agent": 0})), "simulation_hash");
    for at in 0..3 {
        let mut numbers = json!([1, 2, 3]);
        numbers[at] = json!("x");
        assert_eq!(sensor(json!({"sensor": numbers})), "sensor");
    }
}

#[test]
fn what_is_announced_in_a_wrong_type_is_named() {
    let announced = |key: &str, value: Value| {
        let mut announcement = json!({"version": 1, "modes": ["stepwise"], "sensors": 2.0, "scenes": true, "later": []});
        announcement[key] = value;
        let message = json!({"server": 1, "simulation_hash": "00", "simulations": ["line"],
            "capabilities": {"dimensions": 2, "swarmwright": announcement}});
        Announcement::mistakes(message.to_string().as_bytes())
    };
    assert_eq!(announced("actuators", json!(1)), Vec::<String>::new());
    for (key, value, words) in [
        (
            "sensors",
            json!("2"),
            "\"sensors\" is \"2\" (a string), expected an integer from 1",
        ),
        (
            "batch",
            json!(0),
            "\"batch\" is 0, expected an integer from 1",
        ),
        (
            "modes",
            json!("batched"),
            "\"modes\" is \"batched\" (a string), expected a list of names",
        ),
        (
            "scenes",
            json!(1),
            "\"scenes\" is 1, expected true or false",
        ),
        (
            "sides",
            json!([{"name": "prey", "groups": "prey"}]),
            "\"sides\" is [{\"groups\":\"prey\",\"name\":\"prey\"}], expected a list of at most 256 sides, each {name, groups, \
             fitness}, with names of 1 to 100 characters and each group in one side",
        ),
    ] {
        assert_eq!(announced(key, value), [words]);
    }
    assert!(Announcement::mistakes(b"[]").is_empty());
}

#[test]
fn why_a_metric_cannot_be_used_is_known_afterwards() {
    let wrong = |metrics: Value| {
        let message = json!({"simulation_hash": "00", "fitness": 1, "metrics": metrics});
        let payload = message.to_string().into_bytes();
        assert!(
            Fitness::decode(&payload).unwrap().metrics.get("spread")
                == metrics["spread"].as_f64().as_ref()
        );
        Fitness::wrong_metric(&payload, "spread")
    };
    assert_eq!(wrong(json!({"spread": 3})), None);
    assert_eq!(wrong(json!({"other": "3"})), None);
    let words = "\"metrics.spread\": \"3\" (a string) found, expected a number";
    assert_eq!(wrong(json!({"spread": "3"})).as_deref(), Some(words));
    let words = "\"metrics\": a list found, expected an object";
    assert_eq!(wrong(json!([3])).as_deref(), Some(words));
}

#[test]
fn presence_says_where_a_server_runs_at_either_place() {
    let read = |outer: Value, inner: Value| {
        let mut message = json!({"version": 1, "server": 1, "state": "ready", "simulations": ["line"], "since": "x",
            "capabilities": {"dimensions": 2, "swarmwright": {"version": 1, "modes": []}}});
        for (key, value) in outer.as_object().unwrap() {
            message[key] = value.clone();
        }
        for (key, value) in inner.as_object().unwrap() {
            message["capabilities"]["swarmwright"][key] = value.clone();
        }
        match Message::decode(Topic::Presence, message.to_string().as_bytes()) {
            Ok(Message::Presence(presence)) => presence.capabilities.swarmwright.unwrap(),
            other => panic!("{other:?}"),
        }
    };
    let where_it_runs = json!({"host": "lab", "pid": 7, "instance": "a1"});
    let outer = read(where_it_runs.clone(), json!({}));
    assert_eq!(outer, read(json!({}), where_it_runs));
    assert_eq!((outer.host.as_deref(), outer.pid), (Some("lab"), Some(7)));
    let both = read(json!({"pid": 7, "instance": "a1"}), json!({"pid": 8}));
    assert_eq!((both.pid, both.instance.as_deref()), (Some(8), Some("a1")));
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
        reason.ends_with("\"failed[0].episode\": \"first\" (a string) found, expected a whole number of at least 0"),
        "{reason}"
    );
    let reason = ToTool::decode(&packed(&json!([evaluated]))).unwrap_err();
    let expected = "a list found, expected an object";
    assert!(reason.to_string().ends_with(expected), "{reason}");
    let whole = packed(&evaluated);
    let reason = ToTool::decode(&whole[..whole.len() - 1]).unwrap_err();
    let expected = "the message ends too early";
    assert!(reason.to_string().ends_with(expected), "{reason}");
}

#[test]
fn what_a_peer_sends_as_a_key_is_told_in_part() {
    let mut message = json!({"version": 1, "server": 1, "state": "ready", "simulations": ["line"], "capabilities": {},
        "since": "x"});
    message["x".repeat(100_000)] = 1.into();
    let reason = json_reason(Topic::Presence, &message);
    assert!(reason.chars().count() <= 400, "{reason}");
}
