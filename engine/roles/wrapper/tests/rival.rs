//! Two servers with one id: one of them leaves, and each ignores messages meant for the other.
#![allow(clippy::unwrap_used, clippy::panic, reason = "a test")]

use crate::common;

use std::time::Duration;

use common::{ID, Server, batch, request};
use serde_json::{Value, json};
use swarmwright_protocol::{RefusalKind, State, ToServer, Topic, Topics};

const HASH: &str = "mine";
const LISTEN: Duration = Duration::from_millis(100);
const SETTLE: Duration = Duration::from_millis(150);

/// Returns the presence of another server with the id.
fn presence(instance: &str, state: &str) -> Vec<u8> {
    let announced = json!({"version": 1, "host": "far", "pid": 3, "instance": instance});
    json!({
        "version": 1, "server": ID, "state": state, "simulations": ["walk"], "since": "",
        "capabilities": {"dimensions": 2, "swarmwright": announced},
    })
    .to_string()
    .into_bytes()
}

fn control(instance: Option<&str>) -> Value {
    json!({"server": ID, "simulation_hash": HASH, "tool": "ada", "instance": instance})
}

impl Server {
    fn hears_of(&mut self, instance: &str, state: &str) {
        self.receive(&Topics::default().presence(ID), &presence(instance, state));
    }

    /// Receives presence as retained by the broker.
    fn finds(&mut self, instance: &str, state: &str) {
        let topic = Topics::default().presence(ID);
        self.machine
            .receive(&topic, &presence(instance, state), true, self.now);
        self.collect();
    }

    fn comes_back(&mut self) {
        self.machine.disconnected("gone", self.now);
        self.machine.connected(String::new(), self.now);
        self.collect();
        self.published.clear();
    }

    fn own_instance(&self) -> String {
        let presence = self.machine.presence(State::Ready, String::new());
        presence.capabilities.swarmwright.unwrap().instance.unwrap()
    }

    fn says(&mut self, topic: Topic) -> usize {
        let all = std::mem::take(&mut self.published);
        all.iter().filter(|(name, _)| *name == topic).count()
    }
}

#[test]
fn one_that_comes_back_listens_before_it_does_anything() {
    let mut server = Server::of_walks();
    server.comes_back();
    server.say(
        Topic::Parameters,
        &json!({"server": ID, "simulation_hash": HASH, "agents": 1}),
    );
    server.say(Topic::Control, &control(None));
    server.pass(LISTEN / 2);
    assert!(server.published.is_empty());
    server.pass(LISTEN / 2);
    assert!(server.says(Topic::Sensor) > 0, "what came meanwhile");
}

#[test]
fn one_that_comes_back_to_an_id_that_is_in_use_goes() {
    for other in ["!", "z"] {
        let mut server = Server::of_walks();
        server.comes_back();
        server.hears_of(other, "busy");
        let [rival] = &server.rivals[..] else {
            panic!("it is to go, whatever the instance of the other one is");
        };
        assert_eq!(rival.to_string(), "far, process 3");
    }
    let mut server = Server::of_walks();
    server.comes_back();
    let own = server.own_instance();
    server.hears_of(&own, "ready");
    server.hears_of("dead", "lost");
    assert!(server.rivals.is_empty());
}

#[test]
fn one_that_only_the_broker_remembers_is_asked_to_speak_up() {
    let returned = || {
        let mut server = Server::of_walks();
        server.comes_back();
        server.finds("!", "busy");
        server.finds("!", "busy");
        let [(Topic::Presence, payload)] = &server.published[..] else {
            panic!("it says once that it is lost: {:?}", server.published);
        };
        let said: Value = serde_json::from_slice(payload).unwrap();
        assert_eq!(said["state"], "lost");
        server.published.clear();
        assert!(server.rivals.is_empty());
        server.pass(LISTEN);
        assert!(server.published.is_empty());
        server
    };
    let mut server = returned();
    server.hears_of("!", "ready");
    assert_eq!(server.rivals.len(), 1);
    // A dead server, whose presence is only retained, does not contradict.
    let mut server = returned();
    server.pass(Duration::from_secs(1));
    assert!(server.rivals.is_empty());
    assert_eq!(server.says(Topic::Presence), 1);
}

#[test]
fn a_last_will_of_its_own_that_comes_late_is_contradicted() {
    let mut server = Server::of_walks();
    let own = server.own_instance();
    server.pass(SETTLE);
    for retained in [false, true] {
        server.published.clear();
        if retained {
            server.finds(&own, "lost");
        } else {
            server.hears_of(&own, "lost");
        }
        server.pass(Duration::ZERO);
        assert_eq!(server.says(Topic::Presence), 1);
    }
    server.hears_of(&own, "ready");
    server.pass(SETTLE);
    assert_eq!(server.says(Topic::Presence), 0, "its own words");
    server.comes_back();
    server.hears_of(&own, "lost");
    server.pass(LISTEN / 2);
    assert_eq!(server.says(Topic::Presence), 0, "it listens still");
}

#[test]
fn of_two_that_are_at_work_the_one_with_the_greater_instance_goes() {
    let mut server = Server::of_walks();
    server.machine.publish_presence(String::new());
    server.collect();
    server.published.clear();
    server.hears_of("z", "ready");
    assert!(server.rivals.is_empty() && server.warnings.len() == 1);
    server.pass(Duration::ZERO);
    assert_eq!(server.says(Topic::Presence), 1, "the other one hears of it");
    server.hears_of("!", "ready");
    assert!(server.rivals.is_empty(), "that may be an old message");
    server.hears_of("!", "lost");
    server.pass(LISTEN);
    assert!(server.rivals.is_empty());
    server.hears_of("!", "ready");
    server.pass(LISTEN);
    assert_eq!(server.rivals.len(), 1);
}

#[test]
fn where_no_two_can_have_one_id_nobody_is_listened_for() {
    let mut server = Server::of_walks();
    server.machine.set_alone();
    server.comes_back();
    server.hears_of("!", "ready");
    assert!(server.rivals.is_empty());
    assert!(server.answers(None));
}

#[test]
fn an_episode_for_another_start_of_the_server_does_not_begin() {
    let mut server = Server::of_walks();
    server.machine.publish_presence(String::new());
    server.say(
        Topic::Parameters,
        &json!({"server": ID, "simulation_hash": HASH, "agents": 1}),
    );
    server.pass(Duration::from_secs(6));
    server.collect();
    server.published.clear();
    server.say(Topic::Control, &control(Some("another")));
    assert_eq!(server.says(Topic::Sensor), 0);
    // If the other instance has ended, its tool must learn of this one.
    server.pass(SETTLE);
    assert_eq!(server.says(Topic::Presence), 1);
    let own = server.own_instance();
    server.say(Topic::Control, &control(Some(&own)));
    assert_eq!(server.says(Topic::Sensor), 1);
}

#[test]
fn a_request_for_another_start_of_the_server_is_not_served() {
    let mut server = Server::of_walks();
    let mut blocks = request(1);
    blocks.instance = Some("another".to_owned());
    let mut episodes = batch(2);
    episodes.instance = blocks.instance.clone();
    server.evaluate(blocks.clone());
    let refused = server.results()[0].error.clone().unwrap();
    assert_eq!(refused.kind, RefusalKind::Taken);
    server.ask(ToServer::Start(episodes.clone()));
    let refused = server.sensors()[0].error.clone().unwrap();
    assert_eq!(refused.kind, RefusalKind::Taken);
    assert!(server.jobs.is_empty() && server.machine.is_free());
    // A server that is taken, or does not offer the simulation, leaves the answer to the other one.
    server.replies.clear();
    let mut foreign = blocks.clone();
    foreign.simulation = "swim".to_owned();
    server.evaluate(foreign);
    blocks.instance = Some(server.own_instance());
    server.evaluate(blocks);
    server.ask(ToServer::Start(episodes));
    assert!(server.replies.is_empty());
    assert_eq!(server.jobs.len(), 1);
}
