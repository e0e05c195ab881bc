//! What the pool decides: messages and time in, actions out, no I/O.
//!
//! The [`Scheduler`] owns parts with private fields and routes events between them. Parts do not know the scheduler, and
//! import each other in one direction only (`tests/layers.rs`): `queue` (pieces, results, attribution of failures),
//! `modes` (work in flight), `fleet` (servers, their offers, health and capacity), `limits` (how much the broker takes),
//! `audit`, `messages`, `outbox`, `outlook`. Decisions that need several parts are made on a `View` of them: `share`
//! (how much work a server gets), `speculation` (what is worth a backup copy).
//!
//! The other files are the routes, parts of the scheduler itself: `events` (messages and time), `servers` (discovery and
//! presence), `dispatch`, `settle` (results), `retry`, `attribution`, `agreement` (audits), `backup`, `duplicates` (two
//! servers with one id), `supervised` (processes that are watched), and `modes/{stepwise, batched, offloaded}`.
//!
//! Discovery goes out in rounds, each with its own hash. Every fitting server that answers gets work, in the fastest way
//! that it offers, and more as soon as it has done some (`dispatch`). What fails is tried again, on another server if
//! there is one. Results are kept by candidate and episode, so that the order of arrival leaves no trace.

mod agreement;
mod attribution;
mod audit;
mod backup;
mod dispatch;
mod duplicates;
mod events;
pub(crate) mod fleet;
pub(crate) mod holdings;
mod job;
mod limits;
mod messages;
mod modes;
pub(crate) mod outbox;
mod outlook;
pub(crate) mod queue;
mod recheck;
mod retry;
mod servers;
mod settle;
mod share;
mod speculation;
mod status;
mod supervised;
mod view;

use std::time::Instant;

use swarmwright_protocol::Topic;

use crate::config::Config;
use crate::counts::Counts;
use crate::journal::{Attempt, Journal};
use crate::scheduler::audit::Audits;
use crate::scheduler::fleet::Fleet;
use crate::scheduler::fleet::discovery::Discovery;
use crate::scheduler::fleet::duplicates::Unproven;
use crate::scheduler::fleet::processes::Processes;
use crate::scheduler::job::Job;
use crate::scheduler::limits::Limits;
use crate::scheduler::messages::Messages;
use crate::scheduler::modes::in_flight::InFlight;
use crate::scheduler::modes::request::Request;
pub use crate::scheduler::outbox::Action;
use crate::scheduler::outbox::Outbox;
use crate::scheduler::outlook::Outlook;
use crate::scheduler::queue::ledger::Ledger;
use crate::scheduler::queue::results::{Results, Settled};
use crate::scheduler::recheck::Recheck;
use crate::scheduler::view::View;
use crate::work::{Work, WorkError};

/// The decisions of one optimization tool.
pub struct Scheduler {
    config: Config,
    /// Servers.
    fleet: Fleet,
    discovery: Discovery,
    processes: Processes,
    unproven: Unproven,
    /// The work: what is queued, in flight, waits for an audit, or done.
    ledger: Ledger,
    in_flight: InFlight,
    audits: Audits,
    /// How often work was submitted.
    work_number: u64,
    /// When to look again for an idle server.
    recheck: Recheck,
    /// Why the work may not end.
    outlook: Outlook,
    /// How much the broker takes.
    limits: Limits,
    messages: Messages,
    outbox: Outbox,
    journal: Journal,
    counts: Counts,
    /// The factor by which a busy machine slows down what runs on it, at least 1.
    slowdown: f64,
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
            journal: Journal::default(),
            outbox: Outbox::default(),
            messages: Messages::new(&config),
            limits: Limits::default(),
            counts: Counts::default(),
            recheck: Recheck::default(),
            outlook: Outlook::default(),
            audits: Audits::default(),
            work_number: 0,
            slowdown: 1.0,
            config,
        }
    }

    /// The broker takes no larger packets than of so many bytes: requests are kept below.
    pub fn set_largest_packet(&mut self, bytes: usize) {
        self.limits.set_packet(bytes);
    }

    /// Sets the factor by which a busy machine slows down what runs on it: silence is strange only after as many times as long.
    pub fn set_slowdown(&mut self, slowdown: f64) {
        self.slowdown = slowdown.max(1.0);
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
        self.config
            .demand
            .set_controllers(work.kind(), work.architecture());
        for (server, reason) in self.fleet.assign(&self.config.demand) {
            self.outbox
                .warn(format!("server {server} is not used: it {reason}"));
        }
        self.settle_sizes();
        self.outlook.begin();
        self.fleet.new_work();
        self.work_number += 1;
        self.limits.begin(self.beside(&work));
        self.ledger = Ledger::new(work, self.config.demand.metrics.len());
        self.discovery.work_began(now);
        self.dispatch(now);
    }

    /// The run begins with the servers that are there: those that announce other numbers of sensors or actuators than most
    /// of them are not used.
    pub(crate) fn settle_sizes(&mut self) {
        for (server, reason) in self.fleet.settle_sizes() {
            self.outbox
                .warn(format!("server {server} is not used: it {reason}"));
        }
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
        self.ledger.work().map_or(0, Work::len)
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
        self.take_all().0
    }

    /// As [`take_results`](Self::take_results), and the work that was submitted last.
    pub fn take_all(&mut self) -> (Results, Option<Work>) {
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
            let mut offloaded = false;
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
                        _ => offloaded = true,
                    },
                }
            }
            if offloaded {
                self.let_go(server);
            }
        }
        self.ledger = Ledger::default();
        self.audits.clear();
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

    /// Starts or ends an episode; a server that listens on its own topic hears it there, and no other one.
    pub(crate) fn control(&mut self, server: u64, hash: String, run: bool) {
        // Of two servers with one id it is this one that is meant.
        let instance = run.then(|| self.fleet.instance(server)).flatten();
        let control = self
            .messages
            .control(&self.config, server, instance, hash, run);
        let payload = control.encode();
        if self.fleet.hears_own_topic(server) {
            self.outbox.push(Action::Control { server, payload });
        } else {
            self.publish(Topic::Control, payload);
        }
    }

    /// Why the work cannot be done, however often it is tried: a part of it is larger than the broker takes.
    #[must_use]
    pub fn hopeless(&self) -> Option<&str> {
        self.limits.hopeless()
    }

    /// Tells the user once what was learnt of how much the broker takes.
    pub(crate) fn tell_of_limits(&mut self) {
        if let Some(text) = self.limits.take_news(self.finished()) {
            self.outbox.warn(text);
        }
    }

    /// What is known, to decide by.
    pub(crate) fn view(&self) -> View<'_> {
        View {
            config: &self.config,
            fleet: &self.fleet,
            ledger: &self.ledger,
            in_flight: &self.in_flight,
            limits: &self.limits,
            agents: self.messages.agents(),
            slowdown: self.slowdown,
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

    /// What two servers do not agree on, where it cannot be told which one is wrong.
    #[must_use]
    pub fn disagreement(&self) -> Option<&str> {
        self.outlook.disagreement()
    }
}
