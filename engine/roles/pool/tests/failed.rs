//! Episodes that fail in the simulation's code: they are retried elsewhere at once, and reported once with the place of
//! the failure.

use crate::common;

use std::time::Duration;

use common::{Line, Net, Party, server, tool_in_mode, work};
use swarmwright_pool::{Mode, Outcome};
use swarmwright_protocol::{MAX_SENSOR, MOST_STACK, Topics};
use swarmwright_worlds::{Description, Failure, ParameterError, Parameters, Simulation, fail};
use swarmwright_wrapper::{Identity, Machine};

const SEEDS: [u64; 2] = [3, 4];
const REASON: &str = "Line.step: a wheel came off (line.py:7)";
const MODES: [Mode; 3] = [Mode::Stepwise, Mode::Batched, Mode::Offloaded];

/// A line whose third step fails in episodes with this seed.
struct Faulty {
    line: Line,
    seed: u64,
    fails_on: u64,
    step: u32,
}

impl Simulation for Faulty {
    fn description(&self) -> Description {
        self.line.description()
    }

    fn reset(&mut self, parameters: &Parameters) -> Result<(), ParameterError> {
        self.seed = parameters["seed"].as_u64().unwrap_or_default();
        self.step = 0;
        self.line.reset(parameters)
    }

    fn acting(&self) -> &[u32] {
        self.line.acting()
    }

    fn sense(&self, agent: u32, sensors: &mut [f32]) {
        self.line.sense(agent, sensors);
    }

    fn step(&mut self, actuators: &[f32]) {
        self.step += 1;
        if self.step == 3 && self.seed == self.fails_on {
            fail(Failure {
                reason: REASON.to_owned(),
                stack: Some("wheel ".repeat(10_000)),
            });
        }
        self.line.step(actuators);
    }

    fn fitness(&self) -> f64 {
        self.line.fitness()
    }

    fn metrics(&self) -> Vec<f64> {
        self.line.metrics()
    }
}

fn faulty(id: u64, fails_on: u64) -> Party {
    let simulation = Faulty {
        line: Line::new(),
        seed: 0,
        fails_on,
        step: 0,
    };
    let timeout = Duration::from_secs(20);
    let (identity, topics) = (Identity::new(id), Topics::default());
    Party::Server(Box::new(Machine::new(
        identity,
        vec![Box::new(simulation)],
        topics,
        timeout,
    )))
}

/// Creates a net with a tool in this mode and the servers.
fn net(mode: Mode, servers: Vec<Party>) -> (Net, usize) {
    let mut net = Net::new(5);
    let now = net.now;
    let index = net.add(Party::Tool(Box::new(tool_in_mode(mode, "a", 0, now))));
    for server in servers {
        net.add(server);
    }
    net.submit(index, work(7, &SEEDS));
    (net, index)
}

#[test]
fn what_fails_on_one_server_is_done_by_another() {
    let sound = || Party::Server(Box::new(server(2, Line::new())));
    let (mut undisturbed, index) = net(Mode::Stepwise, vec![sound()]);
    let expected = undisturbed.finish(index);
    for mode in MODES {
        let (mut net, index) = net(mode, vec![faulty(1, 4), sound()]);
        let start = net.now;
        assert_eq!(net.finish(index), expected, "{mode}");
        assert!(
            net.now - start < Duration::from_secs(2),
            "{mode}: {:?}",
            net.now - start
        );
        let told = |text: &&String| text.contains(REASON) && text.contains("on server 1");
        assert_eq!(
            net.warnings.iter().filter(told).count(),
            1,
            "{mode}: {:?}",
            net.warnings
        );
        let journal = net.journal(index);
        let failed: Vec<_> = journal.iter().filter(|one| one.error.is_some()).collect();
        assert!(
            failed
                .iter()
                .all(|one| one.server == 1 && one.error.as_deref() == Some(REASON))
        );
        assert!(
            journal
                .iter()
                .all(|one| (one.outcome == Outcome::Failed) == one.error.is_some()),
            "{mode}: {journal:?}"
        );
        let stacks: Vec<_> = failed.iter().filter_map(|one| one.stack.as_ref()).collect();
        assert_eq!(stacks.len(), 1, "{mode}");
        assert_eq!(stacks[0].len(), MOST_STACK);
    }
}

#[test]
fn what_fails_everywhere_is_given_up_and_the_rest_is_sound() {
    for mode in MODES {
        let (mut net, index) = net(mode, vec![faulty(1, 4), faulty(2, 4)]);
        let start = net.now;
        let fitness = net.finish(index);
        for (evaluation, value) in fitness.iter().enumerate() {
            assert_eq!(value.is_nan(), evaluation % 2 == 1, "{mode}: {fitness:?}");
        }
        assert!(
            net.now - start < Duration::from_secs(2),
            "{mode}: {:?}",
            net.now - start
        );
        let attempts = |one: &&swarmwright_pool::Attempt| one.error.is_some();
        let failed = net.journal(index).iter().filter(attempts).count();
        // The servers declare bitwise determinism, so two attempts are enough if both servers had just succeeded with
        // another evaluation.
        assert!((7 * 2..=7 * 3).contains(&failed), "{mode}: {failed}");
    }
}

#[test]
fn parameters_that_every_server_refuses_end_the_work_with_the_reason() {
    for mode in MODES {
        let mut net = Net::new(3);
        let (now, start) = (net.now, net.now);
        let mut machine = common::tool_with(mode, "a", 0, now, |config| {
            config.parameters.insert("numAgents".into(), 0.into());
        });
        net.add(Party::Server(Box::new(server(1, Line::new()))));
        machine.submit(work(2, &SEEDS), now);
        let index = net.add(Party::Tool(Box::new(machine)));
        let reason = loop {
            net.turn();
            let now = net.now;
            if let Some(reason) = net.tool(index).rejected(now) {
                break reason;
            }
            assert!(now - start < Duration::from_secs(5), "{:?}", net.warnings);
        };
        assert!(reason.contains("numAgents"), "{mode}: {reason}");
    }
}

#[test]
fn reports_of_strangers_change_nothing() {
    use swarmwright_protocol::{EXTENSION_VERSION, Failed, ToTool};
    let (mut undisturbed, index) = net(
        Mode::Stepwise,
        vec![Party::Server(Box::new(server(2, Line::new())))],
    );
    let expected = undisturbed.finish(index);
    let (mut net, index) = net(
        Mode::Stepwise,
        vec![Party::Server(Box::new(server(2, Line::new())))],
    );
    let stranger = net.add(Party::Gone);
    let own = Topics::default().to_server(2);
    for _ in 0..200 {
        net.turn();
        let Some(message) = net.log.iter().rev().find(|one| one.topic == own) else {
            continue;
        };
        let control: serde_json::Value =
            serde_json::from_slice(&message.payload).unwrap_or_default();
        let hash = control["simulation_hash"].as_str().unwrap_or_default();
        // Reports by a server that does not run the episode, and about an episode that no server runs.
        for (server, simulation_hash) in [(9, hash), (2, "none")] {
            let report = ToTool::Failed(Failed {
                version: EXTENSION_VERSION,
                server,
                simulation_hash: simulation_hash.to_owned(),
                reason: "no".to_owned(),
                stack: None,
                invalid: true,
            });
            net.publish(stranger, &Topics::default().to_tool("a"), &report.encode());
        }
    }
    assert_eq!(net.finish(index), expected);
    assert!(net.warnings.is_empty(), "{:?}", net.warnings);
}

/// Runs a tool with one server and returns why the work was refused.
fn rejected(net: &mut Net, index: usize, mut turn: impl FnMut(&mut Net)) -> String {
    let start = net.now;
    loop {
        net.turn();
        turn(net);
        let now = net.now;
        if let Some(reason) = net.tool(index).rejected(now) {
            return reason;
        }
        assert!(now - start < Duration::from_secs(5), "{:?}", net.warnings);
    }
}

#[test]
fn sensors_that_are_larger_than_a_message_may_be_end_the_work_at_once_with_their_size() {
    let (mut net, index) = net(
        Mode::Stepwise,
        vec![Party::Server(Box::new(server(2, Line::new())))],
    );
    let stranger = net.add(Party::Gone);
    let note = "x".repeat(MAX_SENSOR);
    let mut sent = false;
    let reason = rejected(&mut net, index, |net| {
        let own = Topics::default().to_server(2);
        let control = net.log.iter().find(|one| one.topic == own);
        let Some(control) = control.filter(|_| !sent) else {
            return;
        };
        let control: serde_json::Value =
            serde_json::from_slice(&control.payload).unwrap_or_default();
        let hash = &control["simulation_hash"];
        let text =
            format!(r#"{{"simulation_hash":{hash},"agent":0,"sensor":[0],"note":"{note}"}}"#);
        net.publish(stranger, "sensor", text.as_bytes());
        sent = true;
    });
    assert!(
        reason.contains("message on sensor: 6710") && reason.contains("more than the 67108864"),
        "{reason}"
    );
}

#[test]
fn parameters_that_are_larger_than_a_message_may_be_end_the_work_with_their_size() {
    for (note, packet, told) in [
        (1 << 20, usize::MAX, "larger than the 1048576 allowed"),
        (
            30_000,
            20_000,
            "larger than the 19974 that the broker accepts",
        ),
    ] {
        let mut net = Net::new(3);
        let now = net.now;
        let mut machine = common::tool_with(Mode::Stepwise, "a", 0, now, |config| {
            let note = "x".repeat(note);
            config.parameters.insert("note".into(), note.into());
        });
        machine.set_largest_packet(packet);
        net.add(Party::Server(Box::new(server(1, Line::new()))));
        machine.submit(work(2, &SEEDS), now);
        let index = net.add(Party::Tool(Box::new(machine)));
        let reason = rejected(&mut net, index, |_| {});
        assert!(
            reason.contains("a parameters message of") && reason.contains(told),
            "{reason}"
        );
    }
}

#[test]
fn a_server_that_answers_with_a_hash_of_its_own_is_named() {
    let answer = r#"{"server":7,"simulation_hash":"mine","simulations":["line"],"capabilities":{"dimensions":2}}"#;
    let script: common::Script = Box::new(|topic, _| match topic {
        "discovery" => vec![("server".to_owned(), answer.as_bytes().to_vec())],
        _ => Vec::new(),
    });
    let (mut net, index) = net(Mode::Stepwise, vec![Party::Script(script)]);
    for _ in 0..20 {
        net.turn();
    }
    let found = net.tool(index).describe();
    assert!(
        found.contains(r#"server 7 answers with simulation_hash "mine", which belongs to no"#),
        "{found}"
    );
}

#[test]
fn messages_that_overtake_those_on_other_topics_cost_no_attempt() {
    for random in 0..30 {
        let mut net = Net::new(random);
        net.crosses = true;
        net.presence = random % 2 == 0;
        let now = net.now;
        let index = net.add(Party::Tool(Box::new(common::tool("a", 0, now))));
        net.add_seed_only(1);
        net.add(Party::Server(Box::new(server(2, Line::new()))));
        net.submit(index, work(7, &SEEDS));
        net.finish(index);
        let errors = net.journal(index).into_iter().filter_map(|one| one.error);
        assert_eq!(errors.collect::<Vec<_>>(), Vec::<String>::new(), "{random}");
    }
}
