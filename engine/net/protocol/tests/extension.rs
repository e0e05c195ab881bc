//! Replays the golden vectors of the extension messages (`protocol/vectors/extension.json`).
#![allow(clippy::unwrap_used, clippy::panic)] // helpers of tests

use std::collections::BTreeMap;
use std::fs;
use std::path::PathBuf;

use base64::Engine;
use serde_json::{Value, json};
use swarmwright_protocol::{
    F64s, Failure, Refusal, RefusalKind, SceneMessage, ToServer, ToTool, shortened,
};

fn vectors() -> Vec<Value> {
    let path = "../../../protocol/vectors/extension.json";
    let text = fs::read_to_string(PathBuf::from(env!("CARGO_MANIFEST_DIR")).join(path)).unwrap();
    serde_json::from_str(&text).unwrap()
}

fn bytes(vector: &Value) -> Vec<u8> {
    base64::engine::general_purpose::STANDARD
        .decode(vector["bytes"].as_str().unwrap())
        .unwrap()
}

fn f32s(numbers: &[f32]) -> Vec<String> {
    numbers
        .iter()
        .map(|n| format!("{:08x}", n.to_bits()))
        .collect()
}

fn f64s(numbers: &[f64]) -> Vec<String> {
    numbers
        .iter()
        .map(|n| format!("{:016x}", n.to_bits()))
        .collect()
}

fn u32s(numbers: &[u32]) -> Vec<String> {
    numbers.iter().map(|n| format!("{n:08x}")).collect()
}

fn u64s(numbers: &[u64]) -> Vec<String> {
    numbers.iter().map(|n| format!("{n:016x}")).collect()
}

fn failures(failed: &[Failure]) -> Value {
    let object = |f: &Failure| json!({"candidate": f.candidate, "episode": f.episode, "reason": f.reason, "stack": f.stack});
    failed.iter().map(object).collect()
}

fn refusal(error: Option<&Refusal>) -> Value {
    let Some(Refusal { kind, reason }) = error else {
        return Value::Null;
    };
    let kind = match kind {
        RefusalKind::Taken => "taken",
        RefusalKind::Invalid => "invalid",
        RefusalKind::Failed => "failed",
    };
    json!({"kind": kind, "reason": reason})
}

fn request(message: &ToServer) -> Value {
    match message {
        ToServer::Evaluate(m) => json!({
            "kind": "evaluate", "version": m.version, "request": m.request, "tool": m.tool, "reply": m.reply,
            "simulation": m.simulation, "parameters": m.parameters, "controller": m.controller,
            "genomes": f32s(&m.genomes.0), "seeds": u64s(&m.seeds.0), "metrics": m.metrics,
            "attempt": m.attempt, "lease": m.lease, "instance": m.instance,
        }),
        ToServer::Start(m) => json!({
            "kind": "start", "version": m.version, "request": m.request, "tool": m.tool, "reply": m.reply,
            "simulation": m.simulation, "parameters": m.parameters, "seeds": u64s(&m.seeds.0),
            "metrics": m.metrics, "instance": m.instance,
        }),
        ToServer::Actuators(m) => json!({
            "kind": "actuators", "version": m.version, "request": m.request, "step": m.step,
            "actuators": f32s(&m.actuators.0),
        }),
    }
}

fn metrics(metrics: &BTreeMap<String, F64s>) -> Value {
    let read = |(name, values): (&String, &F64s)| (name.clone(), json!(f64s(&values.0)));
    metrics.iter().map(read).collect()
}

/// Converts a scene, with arrays of numbers by their bits, and without omitted fields.
fn scene(m: &SceneMessage) -> Value {
    let b = &m.bodies;
    let mut bodies =
        json!({"looks": b.looks, "x": f32s(&b.x.0), "y": f32s(&b.y.0), "labels": b.labels});
    for (name, numbers) in [
        ("radius", &b.radius),
        ("heading", &b.heading),
        ("value", &b.value),
    ] {
        bodies[name] = numbers
            .as_ref()
            .map_or(Value::Null, |numbers| json!(f32s(&numbers.0)));
    }
    for (name, numbers) in [("look", &b.look), ("agent", &b.agent)] {
        bodies[name] = numbers
            .as_ref()
            .map_or(Value::Null, |numbers| json!(u32s(&numbers.0)));
    }
    let rays = m.rays.as_ref().map(|r| {
        json!({"body": u32s(&r.body.0), "angle": f32s(&r.angle.0), "start": f32s(&r.start.0),
            "length": f32s(&r.length.0), "reading": r.reading.as_ref().map(|reading| f32s(&reading.0))})
    });
    json!({
        "kind": "scene", "version": m.version, "server": m.server, "simulation_hash": m.simulation_hash,
        "step": m.step, "fitness": m.fitness, "metrics": m.metrics, "seconds": m.seconds,
        "width": m.width, "height": m.height, "grid": m.grid, "message": m.message, "bodies": bodies,
        "rays": rays, "links": m.links.as_ref().map(|links| u32s(&links.0)), "floor": m.floor,
        "patches": m.patches, "walls": m.walls, "lights": m.lights, "styles": m.styles, "scale": m.scale,
    })
}

fn answer(message: &ToTool) -> Value {
    match message {
        ToTool::Scene(m) => scene(m),
        ToTool::Evaluated(m) => json!({
            "kind": "evaluated", "version": m.version, "request": m.request, "server": m.server,
            "fitness": f64s(&m.fitness.0), "metrics": metrics(&m.metrics), "failed": failures(&m.failed),
            "error": refusal(m.error.as_ref()), "seconds": m.seconds,
        }),
        ToTool::Sensors(m) => json!({
            "kind": "sensors", "version": m.version, "request": m.request, "server": m.server, "step": m.step,
            "episodes": u32s(&m.episodes.0), "agents": u32s(&m.agents.0), "sensors": f32s(&m.sensors.0),
            "ended": u32s(&m.ended.0), "fitness": f64s(&m.fitness.0), "metrics": metrics(&m.metrics),
            "failed": failures(&m.failed), "error": refusal(m.error.as_ref()),
        }),
        ToTool::Failed(m) => json!({
            "kind": "failed", "version": m.version, "server": m.server, "simulation_hash": m.simulation_hash,
            "reason": m.reason, "stack": m.stack, "invalid": m.invalid,
        }),
    }
}

/// Decodes a payload and encodes it again; `None` if it is refused.
fn read(topic: &str, payload: &[u8]) -> Option<(Value, Vec<u8>)> {
    match topic {
        "to_server" => {
            let message = ToServer::decode(payload).ok()?;
            Some((request(&message), message.encode()))
        }
        "to_tool" => {
            let message = ToTool::decode(payload).ok()?;
            Some((answer(&message), message.encode()))
        }
        other => panic!("{other}"),
    }
}

/// Compares as JSON: 60 and 60.0 are the same number.
fn same(left: &Value, right: &Value) -> bool {
    match (left, right) {
        (Value::Number(a), Value::Number(b)) => {
            (a.is_u64() && a == b) || (!(a.is_u64() && b.is_u64()) && a.as_f64() == b.as_f64())
        }
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
fn messages_are_accepted_or_refused_and_read_as_the_vectors_say() {
    let vectors = vectors();
    assert!(vectors.len() >= 70, "{}", vectors.len());
    for vector in vectors {
        let found = read(vector["topic"].as_str().unwrap(), &bytes(&vector));
        assert_eq!(
            found.is_some(),
            vector["accept"] == true,
            "{}: {found:?}",
            vector["name"]
        );
        if let Some((reading, _)) = found {
            assert!(
                same(&reading, &vector["reading"]),
                "{}: {reading}",
                vector["name"]
            );
        }
    }
}

#[test]
fn what_is_written_is_the_canonical_form_and_reads_back_the_same() {
    for vector in vectors().iter().filter(|vector| vector["accept"] == true) {
        let topic = vector["topic"].as_str().unwrap();
        let (reading, written) = read(topic, &bytes(vector)).unwrap();
        if vector["canonical"] == true {
            assert_eq!(written, bytes(vector), "{}", vector["name"]);
        }
        assert_eq!(
            read(topic, &written).unwrap().0,
            reading,
            "{}",
            vector["name"]
        );
    }
}

#[test]
fn long_texts_are_cut_between_characters() {
    assert_eq!(shortened("short".to_owned(), 5), "short");
    assert_eq!(shortened("\u{fc}ber Stock".to_owned(), 8), "\u{fc}ber ...");
    assert_eq!(shortened("\u{1f600}".repeat(9), 9).chars().count(), 9);
    assert_eq!(shortened("\u{1f600}".repeat(10), 9).chars().count(), 9);
}
