//! A tool without a broker, which receives messages from the test.

use std::time::{Duration, Instant};

use serde_json::{Value, json};
use swarmwright_pool::{Action, Scheduler, Work};
use swarmwright_protocol::Topics;

use super::tool;

/// A tool in stepwise mode, and the JSON messages that it published.
pub struct Alone {
    pub machine: Scheduler,
    pub now: Instant,
    /// Published messages, each with its topic.
    pub said: Vec<(String, Value)>,
    pub warnings: Vec<String>,
}

impl Alone {
    /// Creates a tool with work that has published a discovery.
    pub fn new(work: Work) -> Self {
        let now = Instant::now();
        let mut alone = Self {
            machine: tool("a", 0, now),
            now,
            said: Vec::new(),
            warnings: Vec::new(),
        };
        alone.machine.submit(work, now);
        alone.pass(0);
        alone
    }

    pub fn pass(&mut self, milliseconds: u64) {
        self.now += Duration::from_millis(milliseconds);
        self.machine.tick(self.now);
        self.collect();
    }

    pub fn hear(&mut self, topic: &str, message: &Value) {
        let payload = message.to_string().into_bytes();
        self.machine.receive(topic, &payload, false, self.now);
        self.collect();
    }

    /// Breaks the connection and restores it at once.
    pub fn reconnect(&mut self) {
        self.machine.disconnected(self.now);
        self.machine.connected(self.now);
        self.collect();
    }

    /// Collects the messages that the tool publishes.
    pub fn collect(&mut self) {
        let topics = Topics::default();
        for action in self.machine.actions() {
            let (topic, payload) = match action {
                Action::Publish(topic, payload) => (topics.name(topic), payload),
                Action::Control { server, payload } => (topics.to_server(server), payload),
                Action::Warn(text) | Action::Unaudited(text) | Action::Failed { text, .. } => {
                    self.warnings.push(text);
                    continue;
                }
                _ => continue,
            };
            let message = serde_json::from_slice(&payload).unwrap();
            self.said.push((topic, message));
        }
    }

    /// Returns the messages on a topic.
    pub fn on(&self, topic: &str) -> impl DoubleEndedIterator<Item = &Value> {
        let messages = self.said.iter();
        messages
            .filter(move |(name, _)| name == topic)
            .map(|(_, message)| message)
    }

    /// Returns the hash of the last message on a topic.
    pub fn last(&self, topic: &str) -> Value {
        self.on(topic).next_back().unwrap()["simulation_hash"].clone()
    }

    /// Answers the last discovery as a server; `announced`: its `capabilities.swarmwright`.
    pub fn answer(&mut self, server: u64, announced: Option<&Value>) {
        let mut capabilities = json!({"dimensions": 2, "max_agents": 5});
        if let Some(announced) = announced {
            capabilities["swarmwright"] = announced.clone();
        }
        let answer = json!({"server": server, "simulation_hash": self.last("discovery"),
            "simulations": ["line"], "capabilities": capabilities});
        self.hear("server", &answer);
    }

    pub fn sense(&mut self, hash: &Value) {
        let sensor = json!({"simulation_hash": hash, "agent": 0, "sensor": [0.5, 0.5]});
        self.hear("sensor", &sensor);
    }
}
