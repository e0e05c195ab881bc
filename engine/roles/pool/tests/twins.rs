//! Two servers with one id, one of which has reconnected: the results are those of a single server.
#![allow(clippy::unwrap_used, clippy::panic, reason = "a test")]

use crate::common;

use std::time::Duration;

use common::{Alone, Line, Net, Party, server, tool, tool_in_mode, work};
use serde_json::{Value, json};
use swarmwright_pool::Mode;
use swarmwright_protocol::Topics;
use swarmwright_worlds::{Description, ParameterError, Parameters, Simulation};
use swarmwright_wrapper::{Identity, Machine};

const SEEDS: [u64; 2] = [3, 4];
const MODES: [Mode; 3] = [Mode::Stepwise, Mode::Batched, Mode::Offloaded];

/// A simulation with another title, whose episodes end at once.
struct Dot(Line);

impl Simulation for Dot {
    fn description(&self) -> Description {
        Description {
            title: "dot".to_owned(),
            ..self.0.description()
        }
    }

    fn reset(&mut self, parameters: &Parameters) -> Result<(), ParameterError> {
        self.0.reset(parameters)
    }

    fn acting(&self) -> &[u32] {
        &[]
    }

    fn sense(&self, _: u32, _: &mut [f32]) {}

    fn step(&mut self, _: &[f32]) {}

    fn fitness(&self) -> f64 {
        -1.0
    }
}

fn party(id: u64) -> Party {
    Party::Server(Box::new(server(id, Line::new())))
}

fn dot(id: u64) -> Party {
    Party::Server(Box::new(Machine::new(
        Identity::new(id),
        vec![Box::new(Dot(Line::new()))],
        Topics::default(),
        Duration::from_secs(20),
    )))
}

fn undisturbed(candidates: usize) -> Vec<f64> {
    let mut net = Net::new(5);
    let index = net.add(Party::Tool(Box::new(tool("a", 0, net.now))));
    net.add(party(1));
    net.submit(index, work(candidates, &SEEDS));
    net.finish(index)
}

#[test]
fn a_server_of_another_simulation_under_the_id_does_nothing_for_this_one() {
    let expected = undisturbed(7);
    for mode in MODES {
        for random in 0..10 {
            let mut net = Net::new(random);
            let machine = tool_in_mode(mode, "a", 0, net.now);
            let index = net.add(Party::Tool(Box::new(machine)));
            net.add(party(1));
            net.add(dot(1));
            net.submit(index, work(7, &SEEDS));
            assert_eq!(net.finish(index), expected, "{mode}");
        }
    }
}

/// Creates a server of another simulation that starts any run, as servers did before this version.
fn heedless() -> Party {
    Party::Script(Box::new(|topic, payload| {
        let message: Value = serde_json::from_slice(payload).unwrap_or_default();
        if topic != "control" || message["run"] != true || message["server"] != 1 {
            return Vec::new();
        }
        let (hash, title) = (&message["simulation_hash"], "dot");
        let sensor =
            json!({"simulation": title, "simulation_hash": hash, "agent": 0, "sensor": [9, 9]});
        let fitness = json!({"simulation": title, "simulation_hash": hash, "fitness": -1});
        vec![
            ("sensor".to_owned(), sensor.to_string().into_bytes()),
            ("fitness".to_owned(), fitness.to_string().into_bytes()),
        ]
    }))
}

#[test]
fn what_names_another_simulation_is_refused_and_counted() {
    let expected = undisturbed(7);
    for random in 0..10 {
        let mut net = Net::new(random);
        let index = net.add(Party::Tool(Box::new(tool("a", 0, net.now))));
        // The servers without extensions receive control messages on the common topic.
        net.add_seed_only(1);
        net.add(heedless());
        net.submit(index, work(7, &SEEDS));
        assert_eq!(net.finish(index), expected);
        let told = "a fitness message is of simulation \"dot\", not \"line\"";
        let told = |text: &&String| text.contains(told);
        assert_eq!(net.warnings.iter().filter(told).count(), 1, "said once");
        assert!(net.tool(index).counts().foreign >= 14);
    }
}

#[test]
fn a_server_without_a_title_in_its_messages_is_used() {
    // The printed examples in D6.1 omit it.
    let expected = undisturbed(3);
    let mut net = Net::new(5);
    let index = net.add(Party::Tool(Box::new(tool("a", 0, net.now))));
    net.add_seed_only(1);
    net.submit(index, work(3, &SEEDS));
    assert_eq!(net.finish(index), expected);
}

#[test]
fn one_of_the_same_simulation_that_comes_in_the_middle_changes_no_result() {
    let expected = undisturbed(40);
    for mode in MODES {
        for random in 0..20 {
            let mut net = Net::new(random);
            net.presence = random % 2 == 0;
            let machine = tool_in_mode(mode, "a", 0, net.now);
            let index = net.add(Party::Tool(Box::new(machine)));
            net.add(party(1));
            net.add(party(2));
            net.submit(index, work(40, &SEEDS));
            for _ in 0..random * 20 {
                net.turn();
            }
            net.add(party(1));
            assert_eq!(net.finish(index), expected, "{mode}, {random}");
        }
    }
}

#[test]
fn what_came_under_an_id_that_two_have_who_cannot_be_told_apart_is_done_again() {
    let mut tool = Alone::new(work(3, &[3]));
    tool.answer(1, None);
    tool.pass(40);
    let first = tool.last("control");
    tool.sense(&first);
    tool.hear("fitness", &json!({"simulation_hash": first, "fitness": 1}));
    assert_eq!(tool.machine.done(), 1);
    let second = tool.last("control");
    assert_ne!(first, second);
    tool.sense(&second);
    tool.pass(2500);
    // The server answers although it runs an episode, so there must be another one.
    tool.answer(1, None);
    tool.pass(100);
    tool.sense(&second);
    assert_eq!(tool.machine.done(), 1, "what was on its way may still come");
    tool.pass(200);
    tool.sense(&second);
    assert_eq!(tool.machine.done(), 0);
    assert_eq!(tool.machine.counts().recomputed, 1);
    let told = "two servers answer to the id 1, so neither is used; give one another --id; 1 evaluations under this id \
                are repeated";
    assert_eq!(tool.warnings, [told]);
    let controls = |tool: &Alone| tool.on("control").count();
    let before = controls(&tool);
    // In the next round both answer; in the one after it, one of them has left.
    tool.pass(2500);
    tool.answer(1, None);
    tool.answer(1, None);
    tool.pass(2500);
    tool.answer(1, None);
    tool.pass(100);
    assert_eq!(controls(&tool), before, "neither is used");
    tool.pass(2500);
    tool.answer(1, None);
    tool.pass(100);
    assert_eq!(controls(&tool), before + 1, "one is left");
}

/// Creates a tool whose server 1 has sent the fitness of its first episode, and returns the hash of that episode.
fn answered_once() -> (Alone, Value) {
    let mut tool = Alone::new(work(7, &[3]));
    tool.answer(1, None);
    tool.pass(40);
    let first = tool.last("control");
    tool.sense(&first);
    tool.hear("fitness", &json!({"simulation_hash": first, "fitness": 1}));
    assert_eq!(tool.machine.done(), 1);
    (tool, first)
}

#[test]
fn two_values_for_one_episode_are_told_once_and_the_first_counts() {
    let (mut tool, mut hash) = answered_once();
    for done in 1..4 {
        tool.hear("fitness", &json!({"simulation_hash": hash, "fitness": 2}));
        assert_eq!(
            tool.machine.done(),
            done,
            "a server that does so alone comes to an end, too"
        );
        assert_eq!(tool.machine.counts().double, done as u64);
        assert_eq!(tool.warnings.len(), 1);
        hash = tool.last("control");
        tool.sense(&hash);
        tool.hear("fitness", &json!({"simulation_hash": hash, "fitness": 1}));
    }
    assert!(
        tool.warnings[0]
            .starts_with("server 1 has sent two different fitness values for one episode")
    );
}

#[test]
fn a_server_that_sends_every_result_twice_is_named_once() {
    let (mut tool, first) = answered_once();
    let mut hash = first;
    for done in 1..6 {
        tool.hear("fitness", &json!({"simulation_hash": hash, "fitness": 1}));
        assert_eq!(tool.machine.done(), done, "the same value does no harm");
        assert_eq!(tool.warnings.len(), usize::from(done >= 3));
        hash = tool.last("control");
        tool.sense(&hash);
        tool.hear("fitness", &json!({"simulation_hash": hash, "fitness": 1}));
    }
    assert!(tool.warnings[0].starts_with("server 1 sends every result twice"));
}
