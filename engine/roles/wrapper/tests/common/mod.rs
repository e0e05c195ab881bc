//! A server's state machine, and a tool that uses extensions, without I/O.
#![allow(clippy::unwrap_used, clippy::panic, dead_code)] // helpers of tests, not all used by each

use std::time::{Duration, Instant};

use serde_json::{Map, Value, json};
use swarmwright_controllers::Architecture;
use swarmwright_protocol::{
    BatchActuators, BatchSensors, BatchStart, EXTENSION_VERSION, Evaluate, Evaluated, F32s,
    Message, ToServer, ToTool, Topic, Topics, U64s,
};
pub use swarmwright_testing::Walk;
use swarmwright_worlds::{Means, Simulation};
use swarmwright_wrapper::{Action, Identity, Job, Machine, Notice, Rival};

pub const ID: u64 = 7;
pub const STEP_TIMEOUT: Duration = Duration::from_secs(60);

/// Returns a layered network for the walk, without hidden nodes: 3 weights.
pub fn network() -> Map<String, Value> {
    object(
        json!({"version": 1, "kind": "layered", "sensors": 2, "actuators": 1, "hidden": [],
        "activation": "tanh", "output_range": [-1, 1]}),
    )
}

pub fn object(value: Value) -> Map<String, Value> {
    value.as_object().unwrap().clone()
}

pub fn architecture(controller: &Map<String, Value>) -> Architecture {
    Architecture::from_json(&Value::Object(controller.clone()).to_string()).unwrap()
}

/// Returns a request of the tool "ada" for two candidates in two episodes of the walk.
pub fn request(number: u64) -> Evaluate {
    Evaluate {
        version: EXTENSION_VERSION,
        request: number,
        tool: "ada".to_owned(),
        reply: "swarmwright/v1/tool/ada1".to_owned(),
        simulation: "walk".to_owned(),
        parameters: Map::new(),
        controller: network(),
        genomes: F32s(vec![0.1, -0.2, 0.3, 0.5, 0.5, -0.5]),
        seeds: U64s(vec![1, 2]),
        metrics: Vec::new(),
        attempt: 1,
        lease: 60.0,
        instance: None,
        sample: None,
    }
}

/// Returns a batch of the tool "ada" with three episodes of the walk.
pub fn batch(number: u64) -> BatchStart {
    BatchStart {
        version: EXTENSION_VERSION,
        request: number,
        tool: "ada".to_owned(),
        reply: "swarmwright/v1/tool/ada1".to_owned(),
        simulation: "walk".to_owned(),
        parameters: Map::new(),
        seeds: U64s(vec![1, 2, 3]),
        metrics: Vec::new(),
        instance: None,
    }
}

/// A server and the messages that it sent.
pub struct Server {
    pub machine: Machine,
    pub now: Instant,
    pub warnings: Vec<String>,
    /// Jobs that have not been computed.
    pub jobs: Vec<Job>,
    /// Answers to tools, each with its topic without prefix.
    pub replies: Vec<(String, ToTool)>,
    /// Messages published on the seven topics.
    pub published: Vec<(Topic, Vec<u8>)>,
    /// Number of numbered requests.
    pub requests: u64,
    /// Servers for which it leaves.
    pub rivals: Vec<Rival>,
}

impl Server {
    pub fn new(simulations: Vec<Box<dyn Simulation>>) -> Self {
        let identity = Identity::new(ID);
        Self {
            machine: Machine::new(identity, simulations, Topics::default(), STEP_TIMEOUT),
            now: Instant::now(),
            warnings: Vec::new(),
            jobs: Vec::new(),
            replies: Vec::new(),
            published: Vec::new(),
            requests: 0,
            rivals: Vec::new(),
        }
    }

    pub fn of_walks() -> Self {
        Self::new(vec![Walk::duplicable()])
    }

    pub fn receive(&mut self, topic: &str, payload: &[u8]) {
        self.machine.receive(topic, payload, false, self.now);
        self.collect();
    }

    pub fn ask(&mut self, message: ToServer) {
        self.receive(&Topics::default().to_server(ID), &message.encode());
    }

    pub fn evaluate(&mut self, message: Evaluate) {
        self.ask(ToServer::Evaluate(message));
    }

    pub fn say(&mut self, topic: Topic, message: &Value) {
        self.receive(topic.name(), message.to_string().as_bytes());
    }

    pub fn pass(&mut self, time: Duration) {
        self.now += time;
        self.machine
            .tick(self.now, || "2026-01-31T12:00:00Z".to_owned());
        self.collect();
    }

    /// Lets the simulations take this long for the last message.
    pub fn took(&mut self, time: Duration) {
        let turn = self.now;
        self.now += time;
        self.machine.computed(turn, self.now);
    }

    pub fn collect(&mut self) {
        for action in self.machine.actions() {
            match action {
                Action::Publish(topic, payload) => self.published.push((topic, payload)),
                Action::Reply {
                    topic,
                    request,
                    payload,
                } => {
                    let message = ToTool::decode(&payload).unwrap();
                    assert_eq!(request, number(&message));
                    self.replies.push((topic, message));
                }
                Action::Evaluate(job) => self.jobs.push(job),
                Action::Notice(Notice::Warning(text)) => self.warnings.push(text),
                Action::GiveWay(rival) => self.rivals.push(rival),
                Action::Notice(_) | Action::Frame(_) => {}
            }
        }
        assert!(self.jobs.len() <= 1, "one job at a time");
    }

    /// Computes all jobs.
    pub fn compute(&mut self) {
        while let Some(job) = self.jobs.pop() {
            self.machine.finished(job.run(Means::default()), self.now);
            self.collect();
        }
    }

    /// Takes the answers since the last call, which must all be results of evaluations.
    pub fn results(&mut self) -> Vec<Evaluated> {
        self.replies
            .drain(..)
            .map(|(_, message)| match message {
                ToTool::Evaluated(message) => message,
                other => panic!("{other:?}"),
            })
            .collect()
    }

    /// Takes the answers since the last call, which must all belong to batches.
    pub fn sensors(&mut self) -> Vec<BatchSensors> {
        self.replies
            .drain(..)
            .map(|(_, message)| match message {
                ToTool::Sensors(message) => message,
                other => panic!("{other:?}"),
            })
            .collect()
    }

    pub fn actuators(&mut self, request: u64, step: u64, actuators: Vec<f32>) {
        self.ask(ToServer::Actuators(BatchActuators {
            version: EXTENSION_VERSION,
            request,
            step,
            actuators: F32s(actuators),
        }));
    }

    /// Returns whether the server answers a discovery of a tool.
    pub fn answers(&mut self, tool: Option<&str>) -> bool {
        self.published.clear();
        let mut message = json!({"simulation": self.machine.titles()[0], "simulation_hash": "d",
            "requirements": {"dimensions": 2}});
        if let Some(tool) = tool {
            message["tool"] = tool.into();
        }
        self.say(Topic::Discovery, &message);
        self.published.iter().any(|(topic, payload)| {
            *topic == Topic::Server && Message::decode(*topic, payload).is_ok()
        })
    }
}

fn number(message: &ToTool) -> Option<u64> {
    match message {
        ToTool::Evaluated(message) => Some(message.request),
        ToTool::Sensors(message) => Some(message.request),
        ToTool::Failed(_) | ToTool::Scene(_) => None,
    }
}

pub fn bits(values: &[f64]) -> Vec<u64> {
    values.iter().map(|value| value.to_bits()).collect()
}
