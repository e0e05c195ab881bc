//! What the pool decides: messages and time in, actions out, no I/O.
//!
//! The [`Scheduler`] owns parts with private fields and routes events between them. Parts do not know the scheduler, and
//! import each other in one direction only (`tests/layers.rs`): `queue` (pieces, results, attribution of failures),
//! `modes` (work in flight), `fleet` (servers, their offers, health and capacity), `limits` (how much the broker takes),
//! `audit`, `messages`, `outbox`, `outlook`. Decisions that need several parts are made on a `View` of them: `share`
//! (how much work a server gets), `speculation` (what is worth a backup copy), `probing` (which servers are to show that
//! they are sound, and whether more are looked for).
//!
//! The scheduler's own files are `routes`, which lead from what comes in to the parts and from part to part, and `status`
//! (how it stands).
//!
//! Discovery goes out in rounds, each with its own hash. Every fitting server that answers gets work, in the fastest way
//! that it offers, and more as soon as it has done some (`dispatch`). What fails is tried again, on another server if
//! there is one. Results are kept by candidate and episode, so that the order of arrival leaves no trace.

mod audit;
pub(crate) mod fleet;
mod job;
mod limits;
mod messages;
mod modes;
pub(crate) mod outbox;
mod outlook;
mod probing;
pub(crate) mod queue;
mod recheck;
mod routes;
mod share;
mod speculation;
pub(crate) mod status;
mod view;

use std::time::Instant;

use crate::config::Config;
use crate::counts::Counts;
use crate::journal::{Attempt, Journal};
use crate::scheduler::audit::Audits;
use crate::scheduler::fleet::Fleet;
use crate::scheduler::fleet::discovery::Discovery;
use crate::scheduler::fleet::duplicates::Unproven;
use crate::scheduler::fleet::processes::Processes;
use crate::scheduler::limits::Limits;
use crate::scheduler::messages::Messages;
use crate::scheduler::modes::in_flight::InFlight;
pub use crate::scheduler::outbox::Action;
use crate::scheduler::outbox::Outbox;
use crate::scheduler::outlook::Outlook;
use crate::scheduler::queue::ledger::Ledger;
use crate::scheduler::recheck::Recheck;
use crate::scheduler::view::View;
use crate::work::Work;

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

    /// Sets the largest packet that the broker accepts, in bytes; requests are kept smaller.
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

    /// Number of warnings suppressed since the last call, because the same had been issued before.
    pub fn take_repeated(&mut self) -> Vec<String> {
        self.outbox.take_repeated()
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

    /// The attempts made since the last call, each with its start.
    pub fn take_journal(&mut self) -> Vec<(Attempt, Instant)> {
        self.journal.take()
    }

    /// Why the work cannot be done, however often it is tried: a part of it is larger than the broker takes.
    #[must_use]
    pub fn hopeless(&self) -> Option<&str> {
        self.limits.hopeless()
    }

    /// What is known, to decide by.
    pub(crate) fn view(&self) -> View<'_> {
        View {
            config: &self.config,
            fleet: &self.fleet,
            processes: &self.processes,
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

    /// The disagreement of two servers, if it is unknown which one is wrong.
    #[must_use]
    pub fn disagreement(&self) -> Option<&str> {
        self.outlook.disagreement()
    }
}
