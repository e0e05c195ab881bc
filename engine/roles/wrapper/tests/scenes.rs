//! Scenes are sent to a tool that requests them, before the first step and after each step, without other effects.
#![allow(clippy::unwrap_used, clippy::panic)] // helpers of tests

use crate::common;

use common::Server;
use serde_json::{Value, json};
use swarmwright_protocol::{F32s, SceneMessage, ToTool, Topic, U32s};
use swarmwright_worlds::{Body, Patch, Ray, Scale, Scene, Style, Wall, create};
use swarmwright_wrapper::scenes::{from_message, to_message};

const REPLY: &str = "swarmwright/v1/tool/ada1";

/// Plays an episode. Returns the scenes, and all other messages of the episode.
fn played(title: &str, parameters: &Value, control: Value) -> (Vec<SceneMessage>, Vec<Value>) {
    let mut simulation = create(title).unwrap();
    simulation.reset(parameters.as_object().unwrap()).unwrap();
    let actuators = vec![0.25; simulation.description().actuators];
    let mut server = Server::new(vec![create(title).unwrap()]);
    let mut message = parameters.clone();
    message["server"] = common::ID.into();
    message["simulation_hash"] = "h".into();
    server.say(Topic::Parameters, &message);
    let mut message = control;
    message["server"] = common::ID.into();
    message["simulation_hash"] = "h".into();
    server.say(Topic::Control, &message);
    let mut messages = Vec::new();
    for turn in 0.. {
        assert!(turn < 10_000, "the episode does not end");
        let came: Vec<(Topic, Value)> = (server.published.drain(..))
            .map(|(topic, payload)| (topic, serde_json::from_slice(&payload).unwrap()))
            .collect();
        let mut over = false;
        for (topic, message) in came {
            if topic == Topic::Sensor {
                let actuator = json!({"simulation_hash": "h", "agent": message["agent"], "actuator": actuators});
                server.receive(Topic::Actuator.name(), actuator.to_string().as_bytes());
            }
            over |= topic == Topic::Fitness;
            messages.push(message);
        }
        if over {
            break;
        }
        server.pass(std::time::Duration::ZERO);
    }
    let scenes = (server.replies.drain(..))
        .map(|(topic, message)| match message {
            ToTool::Scene(scene) if topic == REPLY => *scene,
            other => panic!("{topic}: {other:?}"),
        })
        .collect();
    (scenes, messages)
}

fn wanted(scenes: Value) -> Value {
    json!({"reply": REPLY, "tool": "ada", "scenes": scenes})
}

#[test]
fn the_scene_of_every_step_is_sent_and_the_episode_is_the_same() {
    let parameters =
        json!({"numAgents": 3, "numDefenders": 2, "maxSteps": 9, "placement": "random"});
    let (none, without) = played(
        "minisim",
        &parameters,
        json!({"reply": REPLY, "tool": "ada"}),
    );
    assert_eq!(none, []);
    let (scenes, with) = played("minisim", &parameters, wanted(json!([])));
    assert_eq!(with, without);
    let steps: Vec<u64> = scenes.iter().map(|scene| scene.step).collect();
    assert_eq!(steps, (0..scenes.len() as u64).collect::<Vec<_>>());
    assert!(scenes.len() > 2);
    let last = scenes.last().unwrap();
    assert_eq!(last.fitness, with.last().unwrap()["fitness"].as_f64());
    assert_eq!(json!(last.metrics), with.last().unwrap()["metrics"]);
    assert_eq!((last.server, &*last.simulation_hash), (common::ID, "h"));
    assert!(last.seconds.unwrap() > 0.0);
    assert_eq!(last.bodies.x.0.len(), 3 + 2 + 1);
    let first = &scenes[0].bodies.x.0;
    assert_ne!(first, &last.bodies.x.0, "they move");
}

#[test]
fn agents_that_steer_themselves_are_shown_too() {
    let parameters = json!({"maxSteps": 9, "steering": "rule"});
    let (scenes, said) = played("minisim", &parameters, wanted(json!(["rays"])));
    assert!(said.iter().all(|message| message.get("sensor").is_none()));
    assert!(scenes.len() > 2);
    assert_eq!(scenes.last().unwrap().step, scenes.len() as u64 - 1);
}

#[test]
fn agents_that_act_in_turn_are_shown_once_a_step() {
    let (scenes, said) = played("emergency_exit", &json!({"maxSteps": 4}), wanted(json!([])));
    let asked = said
        .iter()
        .filter(|message| message.get("sensor").is_some());
    assert!(asked.count() > 2 * scenes.len());
    assert_eq!(scenes.len() as u64, scenes.last().unwrap().step + 1);
}

#[test]
fn rays_and_links_are_sent_to_those_who_ask_for_them() {
    let parameters = json!({"mission": "aac", "robots": 5, "duration": 1});
    let bare = played("arena", &parameters, wanted(json!(["smell"]))).0;
    let full = played("arena", &parameters, wanted(json!(["rays", "links"]))).0;
    assert!(
        bare.iter()
            .all(|scene| scene.rays.is_none() && scene.links.is_none())
    );
    assert!(full.iter().all(|scene| scene.rays.is_some()));
    for (bare, full) in bare.iter().zip(full) {
        assert_eq!(bare.bodies, full.bodies);
        assert_eq!(full.bodies.radius.unwrap().0.len(), 1, "one number for all");
    }
}

#[test]
fn without_a_topic_of_a_tool_no_scene_is_sent() {
    for control in [
        json!({"scenes": []}),
        json!({"scenes": [], "reply": "sensor"}),
    ] {
        let (scenes, _) = played("minisim", &json!({"maxSteps": 2}), control);
        assert_eq!(scenes, []);
    }
}

#[test]
fn a_scene_becomes_a_message_and_the_same_scene() {
    let body = |kind: &'static str, x: f32| Body {
        kind: kind.into(),
        x,
        y: 0.5,
        ..Body::default()
    };
    let scene = Scene {
        width: 2.0,
        height: 1.0,
        origin: [-0.5, 7.0],
        grid: true,
        step: 3,
        message: "Hello".to_owned(),
        bodies: vec![
            body("goal", 1.0),
            Body {
                state: "free".into(),
                radius: 0.25,
                heading: Some(1.5),
                value: Some(-2.0),
                label: "first".into(),
                agent: Some(4),
                ..body("agent", 0.5)
            },
        ],
        floor: Some(Patch {
            grey: 0.5,
            ..Patch::default()
        }),
        patches: vec![Patch {
            points: vec![[0.0, 0.5]],
            radius: 1.0,
            grey: 1.0,
            name: "nest".to_owned(),
        }],
        walls: vec![Wall {
            points: vec![[0.0, 0.0], [1.0, 0.0]],
            solid: true,
        }],
        lights: Vec::new(),
        rays: vec![
            Ray {
                body: 1,
                angle: 0.5,
                start: 0.25,
                length: 1.0,
                reading: Some(0.5),
            },
            Ray {
                body: 1,
                ..Ray::default()
            },
        ],
        links: vec![[0, 1]],
        styles: vec![Style {
            kind: "goal".to_owned(),
            color: "#0072b2".to_owned(),
            ..Style::default()
        }],
        scale: Some(Scale {
            name: "charge".to_owned(),
            low: 0.0,
            high: 1.0,
        }),
    };
    let parts = ["rays".to_owned(), "links".to_owned()];
    let message = ToTool::Scene(Box::new(to_message(&scene, &parts))).encode();
    let ToTool::Scene(read) = ToTool::decode(&message).unwrap() else {
        panic!("another message");
    };
    assert_eq!(read.bodies.look, Some(U32s(vec![0, 1])));
    assert_eq!(read.bodies.radius, Some(F32s(vec![0.0, 0.25])));
    assert_eq!(from_message(*read), scene);
    let empty = Scene {
        width: 1.0,
        height: 1.0,
        ..Scene::default()
    };
    assert_eq!(from_message(to_message(&empty, &parts)), empty);
}

#[test]
fn texts_of_peers_are_short_and_plain() {
    let mut message = to_message(
        &Scene {
            width: 1.0,
            height: 1.0,
            ..Scene::default()
        },
        &[],
    );
    message.message = format!("\u{1b}[2J{}", "x".repeat(1000));
    assert_eq!(
        from_message(message).message,
        format!("[2J{}", "x".repeat(197))
    );
}
