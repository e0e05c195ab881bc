//! What the pool decides: messages and time in, actions out, no I/O.
//!
//! Discovery goes out in rounds, each with its own hash. Every fitting server that answers gets one episode at a time,
//! and the next one as soon as its fitness is there. An episode that fails is tried again, on another server if there
//! is one. Results are kept by task, so that the order of arrival leaves no trace.

use std::collections::{HashMap, HashSet, VecDeque};
use std::time::{Duration, Instant};

use serde_json::{Map, Value};
use swarmwright_protocol::{
    Control, Discovery, EpisodeHasher, Fitness, Message, ParametersMessage, Presence,
    ReadingWriter, SensorReading, ServerMessage, Topic, Topics,
};

use crate::offers::{Answer, Demand, Duty, Offers};
use crate::run::Run;
use crate::task::{Attempt, Outcome, Task};

/// Pause between two rounds of discovery while no server is there; it doubles up to `LATER_ROUND`.
const FIRST_ROUND: Duration = Duration::from_millis(100);
const LATER_ROUND: Duration = Duration::from_secs(2);
/// Rounds whose answers are still understood.
const ROUNDS: usize = 16;
/// How long a server that sent a message that was refused may take to send a better one.
const AFTER_REFUSAL: Duration = Duration::from_secs(2);
/// After how long silence is worth a word.
const SILENCE: Duration = Duration::from_secs(1);
const COMPLAINTS: usize = 1000;

/// What the machine wants done.
#[derive(Debug, Clone, PartialEq)]
pub enum Action {
    /// Publish with QoS 0.
    Publish(Topic, Vec<u8>),
    /// Tell the user.
    Warn(String),
}

/// What the machine is to know at the start.
#[derive(Debug, Clone)]
pub struct Config {
    /// What a server must offer.
    pub demand: Demand,
    /// Sent to the server before each episode, with `seed` replaced by the episode's.
    pub parameters: Map<String, Value>,
    /// Who asks, unique among the tools on the broker.
    pub tool: String,
    /// Topic names.
    pub topics: Topics,
    /// Whether servers are to show their runs.
    pub visual: bool,
    /// How long a server may be silent in an episode.
    pub step_timeout: Duration,
    /// How often an episode is tried.
    pub attempts: u32,
    /// The first instance number; random, so that no two tools use the same hashes.
    pub first_instance: u64,
}

/// The decisions of one optimization tool.
pub struct Machine {
    config: Config,
    offers: Offers,
    discovery_hasher: EpisodeHasher,
    rounds: VecDeque<(String, u64)>,
    round: u64,
    instance: u64,
    next_round: Instant,
    round_pause: Duration,
    /// Parameters and hasher of each episode seed.
    episodes: Vec<(Map<String, Value>, EpisodeHasher)>,
    agents: Option<u64>,
    tasks: Vec<Task>,
    tries: Vec<u32>,
    /// Servers on which a task failed: others are preferred.
    failed_on: HashMap<usize, Vec<u64>>,
    queue: VecDeque<usize>,
    runs: HashMap<String, Run>,
    outcomes: Vec<Option<Outcome>>,
    done: usize,
    journal: Vec<(Attempt, Instant)>,
    complaints: HashSet<String>,
    actions: Vec<Action>,
    /// Since when there is work and no server for it.
    lonely_since: Option<Instant>,
}

impl Machine {
    /// A machine that knows no server yet.
    #[must_use]
    pub fn new(config: Config, now: Instant) -> Self {
        let agents = config
            .parameters
            .get("numAgents")
            .and_then(Value::as_f64)
            .or_else(|| {
                #[expect(
                    clippy::cast_precision_loss,
                    reason = "a list is far shorter than 2^53"
                )]
                config
                    .parameters
                    .get("agents")
                    .and_then(Value::as_array)
                    .map(|agents| agents.len() as f64)
            });
        #[expect(
            clippy::cast_possible_truncation,
            clippy::cast_sign_loss,
            reason = "checked to be a number of agents"
        )]
        let agents = agents
            .filter(|&agents| agents >= 1.0 && agents < 1e9)
            .map(|agents| agents as u64);
        Self {
            discovery_hasher: EpisodeHasher::new(&config.demand.simulation, &config.parameters),
            offers: Offers::default(),
            rounds: VecDeque::new(),
            round: 0,
            instance: config.first_instance,
            next_round: now,
            round_pause: FIRST_ROUND,
            episodes: Vec::new(),
            agents,
            tasks: Vec::new(),
            tries: Vec::new(),
            failed_on: HashMap::new(),
            queue: VecDeque::new(),
            runs: HashMap::new(),
            outcomes: Vec::new(),
            done: 0,
            journal: Vec::new(),
            complaints: HashSet::new(),
            actions: Vec::new(),
            lonely_since: None,
            config,
        }
    }

    /// What is to be done now; empties the list.
    pub fn actions(&mut self) -> std::vec::Drain<'_, Action> {
        self.actions.drain(..)
    }

    /// Sensors and actuators that a fitting server announces, or that the experiment says.
    #[must_use]
    pub fn sizes(&self) -> Option<(usize, usize)> {
        match (self.config.demand.sensors, self.config.demand.actuators) {
            (Some(sensors), Some(actuators)) => Some((sensors, actuators)),
            _ => self.offers.sizes(),
        }
    }

    /// Whether a fitting server is there for this tool.
    #[must_use]
    pub fn has_server(&self) -> bool {
        !self.offers.slots.is_empty()
    }

    /// A server that fits and serves somebody else.
    #[must_use]
    pub fn busy_elsewhere(&self) -> Option<String> {
        self.offers.busy_elsewhere(&self.config.demand)
    }

    /// What was required and what was found, in words.
    #[must_use]
    pub fn describe(&self) -> String {
        format!(
            "required: {}; found: {}",
            self.config.demand.describe(),
            self.offers.describe(&self.config.demand)
        )
    }

    /// Titles that the servers offer.
    #[must_use]
    pub fn titles(&self) -> Vec<String> {
        self.offers.titles()
    }

    /// Begins a block of tasks; `seeds` holds the seed of each episode.
    pub fn submit(&mut self, tasks: Vec<Task>, seeds: &[u64], now: Instant) {
        self.cancel();
        self.episodes = seeds
            .iter()
            .map(|&seed| {
                let mut parameters = self.config.parameters.clone();
                parameters.insert("seed".to_owned(), seed.into());
                let hasher = EpisodeHasher::new(&self.config.demand.simulation, &parameters);
                (parameters, hasher)
            })
            .collect();
        self.queue = (0..tasks.len()).collect();
        self.tries = vec![0; tasks.len()];
        self.outcomes = vec![None; tasks.len()];
        self.done = 0;
        self.failed_on.clear();
        self.tasks = tasks;
        self.next_round = self.next_round.min(now + LATER_ROUND);
        self.dispatch(now);
    }

    /// Number of tasks that have ended.
    #[must_use]
    pub fn done(&self) -> usize {
        self.done
    }

    /// Whether all tasks have ended.
    #[must_use]
    pub fn finished(&self) -> bool {
        self.done == self.tasks.len()
    }

    /// The outcomes in the order of the tasks, once all have ended.
    pub fn take_outcomes(&mut self) -> Vec<Outcome> {
        self.tasks.clear();
        self.done = 0;
        std::mem::take(&mut self.outcomes)
            .into_iter()
            .flatten()
            .collect()
    }

    /// The attempts made since the last call, each with its start.
    pub fn take_journal(&mut self) -> Vec<(Attempt, Instant)> {
        std::mem::take(&mut self.journal)
    }

    /// Gives up all work: ends the runs and frees their servers.
    pub fn cancel(&mut self) {
        let mut hashes: Vec<String> = self.runs.keys().cloned().collect();
        hashes.sort();
        for hash in hashes {
            if let Some(run) = self.runs.remove(&hash) {
                self.end_run(run.server, &hash);
                if let Some(slot) = self.offers.slots.get_mut(&run.server) {
                    slot.duty = Duty::Idle;
                }
            }
        }
        self.queue.clear();
        self.tasks.clear();
        self.outcomes.clear();
        self.done = 0;
    }

    /// Frees all servers that this tool still holds.
    pub fn release(&mut self) {
        self.cancel();
        let held: Vec<(u64, String)> = self
            .offers
            .slots
            .iter()
            .filter_map(|(id, slot)| Some((*id, slot.last_hash.clone()?)))
            .collect();
        for (server, hash) in held {
            self.end_run(server, &hash);
        }
        self.offers.slots.clear();
    }

    fn end_run(&mut self, server: u64, hash: &str) {
        let control = self.control(server, hash.to_owned(), false);
        self.actions
            .push(Action::Publish(Topic::Control, control.encode()));
    }

    fn control(&self, server: u64, hash: String, run: bool) -> Control {
        Control {
            server,
            simulation: Some(self.config.demand.simulation.clone()),
            simulation_hash: hash,
            run,
            visual: run && self.config.visual,
            tool: Some(self.config.tool.clone()),
        }
    }

    /// A message came in. Retained messages are leftovers of somebody's past, except presence.
    pub fn receive(&mut self, topic: &str, payload: &[u8], retained: bool, now: Instant) {
        let Some(kind) = self.config.topics.parse(topic) else {
            return;
        };
        if retained && kind != Topic::Presence {
            return self.complain(format!(
                "ignoring a retained message on {topic}; remove it with: mosquitto_pub -r -n -t {topic}"
            ));
        }
        if kind == Topic::Presence && payload.is_empty() {
            let id = topic
                .rsplit('/')
                .next()
                .and_then(|id| id.parse().ok())
                .unwrap_or(u64::MAX);
            if let Some(hash) = self.offers.left(id) {
                self.fail_run(&hash, format!("server {id} left"), true, now);
            }
            return;
        }
        if kind == Topic::Sensor {
            match SensorReading::decode(payload) {
                Ok(sensor) => self.sensor(&sensor, now),
                Err(error) => self.undecodable(topic, payload, &error.to_string(), now),
            }
            return;
        }
        match Message::decode(kind, payload) {
            Ok(Message::Fitness(fitness)) => self.fitness(&fitness, now),
            Ok(Message::Server(message)) => self.server(message, now),
            Ok(Message::Presence(presence)) => self.presence(presence, now),
            Ok(_) => {}
            Err(error) => self.undecodable(topic, payload, &error.to_string(), now),
        }
    }

    fn server(&mut self, message: ServerMessage, now: Instant) {
        let Some((_, round)) = self
            .rounds
            .iter()
            .find(|(hash, _)| *hash == message.simulation_hash)
        else {
            return;
        };
        let (id, round) = (message.server, *round);
        match self.offers.answered(message, round, &self.config.demand) {
            Answer::Welcome => self.dispatch(now),
            Answer::Known => {}
            Answer::Unfit(None) => {}
            Answer::Unfit(Some(reason)) => self.warn(format!("server {id} answered, but {reason}")),
            Answer::Twins(hash, news) => {
                if news {
                    self.warn(format!("two servers answer to the id {id}, so neither is used; give one another --id"));
                }
                if let Some(hash) = hash {
                    self.end_run(id, &hash);
                    self.fail_run(
                        &hash,
                        format!("two servers answer to the id {id}"),
                        false,
                        now,
                    );
                }
            }
        }
    }

    fn presence(&mut self, presence: Presence, now: Instant) {
        let (ended, discover) = self.offers.present(presence, &self.config.tool);
        if let Some((hash, reason, own_fault)) = ended {
            let begun = self.runs.get(&hash).is_some_and(Run::begun);
            if own_fault || !begun {
                if let Some(run) = self.runs.get(&hash) {
                    self.offers.remove(run.server);
                }
                self.fail_run(&hash, reason, own_fault, now);
            }
        }
        if discover {
            self.next_round = self.next_round.min(now);
        }
    }

    fn sensor(&mut self, sensor: &SensorReading, now: Instant) {
        let Some(run) = self.runs.get_mut(&*sensor.simulation_hash) else {
            return;
        };
        match run.answer(sensor, now) {
            Ok(actuator) => self
                .actions
                .push(Action::Publish(Topic::Actuator, actuator)),
            Err(reason) => {
                let server = run.server;
                run.refused = Some((now, reason.clone()));
                self.complain(format!(
                    "refusing a sensor message of server {server}: {reason}"
                ));
            }
        }
    }

    fn fitness(&mut self, message: &Fitness, now: Instant) {
        let Some(run) = self.runs.remove(&message.simulation_hash) else {
            return;
        };
        if let Some(slot) = self.offers.slots.get_mut(&run.server) {
            slot.duty = Duty::Idle;
            slot.failures = 0;
        }
        self.record(&run, None, now);
        self.settle(run.task, Outcome::Fitness(message.fitness));
        self.dispatch(now);
    }

    /// A message that is none of the protocol's: if it names a run of ours, its server gets little time for a better one.
    fn undecodable(&mut self, topic: &str, payload: &[u8], error: &str, now: Instant) {
        if payload.len() <= swarmwright_protocol::MAX_PAYLOAD {
            let text = String::from_utf8_lossy(payload);
            if let Some((_, run)) = self
                .runs
                .iter_mut()
                .find(|(hash, _)| text.contains(hash.as_str()))
            {
                run.refused = Some((now, format!("message on {topic}: {error}")));
            }
        }
        self.complain(format!("refusing a message on {topic}: {error}"));
    }

    /// Gives every idle server an episode.
    fn dispatch(&mut self, now: Instant) {
        if self.queue.is_empty() {
            return;
        }
        let idle: Vec<u64> = self
            .offers
            .slots
            .iter()
            .filter(|(_, slot)| slot.duty == Duty::Idle)
            .map(|(id, _)| *id)
            .collect();
        for server in idle {
            let Some(task) = self.next_task(server) else {
                continue;
            };
            self.start(task, server, now);
        }
    }

    /// The first task in the queue that this server has not failed; or, if all servers have, the first.
    fn next_task(&mut self, server: u64) -> Option<usize> {
        let usable = |task: &usize| {
            self.failed_on.get(task).is_none_or(|failed| {
                !failed.contains(&server)
                    || self.offers.slots.keys().all(|other| failed.contains(other))
            })
        };
        let position = self.queue.iter().position(usable)?;
        self.queue.remove(position)
    }

    fn start(&mut self, task: usize, server: u64, now: Instant) {
        let (parameters, hasher) = &self.episodes[self.tasks[task].episode];
        let hash = hasher.hash(self.instance);
        self.instance += 1;
        let message = ParametersMessage {
            server,
            simulation_hash: hash.clone(),
            parameters: parameters.clone(),
        };
        self.actions
            .push(Action::Publish(Topic::Parameters, message.encode()));
        let control = self.control(server, hash.clone(), true);
        self.actions
            .push(Action::Publish(Topic::Control, control.encode()));
        self.tries[task] += 1;
        let prototype = self.tasks[task].controller.clone();
        let writer = ReadingWriter::actuator(&self.config.demand.simulation, &hash);
        let (tried, agents) = (self.tries[task], self.agents);
        self.runs.insert(
            hash.clone(),
            Run::new(task, server, tried, prototype, agents, writer, now),
        );
        if let Some(slot) = self.offers.slots.get_mut(&server) {
            slot.duty = Duty::Running(hash.clone());
            slot.last_hash = Some(hash);
        }
    }

    /// A run is over without fitness. Its task is tried again, or has failed; a try that was `counted` used one up.
    fn fail_run(&mut self, hash: &str, reason: String, counted: bool, now: Instant) {
        let Some(run) = self.runs.remove(hash) else {
            return;
        };
        self.record(&run, Some(reason.clone()), now);
        if counted {
            self.failed_on.entry(run.task).or_default().push(run.server);
        } else {
            self.tries[run.task] -= 1;
        }
        if self.tries[run.task] >= self.config.attempts {
            let tries = self.tries[run.task];
            self.warn(format!(
                "an evaluation failed after {tries} attempts: {reason}"
            ));
            self.settle(run.task, Outcome::Failed(reason));
        } else {
            self.queue.push_front(run.task);
        }
        self.dispatch(now);
    }

    fn settle(&mut self, task: usize, outcome: Outcome) {
        if self.outcomes[task].replace(outcome).is_none() {
            self.done += 1;
        }
    }

    fn record(&mut self, run: &Run, error: Option<String>, now: Instant) {
        let task = &self.tasks[run.task];
        let attempt = Attempt {
            candidate: task.candidate,
            episode: task.episode,
            server: run.server,
            attempt: run.attempt,
            steps: run.steps(),
            started: 0.0,
            seconds: now.saturating_duration_since(run.started).as_secs_f64(),
            error,
        };
        self.journal.push((attempt, run.started));
    }

    fn deadline(&self, run: &Run) -> Instant {
        let silent = run.heard + self.config.step_timeout;
        run.refused
            .as_ref()
            .map_or(silent, |(at, _)| silent.min(*at + AFTER_REFUSAL))
    }

    /// The next time at which `tick` is needed, if no message comes first.
    #[must_use]
    pub fn next_tick(&self) -> Instant {
        let runs = self.runs.values().map(|run| self.deadline(run)).min();
        [runs, self.offers.next_unbench()]
            .into_iter()
            .flatten()
            .fold(self.next_round, Instant::min)
    }

    /// Time has passed.
    pub fn tick(&mut self, now: Instant) {
        let mut late: Vec<String> = self
            .runs
            .iter()
            .filter(|(_, run)| self.deadline(run) <= now)
            .map(|(hash, _)| hash.clone())
            .collect();
        late.sort();
        for hash in late {
            let Some(run) = self.runs.get(&hash) else {
                continue;
            };
            let (server, waiting) = (run.server, run.waiting_for(now));
            let reason = run
                .refused
                .as_ref()
                .map_or(waiting, |(_, reason)| format!("server {server}: {reason}"));
            self.warn(format!("{reason}; the episode is tried again elsewhere"));
            self.end_run(server, &hash);
            self.offers.bench(server, &reason, now);
            self.fail_run(&hash, reason, true, now);
        }
        self.offers.unbench(now);
        if self.next_round <= now {
            self.discover(now);
        }
        self.dispatch(now);
        let lonely = !self.finished() && self.runs.is_empty();
        self.lonely_since = lonely.then(|| self.lonely_since.unwrap_or(now));
    }

    /// How long there has been work and no server for it.
    #[must_use]
    pub fn lonely(&self, now: Instant) -> Duration {
        self.lonely_since
            .map_or(Duration::ZERO, |since| now.saturating_duration_since(since))
    }

    fn discover(&mut self, now: Instant) {
        self.round += 1;
        let hash = self.discovery_hasher.hash(self.instance);
        self.instance += 1;
        self.rounds.push_back((hash.clone(), self.round));
        if self.rounds.len() > ROUNDS {
            self.rounds.pop_front();
        }
        let discovery = Discovery {
            simulation: self.config.demand.simulation.clone(),
            simulation_hash: hash,
            requirements: self.config.demand.requirements.clone(),
            tool: Some(self.config.tool.clone()),
        };
        self.actions
            .push(Action::Publish(Topic::Discovery, discovery.encode()));
        self.round_pause = if self.has_server() {
            LATER_ROUND
        } else {
            (self.round_pause * 2).min(LATER_ROUND)
        };
        self.next_round = now + self.round_pause;
    }

    /// The connection broke: the runs on it are lost, and nobody's fault.
    pub fn disconnected(&mut self, now: Instant) {
        self.offers.clear();
        let mut hashes: Vec<String> = self.runs.keys().cloned().collect();
        hashes.sort();
        for hash in hashes {
            self.fail_run(
                &hash,
                "the connection to the broker broke".to_owned(),
                false,
                now,
            );
        }
    }

    /// The connection is back.
    pub fn connected(&mut self, now: Instant) {
        self.round_pause = FIRST_ROUND;
        self.next_round = now;
    }

    /// What is waited for, in words; empty while everything moves.
    #[must_use]
    pub fn waiting_for(&self, now: Instant) -> String {
        if self.finished() {
            return String::new();
        }
        let slowest = self.runs.values().min_by_key(|run| (run.heard, run.server));
        match slowest {
            Some(run) if now.saturating_duration_since(run.heard) >= SILENCE => {
                run.waiting_for(now)
            }
            Some(_) => String::new(),
            None => {
                let seconds = self.lonely(now).as_secs_f64();
                let busy = self
                    .busy_elsewhere()
                    .map_or_else(String::new, |busy| format!(" ({busy})"));
                if seconds >= SILENCE.as_secs_f64() {
                    format!("no server for {seconds:.1} s{busy}")
                } else {
                    String::new()
                }
            }
        }
    }

    fn warn(&mut self, text: String) {
        self.actions.push(Action::Warn(text));
    }

    /// A warning that is made only once, however often its cause comes back.
    fn complain(&mut self, text: String) {
        if self.complaints.len() < COMPLAINTS && self.complaints.insert(text.clone()) {
            self.warn(text);
        }
    }
}
