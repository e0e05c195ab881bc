//! Reasons why the current work may not finish.

use std::collections::{BTreeMap, BTreeSet};
use std::time::{Duration, Instant};

#[derive(Debug, Default)]
pub(crate) struct Outlook {
    /// Since when there has been work but no server for it.
    unserved_since: Option<Instant>,
    /// When a server last refused the work.
    refused_at: Option<Instant>,
    /// A disagreement of two servers, if it is unknown which one is wrong.
    disagreement: Option<String>,
    /// Since when all servers have been silent or have failed all their work.
    broken_since: Option<Instant>,
    /// Offline servers whose success is awaited, and since when they have been offline.
    absent: BTreeMap<u64, Instant>,
    /// Message about servers that are lost repeatedly for an unknown reason.
    undecided: Option<String>,
}

impl Outlook {
    /// Prepares for new work.
    pub fn begin(&mut self) {
        *self = Self {
            unserved_since: self.unserved_since,
            ..Self::default()
        };
    }

    /// Records whether there is work but no server for it.
    pub fn unserved(&mut self, unserved: bool, now: Instant) {
        self.unserved_since = unserved.then(|| self.unserved_since.unwrap_or(now));
    }

    /// Returns how long there has been work but no server for it.
    pub fn unserved_for(&self, now: Instant) -> Duration {
        let since = self.unserved_since;
        since.map_or(Duration::ZERO, |since| now.saturating_duration_since(since))
    }

    /// Records that a server refused the work.
    pub fn refused(&mut self, now: Instant) {
        self.refused_at = Some(now);
    }

    /// Returns when a server last refused the work.
    pub fn refused_at(&self) -> Option<Instant> {
        self.refused_at
    }

    /// Records that two servers disagree; only the first message is kept.
    pub fn disagree(&mut self, message: String) {
        self.disagreement.get_or_insert(message);
    }

    pub fn disagreement(&self) -> Option<&str> {
        self.disagreement.as_deref()
    }

    /// Records that some server may be of use.
    pub fn some_work(&mut self) {
        self.broken_since = None;
    }

    /// Records that all servers are silent or fail all their work.
    pub fn all_broken(&mut self, now: Instant) {
        self.broken_since.get_or_insert(now);
    }

    pub fn broken_since(&self) -> Option<Instant> {
        self.broken_since
    }

    /// Keeps only the servers whose success is still awaited.
    pub fn await_only(&mut self, servers: &BTreeSet<u64>) {
        self.absent.retain(|server, _| servers.contains(server));
    }

    /// Records that a server is online.
    pub fn present(&mut self, server: u64) {
        self.absent.remove(&server);
    }

    /// Records that a server is offline. Returns since when.
    pub fn absent(&mut self, server: u64, now: Instant) -> Instant {
        *self.absent.entry(server).or_insert(now)
    }

    /// Records that servers are lost repeatedly; only the first message is kept.
    pub fn cannot_decide(&mut self, message: String) {
        self.undecided.get_or_insert(message);
    }

    pub fn undecided(&self) -> Option<&str> {
        self.undecided.as_deref()
    }
}
