//! Messages of a run (presence, control, parameters and all others) that a stranger changes and sends again at any
//! time: neither tool nor server panics, uses excessive memory, or is unusable afterwards.

mod common;

use common::{Line, Message, Net, Party, server, tool_in_mode, work};
use proptest::prelude::*;
use std::collections::BTreeMap;
use std::sync::OnceLock;
use std::time::Duration;
use swarmwright_fuzzing::{Counting, config, mutated, peak};
use swarmwright_pool::Mode;
use swarmwright_protocol::Topics;

#[global_allocator]
static MEMORY: Counting = Counting;

const SEEDS: [u64; 2] = [3, 4];
const CANDIDATES: usize = 3;
const MODES: [Mode; 3] = [Mode::Stepwise, Mode::Batched, Mode::Offloaded];
/// Number of messages per topic that are changed.
const OF_TOPIC: usize = 40;
/// How long a tool waits for a server; the default.
const PATIENCE: Duration = Duration::from_secs(10);
/// Number of turns after which everything must have ended.
const TURNS: usize = 300_000;

/// Adds a server and a tool in one mode.
fn begin(mode: Mode, random: u64) -> (Net, usize) {
    let mut net = Net::new(random);
    net.presence = true;
    net.add(Party::Server(Box::new(server(1, Line::new()))));
    let tool = tool_in_mode(mode, "a", 0, net.now);
    let tool = net.add(Party::Tool(Box::new(tool)));
    net.submit(tool, work(CANDIDATES, &SEEDS));
    (net, tool)
}

fn undisturbed() -> &'static [f64] {
    static RESULTS: OnceLock<Vec<f64>> = OnceLock::new();
    RESULTS.get_or_init(|| {
        let (mut net, tool) = begin(Mode::Stepwise, 0);
        net.finish(tool)
    })
}

/// Returns the messages of runs in each mode, by topic, with the hashes and numbers that the next run has as well.
fn said() -> BTreeMap<String, Vec<Vec<u8>>> {
    let mut samples: BTreeMap<String, Vec<Vec<u8>>> = BTreeMap::new();
    for mode in MODES {
        let (mut net, tool) = begin(mode, 0);
        net.finish(tool);
        net.tool(tool).release();
        net.collect(tool);
        for Message { topic, payload, .. } in net.log {
            let payloads = samples.entry(topic).or_default();
            if payloads.len() < OF_TOPIC && !payloads.contains(&payload) {
                payloads.push(payload);
            }
        }
    }
    let control = r#"{"server":1,"simulation_hash":"00","run":true,"tool":"b"}"#;
    let parameters = r#"{"server":1,"simulation_hash":"00","numAgents":3,"seed":1}"#;
    for (topic, text) in [("control", control), ("parameters", parameters)] {
        samples
            .entry(topic.to_owned())
            .or_default()
            .push(text.into());
    }
    samples
}

/// Generates a message of a stranger, and the number of turns after it.
fn message() -> impl Strategy<Value = (String, Vec<u8>, usize)> {
    let samples = said();
    let names: Vec<String> = samples.keys().cloned().collect();
    let presence = Topics::default().presence(2);
    let all: Vec<_> = samples
        .into_iter()
        .map(|(topic, payloads)| {
            let exact = prop::sample::select(payloads.clone());
            prop_oneof![exact, mutated(payloads)]
                .prop_map(move |payload| (topic.clone(), payload))
                .boxed()
        })
        .collect();
    let stray = prop::sample::select([names, vec![presence]].concat());
    let own = prop::strategy::Union::new(all);
    (own, stray, 0..16u8, 0..30usize).prop_map(|((topic, payload), stray, odd, turns)| {
        (if odd == 0 { stray } else { topic }, payload, turns)
    })
}

/// Returns whether a tool has all its results, or reports why it cannot get them.
fn has_ended(net: &mut Net, tool: usize) -> bool {
    let now = net.now;
    let machine = net.tool(tool);
    machine.finished()
        || machine.disagreement().is_some()
        || machine.hopeless().is_some()
        || machine.undecided(PATIENCE, now).is_some()
        || machine.rejected(now).is_some()
        || machine.unserved(now) >= PATIENCE
}

fn play(mode: Mode, random: u64, messages: &[(String, Vec<u8>, usize)]) {
    let (mut net, tool) = begin(mode, random);
    let stranger = net.add(Party::Gone);
    for (topic, payload, turns) in messages {
        net.publish(stranger, topic, payload);
        for _ in 0..*turns {
            net.turn();
        }
    }
    // A forged message may be believed and end a run, but every run ends.
    for turn in 0.. {
        if has_ended(&mut net, tool) {
            break;
        }
        assert!(
            turn < TURNS,
            "{}; {:?}",
            net.tool(tool).describe(),
            net.warnings
        );
        net.turn();
    }
    assert!(net.tool(tool).done() <= CANDIDATES * SEEDS.len());
    net.tool(tool).release();
    net.collect(tool);
    // The server serves the next tool normally.
    let next = tool_in_mode(mode, "next", 1 << 40, net.now);
    let next = net.add(Party::Tool(Box::new(next)));
    net.submit(next, work(CANDIDATES, &SEEDS));
    assert_eq!(net.finish(next), undisturbed());
}

proptest! {
    // Each case sends a dozen messages into a whole run, followed by another run.
    #![proptest_config(ProptestConfig { cases: config().cases.div_ceil(12), ..config() })]

    #[test]
    fn messages_of_strangers_disturb_no_tool_for_long(
        mode in prop::sample::select(MODES.to_vec()),
        random in any::<u64>(),
        messages in prop::collection::vec(message(), 1..24),
    ) {
        let length: usize = messages.iter().map(|(_, payload, _)| payload.len()).sum();
        let ((), bytes) = peak(|| play(mode, random, &messages));
        prop_assert!(bytes <= (16 << 20) + 100 * length, "{bytes} bytes for {length}");
    }
}
