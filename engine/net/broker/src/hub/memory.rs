//! One budget of memory for everything that clients make the broker keep.
//!
//! Counted by the capacity of their buffers are messages in transit to each client, incomplete packets, and what
//! TLS and WebSocket hold; counted by size are sessions with their subscriptions and messages, and retained messages. When a quarter of
//! the budget is left, sessions without a connection are ended, longest disconnected first; clients whose messages
//! have to be stored (retained, or for readers that are behind) are read later; and among clients that accept nothing the one that occupies most is disconnected. When nothing is left,
//! active clients are disconnected, too. The largest user is determined between accounts first (between addresses, where there are no
//! accounts), and then between the connections of that account, so that many small connections do not displace a large one.

use super::complaints::Kind;
use super::link::Link;
use super::{Hub, STANDSTILL};
use std::collections::HashMap;
use std::time::{Duration, Instant};

/// Approximate memory of an idle connection, bytes.
const CONNECTION: usize = 4096;
/// Sessions without a connection that are kept.
const ABSENT: usize = 4096;
/// Time within which a client that published stored messages is read later if memory is short.
const FILLED: Duration = Duration::from_secs(1);

impl Hub {
    /// Bytes that all clients together make the broker keep, about.
    pub fn memory(&self) -> usize {
        self.used + self.retained.size()
    }

    /// Three quarters of the budget are used.
    pub(super) fn is_short(&self) -> bool {
        self.memory() > self.limits.memory / 4 * 3
    }

    pub(super) fn must_wait(&self, link: &Link, now: Instant) -> bool {
        let recent = |at: Instant| now.saturating_duration_since(at) < FILLED;
        link.filled.is_some_and(recent) && self.is_short()
    }

    /// The buffers of a connection outside the hub: incomplete packets, TLS, WebSocket.
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

    /// To be called when the outbox of a connection may have changed.
    pub(super) fn recount(&mut self, id: usize) {
        recount(&mut self.links[id], &mut self.used);
    }

    /// To be called when the session of a client may have changed.
    pub(super) fn recount_session(&mut self, session: usize) {
        let session = &mut self.sessions[session];
        let size = session.size();
        self.used = self.used + size - std::mem::replace(&mut session.counted, size);
    }

    /// Frees memory, where the budget is used up or nearly so.
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

    /// The connection with the most memory, of the account with the most memory.
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

    /// The user name, or the address of a client that has none.
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
