//! The decisions of the pool: messages and time as input, actions as output, no I/O.
//!
//! The [`Scheduler`] owns parts with private fields and routes events between them. Parts do not know the scheduler,
//! and import each other in one direction only (`tests/layers.rs`): `queue` (pieces, results, attribution of failures),
//! `modes` (work in flight), `fleet` (servers, their offers, health and capacity), `limits` (sizes that the broker
//! accepts), `audit`, `messages`, `outbox`, `outlook`. Decisions that need several parts take a `View` of them: `share`
//! (how much work a server gets), `speculation` (which work gets a backup copy), `probing` (which servers must prove
//! that they are sound, and whether to look for more servers).
//!
//! The remaining modules belong to the scheduler itself: `routes` lead from incoming events to the parts and between
//! parts, and `status` reports the state.
//!
//! Discovery runs in rounds, each with its own hash. Every fitting server that answers gets work in the fastest mode
//! that it offers, and more as soon as it has finished some (`dispatch`). Failed work is retried, on another server if
//! there is one. Results are stored by candidate and episode, so they do not depend on the order of arrival.

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

/// Scheduler of one optimization tool.
pub struct Scheduler {
    config: Config,
    /// Known servers.
    fleet: Fleet,
    discovery: Discovery,
    processes: Processes,
    unproven: Unproven,
    /// The work: queued, in flight, waiting for an audit, or done.
    ledger: Ledger,
    in_flight: InFlight,
    audits: Audits,
    /// Number of times that work was submitted.
    work_number: u64,
    /// When to check idle servers again.
    recheck: Recheck,
    /// Reasons why the work may not finish.
    outlook: Outlook,
    /// Sizes that the broker accepts.
    limits: Limits,
    messages: Messages,
    outbox: Outbox,
    journal: Journal,
    counts: Counts,
    /// Factor by which a busy machine slows down its programs, at least 1.
    slowdown: f64,
}

impl Scheduler {
    /// Creates a scheduler without servers.
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

    /// Sets the factor by which a busy machine slows down its programs; time limits for silence grow by it.
    pub fn set_slowdown(&mut self, slowdown: f64) {
        self.slowdown = slowdown.max(1.0);
    }

    /// Drains the actions to take now.
    pub fn actions(&mut self) -> std::vec::Drain<'_, Action> {
        self.outbox.drain()
    }

    /// Takes the warnings that were suppressed since the last call because the same had been issued before.
    pub fn take_repeated(&mut self) -> Vec<String> {
        self.outbox.take_repeated()
    }

    /// Returns the number of requested evaluations.
    #[must_use]
    pub fn total(&self) -> usize {
        self.ledger.work().map_or(0, Work::len)
    }

    /// Returns the number of evaluations that have ended.
    #[must_use]
    pub fn done(&self) -> usize {
        self.ledger.done()
    }

    /// Returns whether all evaluations have ended.
    #[must_use]
    pub fn finished(&self) -> bool {
        self.ledger.finished()
    }

    /// Takes the attempts made since the last call, each with its start.
    pub fn take_journal(&mut self) -> Vec<(Attempt, Instant)> {
        self.journal.take()
    }

    /// Returns why the work can never be done: a part of it is larger than the broker accepts.
    #[must_use]
    pub fn hopeless(&self) -> Option<&str> {
        self.limits.hopeless()
    }

    /// Returns a read-only view of the parts, for decisions.
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

    /// Returns the counts of incidents so far.
    #[must_use]
    pub fn counts(&self) -> &Counts {
        &self.counts
    }

    /// Returns the disagreement of two servers, if it is unknown which one is wrong.
    #[must_use]
    pub fn disagreement(&self) -> Option<&str> {
        self.outlook.disagreement()
    }
}
