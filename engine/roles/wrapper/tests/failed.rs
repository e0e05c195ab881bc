//! Failures of simulations reach the tool, and the server is usable afterwards.
#![allow(clippy::unwrap_used, clippy::panic)] // helpers of tests

use crate::common;

use std::time::Duration;

use common::{STEP_TIMEOUT, Server, batch, object, request};
use serde_json::{Value, json};
use swarmwright_protocol::{Failed, MOST_REASON, ToServer, ToTool, Topic, U64s};
use swarmwright_worlds::{Description, ParameterError, Parameters, Simulation};

const REPLY: &str = "swarmwright/v1/tool/ada1";

impl Server {
    /// Sends the messages that start an episode of the walk.
    fn start(&mut self, hash: &str, parameters: Value, control: Value) {
        let mut message = parameters;
        message["server"] = common::ID.into();
        message["simulation_hash"] = hash.into();
        self.say(Topic::Parameters, &message);
        let mut message = control;
        message["server"] = common::ID.into();
        message["simulation_hash"] = hash.into();
        self.say(Topic::Control, &message);
    }

    /// Answers sensors until the server sends none.
    fn walk(&mut self, hash: &str) {
        loop {
            let sensors: Vec<Value> = (self.published.drain(..))
                .filter(|(topic, _)| *topic == Topic::Sensor)
                .map(|(_, payload)| serde_json::from_slice(&payload).unwrap())
                .collect();
            if sensors.is_empty() {
                return;
            }
            for message in sensors {
                let actuator =
                    json!({"simulation_hash": hash, "agent": message["agent"], "actuator": [0.5]});
                self.receive(Topic::Actuator.name(), actuator.to_string().as_bytes());
                if self
                    .published
                    .iter()
                    .any(|(topic, _)| *topic == Topic::Fitness)
                {
                    return;
                }
            }
        }
    }

    /// Takes the report of a failure, which must be the only answer since the last call.
    fn failed(&mut self) -> Failed {
        let replies = std::mem::take(&mut self.replies);
        match &replies[..] {
            [(topic, ToTool::Failed(message))] if topic == REPLY => message.clone(),
            other => panic!("{other:?}"),
        }
    }
}

#[test]
fn an_episode_that_fails_is_reported_and_the_next_one_is_sound() {
    for (trouble, reason, stack) in [
        ("reset", "the simulation panicked: no start", None),
        (
            "sensor",
            "sensor 1 of agent 0 is NaN, not a finite number",
            None,
        ),
        ("panic", "the simulation panicked: a wall came down", None),
        ("fail", "no way on", Some("step\nwall")),
        (
            "fitness",
            "the simulation's fitness is NaN, not a finite number",
            None,
        ),
    ] {
        let mut server = Server::of_walks();
        let control = json!({"tool": "ada", "reply": REPLY});
        server.start("a", json!({"seed": 3, "trouble": trouble}), control.clone());
        server.walk("a");
        let message = server.failed();
        assert_eq!(
            (message.server, &*message.simulation_hash),
            (common::ID, "a")
        );
        assert_eq!(
            (&*message.reason, message.stack.as_deref()),
            (reason, stack)
        );
        assert!(!message.invalid);
        assert!(
            server.warnings.iter().any(|text| text.contains(reason)),
            "{:?}",
            server.warnings
        );
        // The server is held for its tool, as after any episode.
        assert!(
            server.answers(Some("ada")) && !server.answers(Some("bob")),
            "{trouble}"
        );
        server.start("b", json!({"seed": 4, "trouble": trouble}), control);
        server.walk("b");
        assert_eq!(
            server.published.last().unwrap().0,
            Topic::Fitness,
            "{trouble}"
        );
        assert!(server.replies.is_empty());
    }
}

#[test]
fn a_tool_that_does_not_say_where_hears_nothing_and_the_server_is_free() {
    for control in [json!({}), json!({"reply": "fitness"}), json!({"reply": 7})] {
        for parameters in [json!({"trouble": "reset"}), json!({"trouble": "panic"})] {
            let mut server = Server::of_walks();
            server.start("a", parameters, control.clone());
            server.walk("a");
            assert!(server.replies.is_empty(), "{:?}", server.replies);
            assert!(server.answers(None));
        }
    }
}

#[test]
fn parameters_that_are_refused_are_no_use_to_try_again() {
    let mut server = Server::of_walks();
    server.start("a", json!({"agents": "many"}), json!({"reply": REPLY}));
    let message = server.failed();
    assert!(message.invalid);
    assert!(message.reason.contains("agents"), "{}", message.reason);
    assert!(server.answers(None));
}

#[test]
fn a_run_that_is_given_up_is_reported() {
    let mut server = Server::of_walks();
    server.start("a", json!({}), json!({"tool": "ada", "reply": REPLY}));
    server.pass(STEP_TIMEOUT + Duration::from_secs(1));
    assert!(
        server
            .failed()
            .reason
            .contains("ada has not sent the actuators of agent 0")
    );
    assert!(server.answers(Some("bob")));
}

#[test]
fn a_simulation_that_takes_longer_than_the_step_timeout_is_not_given_up() {
    let mut server = Server::of_walks();
    server.start(
        "a",
        json!({"agents": 1}),
        json!({"tool": "ada", "reply": REPLY}),
    );
    for _ in 0..2 {
        server.took(2 * STEP_TIMEOUT);
        server.pass(Duration::ZERO);
        assert!(
            !server.answers(Some("bob")),
            "the tool could not answer yet"
        );
        server.say(
            Topic::Actuator,
            &json!({"simulation_hash": "a", "agent": 0, "actuator": [0.5]}),
        );
        assert!(
            server
                .published
                .iter()
                .any(|(topic, _)| *topic == Topic::Sensor)
        );
    }
    server.took(2 * STEP_TIMEOUT);
    server.pass(Duration::from_secs(59));
    assert!(server.replies.is_empty());
    server.pass(Duration::from_secs(1));
    assert!(server.failed().reason.ends_with("in step 2 for 60.0 s"));
}

#[test]
fn a_server_is_held_for_its_tool_after_a_long_step() {
    let mut server = Server::of_walks();
    server.start("a", json!({}), json!({"tool": "ada"}));
    server.walk("a");
    server.took(STEP_TIMEOUT);
    server.pass(Duration::from_secs(4));
    assert!(!server.answers(Some("bob")));
    server.pass(Duration::from_secs(1));
    assert!(server.answers(Some("bob")));
}

#[test]
fn a_stack_is_sent_once_for_a_reason() {
    let mut server = Server::of_walks();
    let mut message = request(1);
    message.parameters = object(json!({"trouble": "fail"}));
    message.seeds = U64s(vec![0, 1, 3, 6]);
    server.evaluate(message);
    server.compute();
    let failed = server.results().remove(0).failed;
    let places: Vec<_> = failed
        .iter()
        .map(|one| (one.candidate, one.episode))
        .collect();
    assert_eq!(places, [(0, 0), (0, 2), (0, 3), (1, 0), (1, 2), (1, 3)]);
    assert!(failed.iter().all(|one| one.reason == "no way on"));
    let stacks: Vec<_> = failed.iter().map(|one| one.stack.as_deref()).collect();
    assert_eq!(stacks, [Some("step\nwall"), None, None, None, None, None]);

    let mut message = batch(2);
    message.parameters = object(json!({"trouble": "fail"}));
    message.seeds = U64s(vec![0, 3]);
    server.ask(ToServer::Start(message));
    for step in 0..3 {
        server.actuators(2, step, vec![0.0; 4]);
    }
    let failed = server.sensors().pop().unwrap().failed;
    let stacks: Vec<_> = failed.iter().map(|one| one.stack.as_deref()).collect();
    assert_eq!(stacks, [Some("step\nwall"), None]);
}

/// A simulation that fails with a very long reason.
struct Talker;

impl Simulation for Talker {
    fn description(&self) -> Description {
        common::Walk::default().description()
    }

    fn reset(&mut self, _: &Parameters) -> Result<(), ParameterError> {
        panic!("{}", "\u{e4}".repeat(1 << 20));
    }

    fn acting(&self) -> &[u32] {
        &[]
    }

    fn sense(&self, _: u32, _: &mut [f32]) {}

    fn step(&mut self, _: &[f32]) {}

    fn fitness(&self) -> f64 {
        0.0
    }
}

#[test]
fn a_long_reason_is_cut() {
    let mut server = Server::new(vec![Box::new(Talker)]);
    server.start("a", json!({}), json!({"reply": REPLY}));
    let reason = server.failed().reason;
    assert_eq!(reason.chars().count(), MOST_REASON);
    assert!(reason.ends_with("\u{e4}..."));
}
