//! Reservation of a server: tools with and without a name that want it at the same time, and messages that overtake
//! others.
#![allow(clippy::unwrap_used, clippy::panic, reason = "a test")]

use crate::common;

use std::time::Duration;

use common::{ID, Server, Walk, request};
use serde_json::{Value, json};
use swarmwright_protocol::{Evaluate, Message, ToTool, Topic, Topics};

const SECOND: Duration = Duration::from_secs(1);
const HASH: &str = "plain";

fn control(hash: &str, tool: Option<&str>) -> Value {
    let mut message = json!({"server": ID, "simulation_hash": hash, "run": true});
    if let Some(tool) = tool {
        message["tool"] = tool.into();
    }
    message
}

fn parameters(hash: &str) -> Value {
    json!({"server": ID, "simulation_hash": hash, "agents": 1})
}

fn discovery(hash: &str) -> Value {
    json!({"simulation": "walk", "simulation_hash": hash, "requirements": {"dimensions": 2}})
}

fn evaluate(number: u64, tool: &str) -> Evaluate {
    Evaluate {
        tool: tool.to_owned(),
        ..request(number)
    }
}

impl Server {
    /// Returns the number of messages on a topic that the server published since the last call.
    fn said(&mut self, topic: Topic) -> usize {
        let all = std::mem::take(&mut self.published);
        all.iter().filter(|(name, _)| *name == topic).count()
    }

    /// Returns the hashes of its answers to discoveries since the last call.
    fn answered(&mut self) -> Vec<String> {
        let all = std::mem::take(&mut self.published);
        let hash = |(topic, payload): (Topic, Vec<u8>)| match Message::decode(topic, &payload) {
            Ok(Message::Server(answer)) => Some(answer.simulation_hash),
            _ => None,
        };
        all.into_iter().filter_map(hash).collect()
    }

    /// Evaluates short requests of a tool with a name for some time, one after another. Returns the number of served
    /// requests.
    fn busy_for(&mut self, tool: &str, time: Duration) -> usize {
        let end = self.now + time;
        let mut served = 0;
        while self.now < end {
            self.requests += 1;
            self.evaluate(evaluate(self.requests, tool));
            self.pass(Duration::from_millis(20));
            self.compute();
            let results = self.results();
            served += results
                .iter()
                .filter(|result| result.error.is_none())
                .count();
        }
        served
    }

    /// Runs an episode of a tool without a name, from parameters to fitness.
    fn plain_episode(&mut self, hash: &str) -> bool {
        self.say(Topic::Parameters, &parameters(hash));
        self.say(Topic::Control, &control(hash, None));
        if self.said(Topic::Sensor) == 0 {
            return false;
        }
        let actuator = json!({"simulation_hash": hash, "agent": 0, "actuator": [0.5]});
        for _ in 0..4 {
            self.pass(Duration::from_millis(1));
            self.say(Topic::Actuator, &actuator);
        }
        self.said(Topic::Fitness) == 1
    }
}

#[test]
fn a_tool_without_a_name_that_asks_once_has_its_turn() {
    let mut server = Server::of_walks();
    assert!(server.busy_for("ada", SECOND) > 40);
    server.say(Topic::Discovery, &discovery(HASH));
    assert_eq!(server.answered(), Vec::<String>::new());
    server.busy_for("ada", 3 * SECOND);
    assert_eq!(server.answered(), Vec::<String>::new(), "ada's turn");
    server.busy_for("ada", 3 * SECOND / 2);
    assert_eq!(server.answered(), [HASH]);
    // The server waits only for the tool that was answered.
    assert_eq!(server.busy_for("ada", SECOND / 4), 0);
    assert!(server.plain_episode(HASH) && server.plain_episode("its next"));
    assert!(!server.answers(Some("ada")));
    assert!(server.answers(None));
    server.pass(SECOND + SECOND / 10);
    assert!(server.answers(Some("ada")), "free for all again");
    assert!(server.busy_for("ada", SECOND) > 40);
}

#[test]
fn the_turn_of_a_tool_without_a_name_ends() {
    let mut server = Server::of_walks();
    server.busy_for("ada", SECOND);
    server.say(Topic::Discovery, &discovery(HASH));
    server.busy_for("ada", 9 * SECOND / 2);
    let mut episodes = 0;
    for number in 0..1000 {
        if !server.plain_episode(&number.to_string()) {
            break;
        }
        episodes += 1;
        server.pass(Duration::from_millis(96));
        if server.answers(Some("ada")) {
            break;
        }
    }
    assert!(
        (45..=55).contains(&episodes),
        "{episodes} episodes of 0.1 s"
    );
}

#[test]
fn servers_wait_no_longer_for_a_tool_that_has_chosen_another() {
    for answered in [false, true] {
        let mut server = Server::of_walks();
        server.busy_for("ada", SECOND);
        server.say(Topic::Discovery, &discovery(HASH));
        server.busy_for("ada", if answered { 9 * SECOND / 2 } else { SECOND });
        let other = json!({"server": ID + 1, "simulation_hash": HASH});
        server.say(Topic::Parameters, &other);
        assert!(server.busy_for("ada", SECOND) > 40, "{answered}");
        server.busy_for("ada", 6 * SECOND);
        assert_eq!(server.answered().len(), usize::from(answered));
    }
}

#[test]
fn an_answer_that_nobody_takes_up_keeps_a_server_for_a_second() {
    let mut server = Server::of_walks();
    server.busy_for("ada", SECOND);
    server.say(Topic::Discovery, &discovery(HASH));
    let served = server.busy_for("ada", 9 * SECOND);
    assert!((8 * 45..8 * 50 + 10).contains(&served), "{served}");
}

#[test]
fn a_control_message_waits_for_its_parameters() {
    let mut server = Server::of_walks();
    for tool in [None, Some("ada")] {
        let hash = format!("{tool:?}");
        server.say(Topic::Control, &control(&hash, tool));
        server.pass(SECOND / 2);
        assert_eq!(server.said(Topic::Sensor), 0);
        server.say(Topic::Parameters, &parameters(&hash));
        assert_eq!(server.said(Topic::Sensor), 1, "{hash}");
        server.say(Topic::Control, &ends(&hash, tool));
        assert!(server.machine.is_free() && server.warnings.is_empty());
    }
}

#[test]
fn a_control_message_whose_parameters_do_not_come_is_refused_and_one_that_was_ended_forgotten() {
    let mut server = Server::of_walks();
    server.say(Topic::Control, &control("late", None));
    let tick = server.machine.next_tick().unwrap();
    assert!(tick <= server.now + SECOND);
    server.pass(SECOND);
    assert!(
        server.warnings[0].contains("no parameters arrived for its hash"),
        "{:?}",
        server.warnings
    );
    server.say(Topic::Parameters, &parameters("late"));
    server.say(Topic::Control, &control("ended", None));
    let end = json!({"server": ID, "simulation_hash": "ended", "run": false});
    server.say(Topic::Control, &end);
    server.say(Topic::Parameters, &parameters("ended"));
    assert_eq!(server.said(Topic::Sensor), 0);
}

#[test]
fn a_control_message_that_waits_does_not_take_the_server_from_a_tool_that_is_complete() {
    let mut server = Server::of_walks();
    server.say(Topic::Control, &control("early", None));
    assert!(server.answers(None));
    server.say(Topic::Parameters, &parameters("other"));
    server.say(Topic::Control, &control("other", None));
    assert_eq!(server.said(Topic::Sensor), 1);
    server.say(Topic::Parameters, &parameters("early"));
    assert_eq!(server.said(Topic::Sensor), 0);
    assert!(
        server.warnings[0].contains("taken by"),
        "{:?}",
        server.warnings
    );
}

#[test]
fn what_the_broker_does_not_take_ends_the_run_and_its_tool_is_told() {
    let mut server = Server::new(vec![Walk::duplicable()]);
    server.say(Topic::Parameters, &parameters(HASH));
    let mut start = control(HASH, Some("ada"));
    start["reply"] = "swarmwright/v1/tool/ada1".into();
    server.say(Topic::Control, &start);
    server
        .machine
        .unsent(Topic::Sensor, 1_900_000, 20_000, server.now);
    server.collect();
    let [(_, ToTool::Failed(failed))] = &server.replies[..] else {
        panic!("{:?}", server.replies);
    };
    assert!(failed.invalid);
    assert_eq!(
        failed.reason,
        "a sensor message of 1900000 bytes is larger than the 20000 that the broker accepts"
    );
}

#[test]
fn control_is_heard_on_the_own_topic_and_on_that_of_all() {
    let topics = Topics::default();
    let [own, all, others] = [
        topics.to_server(ID),
        topics.name(Topic::Control),
        topics.to_server(ID + 1),
    ];
    for (first, second) in [(&own, &own), (&own, &all), (&all, &own)] {
        let mut server = Server::of_walks();
        let starts = control(HASH, Some("ada")).to_string().into_bytes();
        let ends = ends(HASH, Some("ada")).to_string().into_bytes();
        server.say(Topic::Parameters, &parameters(HASH));
        server.receive(&others, &starts);
        assert_eq!(server.said(Topic::Sensor), 0);
        server.receive(first, &starts);
        assert_eq!(server.said(Topic::Sensor), 1, "{first}");
        server.receive(&others, &ends);
        assert!(!server.machine.is_free());
        server.receive(second, &ends);
        assert!(server.machine.is_free(), "{second}");
        assert_eq!(server.warnings, Vec::<String>::new());
    }
    let mut server = Server::of_walks();
    server.receive(&own, br#" {"server": 7}"#);
    let told = r#"refusing a message on swarmwright/v1/server: the required key "simulation_hash" is missing"#;
    assert_eq!(server.warnings, [told]);
}

fn ends(hash: &str, tool: Option<&str>) -> Value {
    let mut message = control(hash, tool);
    message["run"] = false.into();
    message
}

#[test]
fn nobody_elses_control_ends_an_episode() {
    for tool in [None, Some("ada")] {
        let others = [None, Some("ada"), Some("eve")].map(|other| (other, other == tool));
        for (other, own) in others {
            let mut server = Server::of_walks();
            server.say(Topic::Parameters, &parameters(HASH));
            server.say(Topic::Control, &control(HASH, tool));
            server.say(Topic::Control, &ends(HASH, other));
            assert_eq!(
                server.machine.is_free(),
                own,
                "{tool:?}'s, ended by {other:?}"
            );
            assert_eq!(server.warnings.is_empty(), own);
        }
    }
}

#[test]
fn nobody_elses_control_gives_a_server_back_that_is_held() {
    let mut server = Server::of_walks();
    assert!(server.busy_for("ada", SECOND) > 0);
    server.say(Topic::Parameters, &parameters(HASH));
    for other in [None, Some("eve")] {
        server.say(Topic::Control, &ends(HASH, other));
        assert!(!server.answers(Some("eve")));
    }
    server.say(Topic::Control, &ends("any", Some("ada")));
    assert!(server.answers(Some("eve")));
}

#[test]
fn nobody_elses_control_ends_what_waits_for_its_parameters() {
    let mut server = Server::of_walks();
    server.say(Topic::Control, &control(HASH, Some("ada")));
    server.say(Topic::Control, &ends(HASH, None));
    server.say(Topic::Control, &ends(HASH, Some("eve")));
    server.say(Topic::Control, &control(HASH, Some("eve")));
    server.say(Topic::Parameters, &parameters(HASH));
    assert_eq!(server.machine.holder().as_deref(), Some("ada"));
}

#[test]
fn an_episode_of_what_is_not_offered_does_not_begin() {
    let mut server = Server::of_walks();
    server.say(Topic::Parameters, &parameters(HASH));
    let mut wrong = control(HASH, Some("ada"));
    wrong["simulation"] = "swim".into();
    server.say(Topic::Control, &wrong);
    assert_eq!(server.said(Topic::Sensor), 0);
    assert!(server.replies.is_empty(), "it does not say where to");
    wrong["reply"] = "swarmwright/v1/tool/ada1".into();
    server.say(Topic::Control, &wrong);
    let [(_, ToTool::Failed(failed))] = &server.replies[..] else {
        panic!("{:?}", server.replies);
    };
    assert!(failed.invalid && failed.simulation_hash == HASH);
    assert_eq!(
        failed.reason,
        "simulation: \"swim\" is not offered here, only walk"
    );
    // A control message without a title means the only simulation.
    server.say(Topic::Control, &control(HASH, Some("ada")));
    assert_eq!(server.said(Topic::Sensor), 1);
}
