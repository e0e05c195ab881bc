//! A minimal server with the extensions, in virtual time, which computes at a set speed.

use std::collections::{BTreeMap, VecDeque};
use std::sync::Arc;
use std::time::{Duration, Instant};

use serde_json::{Value, json};
use swarmwright_controllers::{Architecture, Controller};
use swarmwright_protocol::{
    BatchActuators, BatchSensors, BatchStart, EXTENSION_VERSION, Evaluate, Evaluated, F32s, F64s,
    Failure, Message, Refusal, RefusalKind, ToServer, ToTool, Topic, Topics, U32s,
};
use swarmwright_worlds::{Simulation, measure, rollout};

use super::{LINE_METRICS, Line};

/// A server that answers discovery, evaluates blocks and steps batches of `Line`.
pub struct Extended {
    pub id: u64,
    pub instance: String,
    /// Whether its process ends with its connection.
    pub crashes: bool,
    pub modes: Vec<&'static str>,
    pub controllers: Vec<&'static str>,
    pub batch: usize,
    /// Time per episode, or per step of a batch.
    pub pace: Duration,
    /// Refusal of every request.
    pub refusal: Option<Refusal>,
    /// Seed of the episodes that fail.
    pub fails_on: Option<u64>,
    /// Seed of the episodes in which the metric `half` has this value; `None` omits the metric from all results.
    pub half: Option<(u64, f64)>,
    /// Weight that makes the server stop answering a block.
    pub dies_on: Option<f32>,
    /// Seconds reported for each block.
    pub seconds: Option<f64>,
    /// Kind of wrong results.
    pub wrong: Option<Wrong>,
    /// Whether everything is sent twice.
    pub twice: bool,
    /// Received requests: number and evaluations.
    pub blocks: Vec<(u64, usize)>,
    pub outgoing: VecDeque<(Instant, String, Vec<u8>)>,
    pub busy_until: Option<Instant>,
    pub batches: BTreeMap<u64, Running>,
}

/// Kinds of wrong results.
#[derive(Debug, Clone, Copy)]
pub enum Wrong {
    /// Factor on the right results.
    By(f64),
    Always(f64),
}

pub struct Running {
    reply: String,
    step: u64,
    episodes: Vec<Option<Line>>,
    seeds: Vec<u64>,
    metrics: Vec<String>,
}

impl Extended {
    pub fn new(id: u64, modes: &[&'static str]) -> Self {
        Self {
            id,
            instance: id.to_string(),
            crashes: false,
            modes: modes.to_vec(),
            controllers: vec!["layered"],
            batch: 4,
            pace: Duration::from_millis(1),
            refusal: None,
            fails_on: None,
            half: Some((u64::MAX, 0.0)),
            dies_on: None,
            seconds: None,
            wrong: None,
            twice: false,
            blocks: Vec::new(),
            outgoing: VecDeque::new(),
            busy_until: None,
            batches: BTreeMap::new(),
        }
    }

    /// Adds the requested metrics of an episode to a result.
    fn measure(
        &self,
        line: &Line,
        seed: u64,
        names: &[String],
        metrics: &mut BTreeMap<String, F64s>,
    ) {
        let mut values = vec![0.0; names.len()];
        let indices = line.description().metrics_named(names).unwrap();
        measure(line, &indices, &mut values);
        for (name, value) in names.iter().zip(values) {
            let value = match self.half {
                _ if name != "half" => value,
                Some((special, instead)) if special == seed => instead,
                Some(_) => value,
                None => continue,
            };
            metrics.entry(name.clone()).or_default().0.push(value);
        }
    }

    /// Takes the messages that are due.
    pub fn due(&mut self, now: Instant) -> Vec<(String, Vec<u8>)> {
        let mut due = Vec::new();
        while self.outgoing.front().is_some_and(|(at, ..)| *at <= now) {
            due.extend(self.outgoing.pop_front());
        }
        due.into_iter()
            .map(|(_, topic, payload)| (topic, payload))
            .collect()
    }

    pub fn next(&self) -> Option<Instant> {
        self.outgoing.front().map(|(at, ..)| *at)
    }

    fn send(&mut self, topic: String, payload: Vec<u8>, work: u32, now: Instant) {
        let start = self.busy_until.map_or(now, |until| until.max(now));
        let at = start + self.pace * work;
        self.busy_until = Some(at);
        if self.twice {
            self.outgoing
                .push_back((at, topic.clone(), payload.clone()));
        }
        self.outgoing.push_back((at, topic, payload));
    }

    pub fn receive(&mut self, topic: &str, payload: &[u8], now: Instant) {
        let kind = Topics::default().parse(topic);
        if kind == Some(Topic::Discovery) {
            let Ok(Message::Discovery(discovery)) = Message::decode(Topic::Discovery, payload)
            else {
                return;
            };
            let answer = json!({"server": self.id, "simulation_hash": discovery.simulation_hash,
                "simulations": ["line"], "capabilities": {"dimensions": 2, "swarmwright": {"version": 1,
                "modes": self.modes, "controllers": self.controllers, "batch": self.batch, "determinism": "bitwise",
                "metrics": LINE_METRICS.iter().map(|metric| metric.name.to_string()).collect::<Vec<_>>(), "instance": self.instance}}});
            let answer = answer.to_string().into_bytes();
            self.outgoing.push_back((now, "server".to_owned(), answer));
        } else if topic == Topics::default().to_server(self.id) {
            match ToServer::decode(payload).unwrap() {
                ToServer::Evaluate(message) => self.evaluate(&message, now),
                ToServer::Start(message) => self.start(&message, now),
                ToServer::Actuators(message) => self.actuate(&message, now),
            }
        }
    }

    fn evaluate(&mut self, message: &Evaluate, now: Instant) {
        let text = Value::Object(message.controller.clone()).to_string();
        let architecture = Arc::new(Architecture::from_json(&text).unwrap());
        let weights = architecture.weight_count();
        let mut answer = Evaluated {
            version: EXTENSION_VERSION,
            request: message.request,
            server: self.id,
            fitness: F64s::default(),
            metrics: BTreeMap::new(),
            failed: Vec::new(),
            error: self.refusal.clone(),
            seconds: 0.0,
        };
        let refused = answer.error.is_some();
        for (candidate, genome) in message.genomes.0.chunks_exact(weights).enumerate() {
            let controller = Controller::with_weights(&architecture, genome.into()).unwrap();
            for (episode, seed) in message.seeds.0.iter().enumerate().filter(|_| !refused) {
                if self.fails_on == Some(*seed) {
                    answer.fitness.0.push(f64::NAN);
                    for name in &message.metrics {
                        let values = answer.metrics.entry(name.clone()).or_default();
                        values.0.push(f64::NAN);
                    }
                    answer.failed.push(Failure {
                        candidate: candidate as u64,
                        episode: episode as u64,
                        reason: "a wheel came off".to_owned(),
                        stack: None,
                    });
                    continue;
                }
                let mut parameters = message.parameters.clone();
                parameters.insert("seed".into(), (*seed).into());
                let mut line = Line::new();
                let fitness = rollout(&mut line, &parameters, &controller).unwrap();
                answer.fitness.0.push(self.told(fitness));
                self.measure(&line, *seed, &message.metrics, &mut answer.metrics);
            }
        }
        let count = answer.fitness.0.len();
        self.blocks.push((message.request, count));
        if self
            .dies_on
            .is_some_and(|poison| message.genomes.0.contains(&poison))
        {
            return;
        }
        let work = u32::try_from(count).unwrap();
        let took = (self.pace * work).as_secs_f64();
        answer.seconds = self.seconds.unwrap_or(took);
        let payload = ToTool::Evaluated(answer).encode();
        self.send(message.reply.clone(), payload, work, now);
    }

    fn told(&self, fitness: f64) -> f64 {
        match self.wrong {
            None => fitness,
            Some(Wrong::By(factor)) => fitness * factor,
            Some(Wrong::Always(value)) => value,
        }
    }

    fn start(&mut self, message: &BatchStart, now: Instant) {
        assert!(message.seeds.0.len() <= self.batch);
        self.blocks.push((message.request, message.seeds.0.len()));
        let episode = |seed: &u64| {
            let mut parameters = message.parameters.clone();
            parameters.insert("seed".into(), (*seed).into());
            let mut line = Line::new();
            line.reset(&parameters).unwrap();
            Some(line)
        };
        let running = Running {
            reply: message.reply.clone(),
            step: 0,
            episodes: message.seeds.0.iter().map(episode).collect(),
            seeds: message.seeds.0.clone(),
            metrics: message.metrics.clone(),
        };
        self.batches.insert(message.request, running);
        self.sense(message.request, now);
    }

    fn actuate(&mut self, message: &BatchActuators, now: Instant) {
        let Some(running) = self.batches.get_mut(&message.request) else {
            return;
        };
        assert_eq!(message.step + 1, running.step);
        let mut actuators = &message.actuators.0[..];
        for line in running.episodes.iter_mut().flatten() {
            let (mine, rest) = actuators.split_at(line.acting().len());
            line.step(mine);
            actuators = rest;
        }
        self.sense(message.request, now);
    }

    fn sense(&mut self, request: u64, now: Instant) {
        let Some(mut running) = self.batches.remove(&request) else {
            return;
        };
        let mut message = BatchSensors {
            version: EXTENSION_VERSION,
            request,
            server: self.id,
            step: running.step,
            episodes: U32s::default(),
            agents: U32s::default(),
            sensors: F32s::default(),
            ended: U32s::default(),
            fitness: F64s::default(),
            metrics: BTreeMap::new(),
            failed: Vec::new(),
            error: self.refusal.clone(),
        };
        running.step += 1;
        for (episode, slot) in (0u32..).zip(&mut running.episodes) {
            let Some(line) = slot else { continue };
            for &agent in line.acting() {
                let mut sensors = [0.0; 2];
                line.sense(agent, &mut sensors);
                message.episodes.0.push(episode);
                message.agents.0.push(agent);
                message.sensors.0.extend(sensors);
            }
            if line.acting().is_empty() {
                message.ended.0.push(episode);
                message.fitness.0.push(self.told(line.fitness()));
                let seed = running.seeds[episode as usize];
                self.measure(line, seed, &running.metrics, &mut message.metrics);
                *slot = None;
            }
        }
        let reply = running.reply.clone();
        if !message.episodes.0.is_empty() && self.refusal.is_none() {
            self.batches.insert(request, running);
        }
        self.send(reply, ToTool::Sensors(message).encode(), 1, now);
    }
}

/// Creates a refusal of the given kind.
pub fn refusal(kind: RefusalKind, reason: &str) -> Option<Refusal> {
    Some(Refusal {
        kind,
        reason: reason.to_owned(),
    })
}
