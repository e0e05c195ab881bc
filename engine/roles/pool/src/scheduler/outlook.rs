//! Reasons for which the work under way may not come to its end.

use std::collections::{BTreeMap, BTreeSet};
use std::time::{Duration, Instant};

#[derive(Debug, Default)]
pub(crate) struct Outlook {
    /// Since when there is work and no server for it.
    unserved_since: Option<Instant>,
    /// When a server last said that this work cannot be done.
    refused_at: Option<Instant>,
    /// Two servers do not agree, and nothing tells which one is wrong.
    disagreement: Option<String>,
    /// Since when all servers have been silent, or have failed whatever they were given.
    broken_since: Option<Instant>,
    /// Servers whose success is awaited, and that are not there: since when.
    absent: BTreeMap<u64, Instant>,
    /// Servers are lost again and again, and nothing tells why.
    undecided: Option<String>,
}

impl Outlook {
    /// Other work begins.
    pub fn begin(&mut self) {
        *self = Self {
            unserved_since: self.unserved_since,
            ..Self::default()
        };
    }

    /// Notes whether there is work and no server for it.
    pub fn unserved(&mut self, unserved: bool, now: Instant) {
        self.unserved_since = unserved.then(|| self.unserved_since.unwrap_or(now));
    }

    /// How long there has been work and no server for it.
    pub fn unserved_for(&self, now: Instant) -> Duration {
        let since = self.unserved_since;
        since.map_or(Duration::ZERO, |since| now.saturating_duration_since(since))
    }

    /// A server said that this work cannot be done.
    pub fn refused(&mut self, now: Instant) {
        self.refused_at = Some(now);
    }

    /// When a server last said so.
    pub fn refused_at(&self) -> Option<Instant> {
        self.refused_at
    }

    /// Two servers do not agree; the first time is kept.
    pub fn disagree(&mut self, message: String) {
        self.disagreement.get_or_insert(message);
    }

    pub fn disagreement(&self) -> Option<&str> {
        self.disagreement.as_deref()
    }

    /// A server may be of use.
    pub fn some_work(&mut self) {
        self.broken_since = None;
    }

    /// All servers are silent, or fail whatever they are given.
    pub fn all_broken(&mut self, now: Instant) {
        self.broken_since.get_or_insert(now);
    }

    pub fn broken_since(&self) -> Option<Instant> {
        self.broken_since
    }

    /// The success of these servers alone is awaited.
    pub fn await_only(&mut self, servers: &BTreeSet<u64>) {
        self.absent.retain(|server, _| servers.contains(server));
    }

    /// A server is there.
    pub fn present(&mut self, server: u64) {
        self.absent.remove(&server);
    }

    /// A server is not there. Since when.
    pub fn absent(&mut self, server: u64, now: Instant) -> Instant {
        *self.absent.entry(server).or_insert(now)
    }

    /// Notes that servers are lost repeatedly; only the first message is kept.
    pub fn cannot_decide(&mut self, message: String) {
        self.undecided.get_or_insert(message);
    }

    pub fn undecided(&self) -> Option<&str> {
        self.undecided.as_deref()
    }
}
