//! What the pool decides: messages and time in, actions out, no I/O.
//!
//! Discovery goes out in rounds, each with its own hash. Every fitting server that answers gets work, in the fastest way
//! that it offers, and more as soon as it has done some (`dispatch`). What fails is tried again, on another server if
//! there is one. Results are kept by candidate and episode, so that the order of arrival leaves no trace.

pub(crate) mod attribution;
pub(crate) mod audit;
pub(crate) mod dispatch;
pub(crate) mod duplicates;
pub(crate) mod fleet;
pub(crate) mod holdings;
pub(crate) mod job;
pub(crate) mod limits;
pub(crate) mod messages;
pub(crate) mod modes;
pub(crate) mod outbox;
pub(crate) mod queue;
pub(crate) mod retry;
pub(crate) mod servers;
pub(crate) mod speculation;
pub(crate) mod status;

use std::collections::BTreeMap;
use std::time::Instant;

use swarmwright_protocol::{Control, Message, SensorReading, ToTool, Topic};

use crate::config::Config;
use crate::counts::Counts;
use crate::journal::{Attempt, Journal};
use crate::scheduler::audit::Check;
use crate::scheduler::fleet::Fleet;
use crate::scheduler::fleet::discovery::Discovery;
use crate::scheduler::fleet::duplicates::Unproven;
use crate::scheduler::fleet::processes::Processes;
use crate::scheduler::job::Job;
use crate::scheduler::limits::Limits;
use crate::scheduler::modes::in_flight::InFlight;
use crate::scheduler::modes::request::Request;
use crate::scheduler::queue::ledger::{Ledger, Results, Settled};
use crate::scheduler::retry::Blame;
use crate::work::{Work, WorkError};
use messages::Messages;
pub use outbox::Action;
use outbox::Outbox;

/// The decisions of one optimization tool.
pub struct Scheduler {
    pub(crate) config: Config,
    pub(crate) fleet: Fleet,
    pub(crate) discovery: Discovery,
    pub(crate) processes: Processes,
    pub(crate) unproven: Unproven,
    pub(crate) ledger: Ledger,
    pub(crate) in_flight: InFlight,
    /// When a server last said that this work cannot be done.
    pub(crate) refused_at: Option<Instant>,
    pub(crate) journal: Journal,
    pub(crate) outbox: Outbox,
    pub(crate) messages: Messages,
    /// Since when there is work and no server for it.
    pub(crate) lonely_since: Option<Instant>,
    /// Bytes of the largest packet that the broker takes, as far as it says so.
    pub(crate) packet: usize,
    /// What was learnt of how much it takes.
    pub(crate) limits: Limits,
    /// Bytes of a request for blocks of the work beside genomes and seeds.
    pub(crate) beside: usize,
    pub(crate) counts: Counts,
    /// When to look again whether an idle server should get work that others should do first, or a copy of theirs.
    pub(crate) look_at: Option<Instant>,
    /// Results that wait for a second server's, by evaluation.
    pub(crate) checks: BTreeMap<usize, Check>,
    /// How often work was submitted.
    pub(crate) work_number: u64,
    /// Two servers do not agree, and nobody can tell which one is wrong.
    pub(crate) disagreement: Option<String>,
    /// Since when all servers have failed what succeeded before.
    pub(crate) broken_since: Option<Instant>,
    /// Servers that are to vouch for what they said, and are not there: since when.
    pub(crate) absent: BTreeMap<u64, Instant>,
    /// Servers are lost again and again, and nobody can tell why.
    pub(crate) undecided: Option<String>,
}

impl Scheduler {
    /// A scheduler that knows no server yet.
    #[must_use]
    pub fn new(config: Config, now: Instant) -> Self {
        Self {
            fleet: Fleet::default(),
            discovery: Discovery::new(now),
            processes: Processes::default(),
            unproven: Unproven::default(),
            ledger: Ledger::default(),
            in_flight: InFlight::new(config.first_instance),
            refused_at: None,
            journal: Journal::default(),
            outbox: Outbox::default(),
            messages: Messages::new(&config),
            lonely_since: None,
            packet: usize::MAX,
            limits: Limits::default(),
            beside: 0,
            counts: Counts::default(),
            look_at: None,
            checks: BTreeMap::new(),
            work_number: 0,
            disagreement: None,
            broken_since: None,
            absent: BTreeMap::new(),
            undecided: None,
            config,
        }
    }

    /// The broker takes no larger packets than of so many bytes: requests are kept below.
    pub fn set_largest_packet(&mut self, bytes: usize) {
        self.packet = bytes;
    }

    /// What is to be done now; empties the list.
    pub fn actions(&mut self) -> std::vec::Drain<'_, Action> {
        self.outbox.drain()
    }

    pub(crate) fn publish(&mut self, topic: Topic, payload: Vec<u8>) {
        if matches!(topic, Topic::Parameters | Topic::Actuator) {
            self.limits.sent_whole(payload.len());
        }
        self.outbox.publish(topic, payload);
    }

    /// How many warnings were not made since the last call, as others had been that were the same.
    pub fn take_repeated(&mut self) -> Vec<String> {
        self.outbox.take_repeated()
    }

    /// Begins a block of work.
    pub fn submit(&mut self, work: Work, now: Instant) {
        self.cancel();
        self.messages.begin(&self.config, work.seeds());
        self.config.demand.kind = work.kind().map(str::to_owned);
        for (server, reason) in self.fleet.assign(&self.config.demand) {
            self.outbox
                .warn(format!("server {server} is not used: it {reason}"));
        }
        self.refused_at = None;
        self.disagreement = None;
        self.broken_since = None;
        self.absent.clear();
        self.undecided = None;
        self.fleet.new_work();
        self.work_number += 1;
        self.beside = self.beside(&work);
        self.limits.begin();
        self.ledger = Ledger::new(work, self.config.demand.metrics.len());
        self.discovery.work_began(now);
        self.dispatch(now);
    }

    /// Adds candidates to the work that is under way; see [`Work::extend`].
    ///
    /// # Errors
    /// As [`Work::extend`].
    pub fn extend(&mut self, genomes: &[f32], now: Instant) -> Result<(), WorkError> {
        self.ledger.extend(genomes)?;
        self.dispatch(now);
        Ok(())
    }

    /// The candidates of which all episodes have ended since the last call.
    pub fn take_settled(&mut self) -> Settled {
        self.hands_out();
        self.ledger.take_settled()
    }

    /// Number of evaluations that have been asked for.
    #[must_use]
    pub fn total(&self) -> usize {
        self.ledger.work.as_ref().map_or(0, Work::len)
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

    /// What came out for every candidate in every episode, once all have ended.
    pub fn take_results(&mut self) -> Results {
        self.hands_out();
        self.ledger.take_results()
    }

    /// The attempts made since the last call, each with its start.
    pub fn take_journal(&mut self) -> Vec<(Attempt, Instant)> {
        self.journal.take()
    }

    /// Gives up all work: ends what the servers have to do.
    pub fn cancel(&mut self) {
        let requests = self.in_flight.clear();
        for (server, jobs) in self.fleet.take_all_jobs() {
            let mut blocks = false;
            for job in &jobs {
                match job {
                    Job::Episode(hash) => {
                        self.in_flight.remember(hash, server, false);
                        self.end_run(server, hash);
                    }
                    Job::Request(number) => match requests.get(number) {
                        Some(Request {
                            batch: Some(batch), ..
                        }) => {
                            let step = batch.steps().saturating_sub(1);
                            self.end_batch(server, *number, step);
                        }
                        _ => blocks = true,
                    },
                }
            }
            if blocks {
                self.let_go(server);
            }
        }
        self.ledger = Ledger::default();
        self.checks.clear();
    }

    /// Frees all servers that this tool still holds.
    pub fn release(&mut self) {
        self.cancel();
        for (server, hash) in self.fleet.release() {
            let hash = hash.unwrap_or_else(|| self.messages.new_hash());
            self.end_run(server, &hash);
        }
    }

    /// Frees a server, and ends what it still has to do for this tool.
    pub(crate) fn let_go(&mut self, server: u64) {
        let last = self.fleet.last_hash(server);
        let hash = last.unwrap_or_else(|| self.messages.new_hash());
        self.end_run(server, &hash);
    }

    pub(crate) fn control(&self, server: u64, hash: String, run: bool) -> Control {
        // Of two servers with one id it is this one that is meant.
        let instance = run.then(|| self.fleet.instance(server)).flatten();
        self.messages
            .control(&self.config, server, instance, hash, run)
    }

    /// A message came in. Retained messages are leftovers of somebody's past, except presence.
    pub fn receive(&mut self, topic: &str, payload: &[u8], retained: bool, now: Instant) {
        let Some(kind) = self.config.topics.parse(topic) else {
            return;
        };
        if retained && kind != Topic::Presence {
            return self.outbox.warn_once(format!(
                "ignoring a retained message on {topic}; remove it with: mosquitto_pub -r -n -t {topic}"
            ));
        }
        if kind == Topic::Presence && payload.is_empty() {
            let id = topic
                .rsplit('/')
                .next()
                .and_then(|id| id.parse().ok())
                .unwrap_or(u64::MAX);
            let jobs = self.fleet.left(id);
            return self.fail_jobs(jobs, &format!("server {id} left"), Blame::Nobody, now);
        }
        if kind == Topic::Sensor {
            match SensorReading::decode(payload) {
                Ok(sensor) => self.sensor(&sensor, now),
                Err(error) => self.undecodable(topic, payload, &error, now),
            }
            return;
        }
        if kind == Topic::ToTool {
            if !topic.ends_with(self.messages.reply()) {
                return;
            }
            match ToTool::decode(payload) {
                Ok(message) => self.answered(message, now),
                Err(error) => self
                    .outbox
                    .warn_once(format!("refusing an answer to this tool: {error}")),
            }
            return;
        }
        match Message::decode(kind, payload) {
            Ok(Message::Fitness(fitness)) => self.fitness(&fitness, now),
            Ok(Message::Server(message)) => self.server(message, now),
            Ok(Message::Presence(presence)) => self.presence(presence, now),
            Ok(_) => {}
            Err(error) => self.undecodable(topic, payload, &error, now),
        }
    }

    /// The answer to [`Action::AskBroker`]: whether the broker at `address` holds small packets back, or why that could
    /// not be found out.
    pub fn broker_holds_back(&mut self, found: Result<bool, String>, address: &str) {
        if let Some(text) = self.fleet.lag().told(found, address) {
            self.outbox.warn(text);
        }
    }

    pub(crate) fn config(&self) -> &Config {
        &self.config
    }

    pub(crate) fn fleet(&self) -> &Fleet {
        &self.fleet
    }

    pub(crate) fn journal(&self) -> &Journal {
        &self.journal
    }

    /// Incidents so far.
    #[must_use]
    pub fn counts(&self) -> &Counts {
        &self.counts
    }

    /// What two servers do not agree on, where nobody can tell which one is wrong.
    #[must_use]
    pub fn disagreement(&self) -> Option<&str> {
        self.disagreement.as_deref()
    }

    /// The next time at which `tick` is needed, if no message comes first.
    #[must_use]
    pub fn next_tick(&self) -> Instant {
        let deadline = self.in_flight.next_deadline(&self.config);
        let doubt = self.next_doubt();
        [deadline, doubt, self.look_at, self.fleet.next_unbench()]
            .into_iter()
            .flatten()
            .fold(self.discovery.next(), Instant::min)
    }

    /// Time has passed.
    pub fn tick(&mut self, now: Instant) {
        self.late_episodes(now);
        self.late_requests(now);
        self.doubt(now);
        self.fleet.unbench(now);
        self.settle_unchecked(now);
        self.limits.tick(now);
        if self.discovery.next() <= now {
            if self.wants_servers() {
                self.discover(now);
            } else {
                self.discovery.postpone(now);
            }
        }
        self.dispatch(now);
        let lonely = !self.finished() && self.in_flight.is_empty();
        self.lonely_since = lonely.then(|| self.lonely_since.unwrap_or(now));
    }

    /// Whether more servers are of use, or one should say that it is still there. A server that others use takes a
    /// question for a wish.
    fn wants_servers(&self) -> bool {
        let looking = self.work_number == 0 || !self.finished();
        let few = self.fleet.is_empty() || self.fleet.slots().any(|(_, slot)| !slot.usable());
        // Another tool may have been faster on its server; see `beaten`.
        let waiting = self.in_flight.episodes().any(|one| !one.begun());
        // Whether others are silent, too, tells what to think of one that is lost.
        let suspects = self.ledger.suspicions.has_suspects();
        self.ledger.queued() > 0 || waiting || suspects || (looking && few)
    }

    /// The connection broke: the work under way on it is lost, and nobody's fault.
    pub fn disconnected(&mut self, now: Instant) {
        self.counts.broker_losses += 1;
        self.fleet.clear();
        let jobs = self.in_flight.jobs();
        let reason = "the connection to the broker broke";
        self.fail_jobs(jobs, reason, Blame::Broker, now);
    }
}
