//! Topics of control messages.
#![allow(clippy::unwrap_used, clippy::panic, reason = "a test")]

use crate::common;

use common::{Alone, CANDIDATES, Line, Net, Party, SEEDS, begin, server, undisturbed, work};
use serde_json::{Value, json};
use swarmwright_pool::Mode;
use swarmwright_protocol::{Message, Topic, Topics};

#[test]
fn control_goes_to_the_topic_of_a_server_that_says_that_it_listens_there() {
    let own = Topics::default().to_server(1);
    for (announced, topic) in [(true, own.as_str()), (false, "control")] {
        let mut net = Net::new(5);
        if announced {
            net.add(Party::Server(Box::new(server(1, Line::new()))));
        } else {
            net.add_seed_only(1);
        }
        let index = begin(&mut net, Mode::Stepwise, work(CANDIDATES, &SEEDS));
        assert_eq!(net.finish(index), undisturbed(CANDIDATES));
        net.tool(index).release();
        net.collect(index);
        for _ in 0..20 {
            net.turn();
        }
        let controls = net.log.iter().filter_map(|message| {
            let Ok(Message::Control(control)) = Message::decode(Topic::Control, &message.payload)
            else {
                return None;
            };
            (message.topic == "control" || message.topic == own)
                .then_some((message.topic.as_str(), control.run))
        });
        let controls: Vec<(&str, bool)> = controls.collect();
        let mut expected = vec![(topic, true); CANDIDATES * SEEDS.len()];
        expected.push((topic, false));
        assert_eq!(controls, expected);
    }
}

/// Returns an announcement; `control`: whether the server receives control messages on its own topic.
fn announced(instance: &str, control: bool) -> Value {
    json!({"version": 1, "modes": ["stepwise"], "instance": instance, "control": control})
}

/// Returns the topics of the control messages after the first `count`, each with `run`.
fn controls(tool: &Alone, count: usize) -> Vec<(&str, bool)> {
    let messages = tool.said.iter().skip(count);
    let controls = messages.filter(|(_, message)| message["run"].is_boolean());
    controls
        .map(|(topic, message)| (topic.as_str(), message["run"] == true))
        .collect()
}

#[test]
fn an_id_that_an_announcing_and_a_plain_server_share_has_the_topic_of_all() {
    let own = Topics::default().to_server(1);
    let announcing = announced("a", true);
    let both = [(Some(&announcing), own.as_str()), (None, "control")];
    // The first server, the second server, and the one that is left.
    for (first, second, (left, last)) in [
        (both[0], both[1], both[0]),
        (both[0], both[1], both[1]),
        (both[1], both[0], both[0]),
        (both[1], both[0], both[1]),
    ] {
        let mut tool = Alone::new(work(3, &SEEDS));
        tool.answer(1, first.0);
        tool.pass(40);
        assert_eq!(controls(&tool, 0), [(first.1, true)]);
        let known = tool.said.len();
        tool.pass(2500);
        tool.answer(1, first.0);
        tool.answer(1, second.0);
        assert_eq!(tool.warnings.len(), 1, "{:?}", tool.warnings);
        // Either may be running the episode, and the plain one receives only the common topic.
        assert_eq!(controls(&tool, known), [("control", false)]);
        let known = tool.said.len();
        for _ in 0..3 {
            tool.pass(2500);
            tool.answer(1, left);
            tool.pass(100);
        }
        assert_eq!(controls(&tool, known), [(last, true)]);
    }
}

#[test]
fn the_last_announcement_counts_when_the_connection_is_back() {
    let own = Topics::default().to_server(1);
    let topic = |control| if control { own.as_str() } else { "control" };
    for (before, after) in [(true, false), (false, true), (true, true)] {
        let mut tool = Alone::new(work(3, &SEEDS));
        tool.answer(1, Some(&announced("a", before)));
        tool.pass(40);
        tool.reconnect();
        // The server that still waits is the earlier one.
        assert_eq!(
            controls(&tool, 0),
            [(topic(before), true), (topic(before), false)]
        );
        let known = tool.said.len();
        tool.pass(100);
        tool.answer(1, Some(&announced("b", after)));
        tool.pass(100);
        assert_eq!(controls(&tool, known), [(topic(after), true)]);
    }
}

#[test]
fn many_servers_are_released_where_each_hears_it_alone() {
    const MANY: u64 = 150;
    let topics = Topics::default();
    let (silent, plain) = (MANY, MANY + 1);
    let mut tool = Alone::new(work(200, &SEEDS));
    for id in 0..MANY {
        tool.answer(id, Some(&announced("a", true)));
    }
    tool.answer(silent, Some(&announced("a", false)));
    tool.answer(plain, None);
    tool.pass(40);
    assert_eq!(controls(&tool, 0).len(), 152);
    tool.machine.cancel();
    tool.collect();
    let known = tool.said.len();
    tool.machine.release();
    tool.collect();
    let own = (0..MANY).map(|id| topics.to_server(id));
    let told: Vec<(String, Value)> = own
        .zip((0..MANY).map(Value::from))
        .chain([("control".to_owned(), plain.into())])
        .collect();
    let said = tool.said[known..].iter();
    let said: Vec<(String, Value)> = said
        .map(|(topic, message)| (topic.clone(), message["server"].clone()))
        .collect();
    assert_eq!(said, told);
    assert!(controls(&tool, known).iter().all(|(_, run)| !run));
}

#[test]
fn servers_with_sizes_that_no_controller_has_are_not_used() {
    for found in [0_u64, 1_000_001, 1 << 62] {
        for (what, other) in [("sensors", "actuators"), ("actuators", "sensors")] {
            let mut tool = Alone::new(work(3, &SEEDS));
            let mut announced = announced("a", false);
            announced[what] = found.into();
            announced[other] = 1.into();
            tool.answer(1, Some(&announced));
            assert!(!tool.machine.has_server());
            let told = format!("server 1: announces {found} {what}, expected 1 to 1000000");
            assert!(
                tool.machine.describe().contains(&told),
                "{}",
                tool.machine.describe()
            );
        }
    }
}

#[test]
fn a_message_that_is_refused_is_told_of_with_the_field() {
    let mut tool = Alone::new(work(3, &SEEDS));
    let hash = tool.last("discovery");
    let answer = json!({"server": 1, "simulation_hash": hash, "simulations": ["line"],
        "capabilities": {"dimensions": "two"}});
    tool.hear("server", &answer);
    let told = "message on server: \"capabilities.dimensions\": \"two\" (a string) found, expected a number";
    assert!(
        tool.warnings.len() == 1 && tool.warnings[0].contains(told),
        "{:?}",
        tool.warnings
    );
}
