//! A server's decisions and a tool that asks for extensions, without I/O.
#![allow(clippy::unwrap_used, clippy::panic, dead_code)] // helpers of tests, not all used by each

use std::time::{Duration, Instant};

use serde_json::{Map, Value, json};
use swarmwright_controllers::Architecture;
use swarmwright_protocol::{
    BatchActuators, BatchSensors, BatchStart, EXTENSION_VERSION, Evaluate, Evaluated, F32s,
    Message, ToServer, ToTool, Topic, Topics, U64s,
};
use swarmwright_worlds::{
    Description, Failure, Means, MetricInfo, ParameterError, Parameters, Simulation, Together,
    fail, measure,
};
use swarmwright_wrapper::{Action, Identity, Job, Machine, Notice, Rival};

pub const ID: u64 = 7;
pub const STEP_TIMEOUT: Duration = Duration::from_secs(60);

/// What the walk measures.
pub const METRICS: &[MetricInfo] = &[
    MetricInfo::new("steps", "steps", "Steps made."),
    MetricInfo::new("half", "", "Half the fitness."),
];

/// Agents that add up what they are told; `trouble` says what goes wrong in episodes whose seed is a multiple of 3.
#[derive(Clone, Default)]
pub struct Walk {
    duplicable: bool,
    trouble: String,
    seed: u64,
    step: u32,
    acting: Vec<u32>,
    sum: f64,
}

impl Walk {
    /// One that can be duplicated.
    pub fn duplicable() -> Box<dyn Simulation> {
        Box::new(Self {
            duplicable: true,
            ..Self::default()
        })
    }

    fn is_in(&self, trouble: &str) -> bool {
        self.is_in_end(trouble) && self.step == 2
    }

    fn is_in_end(&self, trouble: &str) -> bool {
        self.trouble == trouble && self.seed.is_multiple_of(3)
    }
}

impl Simulation for Walk {
    fn description(&self) -> Description {
        Description {
            title: "walk".to_owned(),
            dimensions: 2,
            max_agents: None,
            sensors: 2,
            actuators: 1,
            metrics: METRICS.into(),
            determinism: swarmwright_worlds::Determinism::Bitwise,
        }
    }

    fn reset(&mut self, parameters: &Parameters) -> Result<(), ParameterError> {
        let number =
            |name: &str, default| parameters.get(name).map_or(Some(default), Value::as_u64);
        let wrong = |name: &str| ParameterError {
            name: name.to_owned(),
            reason: "expected a whole number".to_owned(),
        };
        let agents = number("agents", 2).ok_or_else(|| wrong("agents"))?;
        *self = Self {
            duplicable: self.duplicable,
            trouble: parameters
                .get("trouble")
                .and_then(Value::as_str)
                .unwrap_or_default()
                .to_owned(),
            seed: number("seed", 0).ok_or_else(|| wrong("seed"))?,
            step: 0,
            acting: (0..u32::try_from(agents).unwrap()).collect(),
            sum: 0.0,
        };
        assert!(
            !(self.trouble == "reset" && self.seed.is_multiple_of(3)),
            "no start"
        );
        Ok(())
    }

    fn acting(&self) -> &[u32] {
        &self.acting
    }

    fn sense(&self, agent: u32, sensors: &mut [f32]) {
        sensors[0] = (self.seed % 100) as f32 / 100.0 + self.step as f32;
        sensors[1] = agent as f32;
        if self.is_in("sensor") {
            sensors[1] = f32::NAN;
        }
    }

    fn step(&mut self, actuators: &[f32]) {
        assert!(!self.is_in("panic"), "a wall came down");
        if self.is_in("fail") {
            fail(Failure {
                reason: "no way on".to_owned(),
                stack: Some("step\nwall".to_owned()),
            });
        }
        for (agent, actuator) in self.acting.iter().zip(actuators) {
            self.sum = self.sum * 1.1 + f64::from(*actuator) * f64::from(agent + 1);
        }
        self.step += 1;
        // Agents stop one after another.
        self.acting.retain(|agent| self.step < 4 + agent);
    }

    fn fitness(&self) -> f64 {
        if self.trouble == "fitness" && self.seed.is_multiple_of(3) {
            return f64::NAN;
        }
        self.sum
    }

    fn metrics(&self) -> Vec<f64> {
        assert!(!self.is_in_end("metrics panic"), "no ruler");
        let half = if self.is_in_end("metrics") {
            f64::INFINITY
        } else {
            self.sum / 2.0
        };
        vec![f64::from(self.step), half]
    }

    fn duplicate(&self) -> Option<Box<dyn Simulation>> {
        self.duplicable
            .then(|| Box::new(self.clone()) as Box<dyn Simulation>)
    }
}

/// A layered network for the walk, without hidden nodes: 3 weights.
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

/// A request of the tool "ada" for two candidates in two episodes of the walk.
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
    }
}

/// Walks that are stepped together; one that fails takes all with it.
#[derive(Default)]
pub struct Crowd {
    alone: Walk,
    many: Vec<Walk>,
    results: Vec<Vec<f64>>,
    wanted: Vec<usize>,
}

impl Crowd {
    fn look(&mut self) {
        let result = |walk: &Walk| {
            let mut values = vec![walk.fitness(); 1 + self.wanted.len()];
            measure(walk, &self.wanted, &mut values[1..]);
            values
        };
        self.results = self.many.iter().map(result).collect();
    }
}

impl Simulation for Crowd {
    fn description(&self) -> Description {
        self.alone.description()
    }

    fn reset(&mut self, parameters: &Parameters) -> Result<(), ParameterError> {
        self.alone.reset(parameters)
    }

    fn acting(&self) -> &[u32] {
        Simulation::acting(&self.alone)
    }

    fn sense(&self, agent: u32, sensors: &mut [f32]) {
        Simulation::sense(&self.alone, agent, sensors);
    }

    fn step(&mut self, actuators: &[f32]) {
        Simulation::step(&mut self.alone, actuators);
    }

    fn fitness(&self) -> f64 {
        self.alone.fitness()
    }

    fn metrics(&self) -> Vec<f64> {
        self.alone.metrics()
    }

    fn duplicate(&self) -> Option<Box<dyn Simulation>> {
        Some(Box::new(Self::default()))
    }

    fn lanes(&self) -> usize {
        100
    }

    fn together(&mut self) -> Option<&mut dyn Together> {
        Some(self)
    }
}

impl Together for Crowd {
    fn start(
        &mut self,
        parameters: &Parameters,
        seeds: &[u64],
        wanted: &[usize],
    ) -> Result<(), ParameterError> {
        self.many = vec![Walk::default(); seeds.len()];
        self.wanted = wanted.to_vec();
        let mut parameters = parameters.clone();
        for (walk, seed) in self.many.iter_mut().zip(seeds) {
            parameters.insert("seed".to_owned(), (*seed).into());
            walk.reset(&parameters)?;
        }
        self.look();
        Ok(())
    }

    fn acting(&self, episode: usize) -> &[u32] {
        Simulation::acting(&self.many[episode])
    }

    fn done(&self, episode: usize) -> bool {
        self.many[episode].done()
    }

    fn sense(&self, episode: usize, agent: u32, sensors: &mut [f32]) {
        Simulation::sense(&self.many[episode], agent, sensors);
    }

    fn step(&mut self, actuators: &[f32]) {
        let mut rest = actuators;
        for walk in &mut self.many {
            let own;
            (own, rest) = rest.split_at(Simulation::acting(walk).len());
            if !own.is_empty() {
                Simulation::step(walk, own);
            }
        }
        assert!(rest.is_empty(), "{} rows too many", rest.len());
        self.look();
    }

    fn results(&self, episode: usize) -> &[f64] {
        &self.results[episode]
    }
}

/// A batch of the tool "ada" with three episodes of the walk.
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

/// A server and what it said.
pub struct Server {
    pub machine: Machine,
    pub now: Instant,
    pub warnings: Vec<String>,
    /// Jobs that were not computed yet.
    pub jobs: Vec<Job>,
    /// Answers to tools: topic without prefix, message.
    pub replies: Vec<(String, ToTool)>,
    /// What was published on the seven topics.
    pub published: Vec<(Topic, Vec<u8>)>,
    /// Requests that were numbered.
    pub requests: u64,
    /// Servers for which it gives way.
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

    /// Computes until there is nothing to compute.
    pub fn compute(&mut self) {
        while let Some(job) = self.jobs.pop() {
            self.machine.finished(job.run(Means::default()), self.now);
            self.collect();
        }
    }

    /// The answers since the last call, all to evaluations.
    pub fn results(&mut self) -> Vec<Evaluated> {
        self.replies
            .drain(..)
            .map(|(_, message)| match message {
                ToTool::Evaluated(message) => message,
                other => panic!("{other:?}"),
            })
            .collect()
    }

    /// The answers since the last call, all of batches.
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

    /// Whether the server answers a discovery of a tool.
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
        ToTool::Failed(_) => None,
    }
}

pub fn bits(values: &[f64]) -> Vec<u64> {
    values.iter().map(|value| value.to_bits()).collect()
}
