//! What the pool decides: messages and time in, actions out, no I/O.
//!
//! Discovery goes out in rounds, each with its own hash. Every fitting server that answers gets work, in the fastest way
//! that it offers, and more as soon as it has done some (`dispatch`). What fails is tried again, on another server if
//! there is one. Results are kept by candidate and episode, so that the order of arrival leaves no trace.

use std::collections::{HashMap, HashSet, VecDeque};
use std::time::{Duration, Instant};

use serde_json::{Map, Value};
use swarmwright_protocol::{
    Control, Discovery, EpisodeHasher, Message, Presence, SensorReading, ServerMessage, ToTool,
    Topic, Topics,
};

use crate::ledger::{Ledger, Piece};
use crate::offers::{Answer, Demand, Job, Offers};
use crate::requests::Request;
use crate::run::Run;
use crate::work::{Attempt, Work};

/// Pause between two rounds of discovery while no server is there; it doubles up to `LATER_ROUND`.
const FIRST_ROUND: Duration = Duration::from_millis(100);
const LATER_ROUND: Duration = Duration::from_secs(2);
/// Rounds whose answers are still understood.
const ROUNDS: usize = 16;
/// After how long silence is worth a word.
const SILENCE: Duration = Duration::from_secs(1);
const COMPLAINTS: usize = 1000;
/// How long other servers may take to answer when one refused the work.
const OTHERS: Duration = Duration::from_millis(500);

/// What the machine wants done.
#[derive(Debug, Clone, PartialEq)]
pub enum Action {
    /// Publish with QoS 0.
    Publish(Topic, Vec<u8>),
    /// Publish on a server's own topic with QoS 0.
    Request {
        /// The server.
        server: u64,
        /// The request's number: the correlation data.
        request: u64,
        /// What is asked.
        payload: Vec<u8>,
    },
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
    /// Last level of the topic on which servers answer requests: letters and digits, unique like `tool`.
    pub token: String,
    /// Topic names.
    pub topics: Topics,
    /// Whether servers are to show their runs.
    pub visual: bool,
    /// How long a server may be silent in an episode.
    pub step_timeout: Duration,
    /// How often an episode is tried.
    pub attempts: u32,
    /// Most evaluations in one request.
    pub largest: usize,
    /// The first instance number; random, so that no two tools use the same hashes.
    pub first_instance: u64,
}

/// The decisions of one optimization tool.
pub struct Machine {
    pub(crate) config: Config,
    pub(crate) offers: Offers,
    discovery_hasher: EpisodeHasher,
    rounds: VecDeque<(String, u64)>,
    pub(crate) round: u64,
    pub(crate) instance: u64,
    next_round: Instant,
    round_pause: Duration,
    /// Parameters and hasher of each episode seed.
    pub(crate) episodes: Vec<(Map<String, Value>, EpisodeHasher)>,
    pub(crate) agents: Option<u64>,
    pub(crate) ledger: Ledger,
    pub(crate) runs: HashMap<String, Run>,
    pub(crate) requests: HashMap<u64, Request>,
    /// Numbers are never used twice, so that an answer that comes late is not taken for another.
    pub(crate) next_request: u64,
    /// The topic on which requests are answered, without prefix.
    pub(crate) reply: String,
    /// When a server last said that this work cannot be done.
    pub(crate) refused_at: Option<Instant>,
    journal: Vec<(Attempt, Instant)>,
    complaints: HashSet<String>,
    pub(crate) actions: Vec<Action>,
    /// Since when there is work and no server for it.
    lonely_since: Option<Instant>,
}

/// The number of agents that the parameters tell.
fn agents(parameters: &Map<String, Value>) -> Option<u64> {
    #[expect(
        clippy::cast_precision_loss,
        reason = "a list is far shorter than 2^53"
    )]
    let listed = || Some(parameters.get("agents")?.as_array()?.len() as f64);
    let agents = parameters
        .get("numAgents")
        .and_then(Value::as_f64)
        .or_else(listed)
        .filter(|agents| (1.0..1e9).contains(agents))?;
    #[expect(
        clippy::cast_possible_truncation,
        clippy::cast_sign_loss,
        reason = "checked to be a number of agents"
    )]
    Some(agents as u64)
}

impl Machine {
    /// A machine that knows no server yet.
    #[must_use]
    pub fn new(config: Config, now: Instant) -> Self {
        Self {
            agents: agents(&config.parameters),
            discovery_hasher: EpisodeHasher::new(&config.demand.simulation, &config.parameters),
            offers: Offers::default(),
            rounds: VecDeque::new(),
            round: 0,
            instance: config.first_instance,
            next_request: config.first_instance,
            reply: Topics::default().to_tool(&config.token),
            next_round: now,
            round_pause: FIRST_ROUND,
            episodes: Vec::new(),
            ledger: Ledger::default(),
            runs: HashMap::new(),
            requests: HashMap::new(),
            refused_at: None,
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

    pub(crate) fn publish(&mut self, topic: Topic, payload: Vec<u8>) {
        self.actions.push(Action::Publish(topic, payload));
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

    /// Why the work cannot be done, when all servers that are there say so.
    #[must_use]
    pub fn rejected(&self, now: Instant) -> Option<String> {
        let settled = now.saturating_duration_since(self.refused_at?) >= OTHERS;
        let alone = settled && self.busy_elsewhere().is_none();
        alone.then(|| self.offers.refused()).flatten()
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

    /// Begins a block of work.
    pub fn submit(&mut self, work: Work, now: Instant) {
        self.cancel();
        self.episodes = work
            .seeds()
            .iter()
            .map(|&seed| {
                let mut parameters = self.config.parameters.clone();
                parameters.insert("seed".to_owned(), seed.into());
                let hasher = EpisodeHasher::new(&self.config.demand.simulation, &parameters);
                (parameters, hasher)
            })
            .collect();
        self.config.demand.kind = work.kind().map(str::to_owned);
        for (server, reason) in self.offers.assign(&self.config.demand) {
            self.warn(format!("server {server} is not used: it {reason}"));
        }
        self.refused_at = None;
        self.ledger = Ledger::new(work);
        self.next_round = self.next_round.min(now + LATER_ROUND);
        self.dispatch(now);
    }

    /// Number of evaluations that have ended.
    #[must_use]
    pub fn done(&self) -> usize {
        self.ledger.done()
    }

    /// Whether all evaluations have ended.
    #[must_use]
    pub fn finished(&self) -> bool {
        self.ledger.finished()
    }

    /// The fitness of every candidate in every episode, row-major (candidates, episodes), NaN where all attempts
    /// failed; once all have ended.
    pub fn take_fitness(&mut self) -> Vec<f64> {
        self.ledger.take_fitness()
    }

    /// The attempts made since the last call, each with its start.
    pub fn take_journal(&mut self) -> Vec<(Attempt, Instant)> {
        std::mem::take(&mut self.journal)
    }

    /// Gives up all work: ends what the servers have to do.
    pub fn cancel(&mut self) {
        self.runs.clear();
        self.requests.clear();
        let slots = self.offers.slots.iter_mut();
        let jobs: Vec<(u64, Vec<Job>)> = slots
            .map(|(id, slot)| (*id, std::mem::take(&mut slot.jobs)))
            .collect();
        for (server, jobs) in jobs {
            for job in &jobs {
                if let Job::Episode(hash) = job {
                    self.end_run(server, hash);
                }
            }
            if jobs.iter().any(|job| matches!(job, Job::Request(_))) {
                self.let_go(server);
            }
        }
        self.ledger = Ledger::default();
    }

    /// Frees all servers that this tool still holds.
    pub fn release(&mut self) {
        self.cancel();
        let slots = self.offers.slots.iter();
        let held: Vec<u64> = slots
            .filter(|(_, slot)| slot.held)
            .map(|(id, _)| *id)
            .collect();
        for server in held {
            self.let_go(server);
        }
        self.offers.slots.clear();
    }

    /// Frees a server, and ends what it still has to do for this tool.
    pub(crate) fn let_go(&mut self, server: u64) {
        let last = self
            .offers
            .slots
            .get_mut(&server)
            .and_then(|slot| slot.last_hash.clone());
        let hash = last.unwrap_or_else(|| self.new_hash());
        self.end_run(server, &hash);
    }

    fn new_hash(&mut self) -> String {
        let hash = self.discovery_hasher.hash(self.instance);
        self.instance += 1;
        hash
    }

    pub(crate) fn control(&self, server: u64, hash: String, run: bool) -> Control {
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
            let jobs = self.offers.left(id);
            return self.fail_jobs(jobs, &format!("server {id} left"), true, now);
        }
        if kind == Topic::Sensor {
            match SensorReading::decode(payload) {
                Ok(sensor) => self.sensor(&sensor, now),
                Err(error) => self.undecodable(topic, payload, &error.to_string(), now),
            }
            return;
        }
        if kind == Topic::ToTool {
            if !topic.ends_with(&self.reply) {
                return;
            }
            match ToTool::decode(payload) {
                Ok(message) => self.answered(message, now),
                Err(error) => self.complain(format!("refusing an answer to this tool: {error}")),
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
            Answer::Known => self.beaten(id, round, now),
            Answer::Unfit(None) => {}
            Answer::Unfit(Some(reason)) => self.warn(format!("server {id} answered, but {reason}")),
            Answer::Twins(jobs, news) => {
                if news {
                    self.warn(format!("two servers answer to the id {id}, so neither is used; give one another --id"));
                }
                for job in &jobs {
                    if let Job::Episode(hash) = job {
                        self.end_run(id, hash);
                    }
                }
                let reason = format!("two servers answer to the id {id}");
                self.fail_jobs(jobs, &reason, false, now);
            }
        }
    }

    fn presence(&mut self, presence: Presence, now: Instant) {
        let (ended, discover) = self.offers.present(presence, &self.config.tool);
        if let Some(mut ended) = ended {
            if !ended.own_fault {
                // A run that has begun is ours; the presence is older.
                ended.jobs.retain(|job| {
                    matches!(job, Job::Episode(hash) if !self.runs.get(hash).is_some_and(Run::begun))
                });
            }
            if !ended.jobs.is_empty() {
                self.offers.remove(ended.server);
                self.fail_jobs(ended.jobs, &ended.reason, ended.own_fault, now);
            }
        }
        if discover {
            self.next_round = self.next_round.min(now);
        }
    }

    /// Jobs are over without result; see [`retry`](Self::retry).
    pub(crate) fn fail_jobs(&mut self, jobs: Vec<Job>, reason: &str, counted: bool, now: Instant) {
        for job in jobs {
            match job {
                Job::Episode(hash) => self.fail_episode(&hash, reason, counted, now),
                Job::Request(number) => self.fail_request(number, reason, counted, now),
            }
        }
        self.dispatch(now);
    }

    /// Work that brought no result is queued again, or has failed; an attempt that is `counted` used one up.
    pub(crate) fn retry(&mut self, piece: Piece, server: u64, reason: &str, counted: bool) {
        if !counted {
            return self.ledger.put_back(&piece);
        }
        let tries = piece.tries + 1;
        if tries >= self.config.attempts {
            self.warn(format!(
                "an evaluation failed after {tries} attempts: {reason}"
            ));
            return self.give_up(&piece);
        }
        let piece = piece.failed(server, self.config.attempts);
        self.ledger.put_back(&piece);
    }

    /// Evaluations that have failed for good.
    pub(crate) fn give_up(&mut self, piece: &Piece) {
        for evaluation in piece.evaluations.clone() {
            self.ledger.settle(evaluation, f64::NAN);
        }
    }

    /// A line of the journal.
    pub(crate) fn record(
        &mut self,
        attempt: Attempt,
        piece: &Piece,
        started: Instant,
        now: Instant,
    ) {
        let (candidates, episodes) = self.ledger.extent(piece);
        let attempt = Attempt {
            candidate: candidates.start,
            candidates: candidates.len(),
            episode: episodes.start,
            episodes: episodes.len(),
            attempt: piece.tries + 1,
            seconds: now.saturating_duration_since(started).as_secs_f64(),
            ..attempt
        };
        self.journal.push((attempt, started));
    }

    /// The next time at which `tick` is needed, if no message comes first.
    #[must_use]
    pub fn next_tick(&self) -> Instant {
        let runs = self.runs.values().map(|run| self.run_deadline(run)).min();
        let requests = self.requests.values().map(Request::deadline).min();
        [runs, requests, self.offers.next_unbench()]
            .into_iter()
            .flatten()
            .fold(self.next_round, Instant::min)
    }

    /// Time has passed.
    pub fn tick(&mut self, now: Instant) {
        self.late_episodes(now);
        self.late_requests(now);
        self.offers.unbench(now);
        if self.next_round <= now {
            self.discover(now);
        }
        self.dispatch(now);
        let lonely = !self.finished() && self.runs.is_empty() && self.requests.is_empty();
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
        let hash = self.new_hash();
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
        self.publish(Topic::Discovery, discovery.encode());
        self.round_pause = if self.has_server() {
            LATER_ROUND
        } else {
            (self.round_pause * 2).min(LATER_ROUND)
        };
        self.next_round = now + self.round_pause;
    }

    /// The connection broke: the work under way on it is lost, and nobody's fault.
    pub fn disconnected(&mut self, now: Instant) {
        self.offers.clear();
        let mut hashes: Vec<String> = self.runs.keys().cloned().collect();
        hashes.sort();
        let mut numbers: Vec<u64> = self.requests.keys().copied().collect();
        numbers.sort_unstable();
        let hashes = hashes.into_iter().map(Job::Episode);
        let jobs = hashes
            .chain(numbers.into_iter().map(Job::Request))
            .collect();
        self.fail_jobs(jobs, "the connection to the broker broke", false, now);
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
        let run = self.runs.values().min_by_key(|run| (run.heard, run.server));
        let request = self
            .requests
            .iter()
            .min_by_key(|(number, request)| (request.heard, **number))
            .map(|(_, request)| request);
        let is_silent = |heard: Instant| now.saturating_duration_since(heard) >= SILENCE;
        match (run, request) {
            (Some(run), other)
                if is_silent(run.heard) && other.is_none_or(|other| run.heard <= other.heard) =>
            {
                run.waiting_for(now)
            }
            (_, Some(request)) if is_silent(request.heard) => request.waiting_for(now),
            (None, None) => {
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
            _ => String::new(),
        }
    }

    pub(crate) fn warn(&mut self, text: String) {
        self.actions.push(Action::Warn(text));
    }

    /// A warning that is made only once, however often its cause comes back.
    pub(crate) fn complain(&mut self, text: String) {
        if self.complaints.len() < COMPLAINTS && self.complaints.insert(text.clone()) {
            self.warn(text);
        }
    }
}
