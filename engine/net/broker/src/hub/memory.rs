//! One memory budget for everything that clients make the broker store.
//!
//! Messages in transit to each client, incomplete packets, and the buffers of TLS and WebSocket are counted by
//! capacity; sessions with their subscriptions and messages, and retained messages, are counted by size.
//!
//! When only a quarter of the budget is left, the broker ends sessions without a connection, longest disconnected
//! first; delays reading from clients whose messages must be stored (retained, or for readers that are behind); and
//! disconnects the largest user among the clients that accept nothing. When nothing is left, it disconnects active
//! clients, too. The largest user is determined first among accounts (or addresses, if there are no accounts), and then
//! among the connections of that account, so that many small connections do not displace a large one.

use super::complaints::Kind;
use super::link::Link;
use super::{Hub, STANDSTILL};
use std::collections::HashMap;
use std::time::{Duration, Instant};

/// Approximate memory of an idle connection in bytes.
const CONNECTION: usize = 4096;
/// Largest number of sessions without a connection.
const ABSENT: usize = 4096;
/// How long reading from a client is delayed after it published messages that are stored, if memory is short.
const FILLED: Duration = Duration::from_secs(1);

impl Hub {
    /// Returns the approximate number of bytes that all clients make the broker store.
    pub fn memory(&self) -> usize {
        self.used + self.retained.size()
    }

    /// Returns whether three quarters of the budget are used.
    pub(super) fn is_short(&self) -> bool {
        self.memory() > self.limits.memory / 4 * 3
    }

    pub(super) fn must_wait(&self, link: &Link, now: Instant) -> bool {
        let recent = |at: Instant| now.saturating_duration_since(at) < FILLED;
        link.filled.is_some_and(recent) && self.is_short()
    }

    /// Records the buffers of a connection outside the hub: incomplete packets, TLS, WebSocket.
    pub fn note_buffers(&mut self, id: usize, bytes: usize, now: Instant) {
        if let Some(link) = self.links.get_mut(id)
            && link.buffers != bytes
        {
            link.buffers = bytes;
            self.recount(id);
            self.relieve(now);
            self.settle(now);
        }
    }

    /// Updates the counts after the outbox of a connection may have changed.
    pub(super) fn recount(&mut self, id: usize) {
        recount(&mut self.links[id], &mut self.used);
    }

    /// Updates the counts after the session of a client may have changed.
    pub(super) fn recount_session(&mut self, session: usize) {
        let session = &mut self.sessions[session];
        let size = session.size();
        self.used = self.used + size - std::mem::replace(&mut session.counted, size);
    }

    /// Frees memory if the budget is nearly used up.
    pub(super) fn relieve(&mut self, now: Instant) {
        while self.absent > ABSENT || (self.is_short() && self.absent > 0) {
            let Some(oldest) = self.longest_absent() else {
                break;
            };
            let client = self.sessions[oldest].client_id.clone();
            self.complaints.say(Kind::Full, now, || {
                format!("client {client}: session ended, since too much is stored for disconnected clients")
            });
            self.end_session(oldest, now);
        }
        while self.is_short() {
            let is_over = self.memory() > self.limits.memory;
            let Some(id) = self.largest(now, is_over) else {
                return;
            };
            self.complaints.say(Kind::Full, now, || {
                let budget = self.limits.memory >> 20;
                format!(
                    "the broker's memory ({budget} MiB) is used up; disconnecting the client that uses most"
                )
            });
            self.cut_off(id, "the broker's memory is used up", now);
        }
    }

    fn longest_absent(&self) -> Option<usize> {
        let absent = self
            .sessions
            .iter()
            .filter(|(_, session)| session.link.is_none());
        absent
            .min_by_key(|(_, session)| session.left)
            .map(|(id, _)| id)
    }

    /// Returns the connection with the most memory, of the account with the most memory.
    fn largest(&self, now: Instant, any: bool) -> Option<usize> {
        let open = || {
            self.links.iter().filter(|(_, link)| {
                let is_still = now.saturating_duration_since(link.progress) >= STANDSTILL;
                !link.closing && (any || (is_still && !link.out.is_empty()))
            })
        };
        let mut accounts: HashMap<&str, usize> = HashMap::new();
        for (_, link) in open() {
            *accounts.entry(self.account(link)).or_default() += link.counted;
        }
        let (account, _) = accounts
            .into_iter()
            .max_by_key(|(name, bytes)| (*bytes, *name))?;
        open()
            .filter(|(_, link)| self.account(link) == account)
            .max_by_key(|(id, link)| (link.counted, *id))
            .map(|(id, _)| id)
    }

    /// Returns the user name, or the network of a client without one.
    fn account<'a>(&'a self, link: &'a Link) -> &'a str {
        let user = link
            .session
            .and_then(|session| self.sessions[session].user.as_deref());
        user.unwrap_or(&link.network)
    }
}

pub(super) fn recount(link: &mut Link, used: &mut usize) {
    let request = link.asked.as_ref().map_or(0, |connect| connect.len());
    let size = CONNECTION + link.out.capacity() + link.buffers + request;
    *used = *used + size - std::mem::replace(&mut link.counted, size);
}
