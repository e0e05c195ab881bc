//! A broker, a clock and parties without I/O, for whole conversations between pools and servers in virtual time.

#![allow(
    dead_code,
    unused_imports,
    clippy::unwrap_used,
    clippy::panic,
    reason = "a test; each uses a part of it"
)]

mod alone;
mod extended;
mod fleets;
mod narrow;
mod tools;

use std::collections::{HashSet, VecDeque};
use std::time::{Duration, Instant};

use serde_json::Value;
use swarmwright_pool::{Attempt, Results, Scheduler, Work};
use swarmwright_protocol::{Topic, Topics};
use swarmwright_wrapper::{Machine as ServerMachine, Notice};

pub use alone::Alone;
pub use extended::{Extended, Wrong, refusal};
pub use fleets::{
    CANDIDATES, SEEDS, batched, begin, begin_with, begin_without_copies, offloaded, party,
    undisturbed,
};
pub use swarmwright_testing::{LINE_METRICS, Line};
pub use tools::{server, tool, tool_in_mode, tool_that_measures, tool_with, tool_with_faults};

/// Specification of all controllers in these tests: layered, without state.
pub const ARCHITECTURE: &str = r#"{"version": 1, "kind": "layered", "sensors": 2, "actuators": 1, "hidden": [],
    "activation": "tanh", "output_range": [-1, 1]}"#;

/// Creates work with candidates of growing weight.
pub fn work(candidates: usize, seeds: &[u64]) -> Work {
    #[expect(clippy::cast_precision_loss, reason = "small numbers")]
    let weight = |candidate: usize| candidate as f32 / 10.0;
    let genome = |candidate| [weight(candidate), -weight(candidate), 0.5];
    Work::new(
        ARCHITECTURE,
        (0..candidates).flat_map(genome).collect(),
        seeds.to_vec(),
    )
    .unwrap()
}

/// Function from a topic and a payload to the messages sent in answer.
pub type Script = Box<dyn FnMut(&str, &[u8]) -> Vec<(String, Vec<u8>)>>;

pub enum Party {
    Tool(Box<Scheduler>),
    Server(Box<ServerMachine>),
    /// A server with the extensions.
    Extended(Box<Extended>),
    /// A party with scripted answers.
    Script(Script),
    /// A frozen or killed party, which neither reads nor writes.
    Gone,
}

#[derive(Clone)]
pub struct Message {
    pub from: usize,
    pub topic: String,
    pub payload: Vec<u8>,
}

/// The broker and all its parties. Messages of one party keep their order, as on a TCP connection; the next sender is
/// chosen at random.
pub struct Net {
    pub now: Instant,
    pub parties: Vec<Party>,
    /// Messages to deliver, per sender.
    queues: Vec<VecDeque<Message>>,
    pub log: Vec<Message>,
    pub warnings: Vec<String>,
    /// Supervised servers that the tool asked about.
    pub overdue: Vec<u64>,
    /// Number of times that the tool asked how the broker handles small packets.
    pub asked: usize,
    /// Parties whose messages have no extensions.
    pub seed_only: HashSet<usize>,
    /// Whether servers' presence is delivered; conversations must work without it.
    pub presence: bool,
    /// Whether a message may overtake those of the same sender on other topics.
    pub crosses: bool,
    /// Size in bytes of the largest payload that the broker accepts, and the number of connections ended because of
    /// larger ones.
    pub takes: usize,
    pub cuts: usize,
    random: u64,
}

/// Returns the server of a presence message.
fn told_by(payload: &[u8]) -> u64 {
    let presence: Value = serde_json::from_slice(payload).unwrap();
    presence["server"].as_u64().unwrap()
}

impl Net {
    pub fn new(random: u64) -> Self {
        Self {
            now: Instant::now(),
            parties: Vec::new(),
            queues: Vec::new(),
            log: Vec::new(),
            warnings: Vec::new(),
            overdue: Vec::new(),
            asked: 0,
            seed_only: HashSet::new(),
            presence: false,
            crosses: false,
            takes: usize::MAX,
            cuts: 0,
            random: random.wrapping_mul(2).wrapping_add(1),
        }
    }

    pub fn add(&mut self, party: Party) -> usize {
        self.parties.push(party);
        self.queues.push(VecDeque::new());
        self.collect(self.parties.len() - 1);
        self.parties.len() - 1
    }

    /// Adds a server without extensions.
    pub fn add_seed_only(&mut self, id: u64) -> usize {
        let index = self.add(Party::Server(Box::new(server(id, Line::new()))));
        self.seed_only.insert(index);
        index
    }

    pub fn tool(&mut self, index: usize) -> &mut Scheduler {
        match &mut self.parties[index] {
            Party::Tool(machine) => machine,
            _ => panic!("party {index} is no tool"),
        }
    }

    fn draw(&mut self, below: usize) -> usize {
        // xorshift64*; any mixing function would do.
        self.random ^= self.random >> 12;
        self.random ^= self.random << 25;
        self.random ^= self.random >> 27;
        usize::try_from(self.random.wrapping_mul(0x2545_F491_4F6C_DD1D) >> 33).unwrap() % below
    }

    pub fn publish(&mut self, from: usize, topic: &str, payload: &[u8]) {
        self.queues[from].push_back(Message {
            from,
            topic: topic.into(),
            payload: payload.into(),
        });
    }

    /// Carries out the actions of a party.
    pub fn collect(&mut self, index: usize) {
        let topics = Topics::default();
        let mut published = Vec::new();
        // The result of a job is an action, which may start the next job.
        let mut again = false;
        match &mut self.parties[index] {
            Party::Tool(machine) => {
                for action in machine.actions() {
                    match action {
                        swarmwright_pool::Action::Publish(topic, payload) => {
                            published.push((topics.name(topic), payload))
                        }
                        swarmwright_pool::Action::Control { server, payload }
                        | swarmwright_pool::Action::Request {
                            server, payload, ..
                        } => published.push((topics.to_server(server), payload)),
                        swarmwright_pool::Action::Warn(text)
                        | swarmwright_pool::Action::Unaudited(text)
                        | swarmwright_pool::Action::Failed {
                            text, first: true, ..
                        } => self.warnings.push(text),
                        swarmwright_pool::Action::Failed { .. } => {}
                        swarmwright_pool::Action::Overdue(server) => self.overdue.push(server),
                        swarmwright_pool::Action::AskBroker => self.asked += 1,
                    }
                }
            }
            Party::Server(machine) => {
                let mut jobs = Vec::new();
                for action in machine.actions() {
                    match action {
                        swarmwright_wrapper::Action::Reply { topic, payload, .. } => {
                            published.push((topic, payload));
                        }
                        swarmwright_wrapper::Action::Evaluate(job) => jobs.push(job),
                        swarmwright_wrapper::Action::Publish(Topic::Presence, _)
                            if !self.presence => {}
                        swarmwright_wrapper::Action::Publish(Topic::Presence, payload) => {
                            published.push((topics.presence(told_by(&payload)), payload));
                        }
                        swarmwright_wrapper::Action::Publish(topic, payload) => {
                            published.push((topics.name(topic), payload))
                        }
                        swarmwright_wrapper::Action::Notice(Notice::Warning(text)) => {
                            self.warnings.push(text)
                        }
                        swarmwright_wrapper::Action::Notice(_)
                        | swarmwright_wrapper::Action::Frame(_)
                        | swarmwright_wrapper::Action::GiveWay(_) => {}
                    }
                }
                for job in jobs {
                    let done = job.run(swarmwright_worlds::Means::default());
                    machine.finished(done, self.now);
                    again = true;
                }
            }
            Party::Extended(server) => published = server.due(self.now),
            Party::Script(_) | Party::Gone => {}
        }
        for (topic, mut payload) in published {
            if topic == "server" && self.seed_only.contains(&index) {
                let mut message: Value = serde_json::from_slice(&payload).unwrap();
                message["capabilities"]["swarmwright"].take();
                payload = message.to_string().into_bytes();
            }
            self.publish(index, &topic, &payload);
        }
        if again {
            self.collect(index);
        }
    }

    fn deliver(&mut self, message: &Message) {
        for index in 0..self.parties.len() {
            if index == message.from {
                continue;
            }
            match &mut self.parties[index] {
                Party::Tool(machine) => {
                    machine.receive(&message.topic, &message.payload, false, self.now)
                }
                Party::Server(machine) => {
                    machine.receive(&message.topic, &message.payload, false, self.now)
                }
                Party::Extended(server) => {
                    server.receive(&message.topic, &message.payload, self.now)
                }
                Party::Script(script) => {
                    for (topic, payload) in script(&message.topic, &message.payload) {
                        self.queues[index].push_back(Message {
                            from: index,
                            topic,
                            payload,
                        });
                    }
                }
                Party::Gone => {}
            }
            self.collect(index);
        }
    }

    fn next_tick(&self) -> Option<Instant> {
        self.parties
            .iter()
            .filter_map(|party| match party {
                Party::Tool(machine) => Some(machine.next_tick()),
                Party::Server(machine) => machine.next_tick(),
                Party::Extended(server) => server.next(),
                Party::Script(_) | Party::Gone => None,
            })
            .min()
    }

    /// Calls `tick` of all parties.
    pub fn tick(&mut self) {
        for index in 0..self.parties.len() {
            match &mut self.parties[index] {
                Party::Tool(machine) => machine.tick(self.now),
                Party::Server(machine) => machine.tick(self.now, String::new),
                Party::Extended(_) | Party::Script(_) | Party::Gone => {}
            }
            self.collect(index);
        }
    }

    /// Delivers one message, or advances the time to the next timer.
    pub fn turn(&mut self) {
        let waiting: Vec<usize> = (0..self.queues.len())
            .filter(|&index| !self.queues[index].is_empty())
            .collect();
        if waiting.is_empty() {
            self.now =
                self.next_tick().map_or(self.now, |at| at.max(self.now)) + Duration::from_micros(1);
            return self.tick();
        }
        let drawn = waiting[self.draw(waiting.len())];
        let mut first = HashSet::new();
        let queue = self.queues[drawn].iter().enumerate();
        let firsts = queue.filter(|(_, message)| first.insert(message.topic.clone()));
        let firsts: Vec<usize> = firsts.map(|(index, _)| index).collect();
        let index = if self.crosses {
            firsts[self.draw(firsts.len())]
        } else {
            0
        };
        let Some(message) = self.queues[drawn].remove(index) else {
            return;
        };
        self.now += Duration::from_micros(50);
        self.log.push(message.clone());
        if self.read(&message) {
            self.deliver(&message);
        }
    }

    /// Returns whether the broker has no messages of a party to deliver.
    pub fn idle(&self, party: usize) -> bool {
        self.queues[party].is_empty()
    }

    /// Takes turns until the tool has all its results.
    pub fn finish(&mut self, tool: usize) -> Vec<f64> {
        self.finish_with_metrics(tool).fitness
    }

    pub fn finish_with_metrics(&mut self, tool: usize) -> Results {
        for _ in 0..2_000_000 {
            if self.tool(tool).finished() {
                return self.tool(tool).take_results();
            }
            self.turn();
        }
        panic!(
            "no end in sight; {}; {:.2000}",
            self.tool(tool).describe(),
            format!("{:?}", self.warnings)
        );
    }

    pub fn submit(&mut self, tool: usize, work: Work) {
        let now = self.now;
        self.tool(tool).submit(work, now);
        self.collect(tool);
    }

    pub fn journal(&mut self, tool: usize) -> Vec<Attempt> {
        let journal = self.tool(tool).take_journal();
        journal.into_iter().map(|(attempt, _)| attempt).collect()
    }
}
