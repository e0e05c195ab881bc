//! One budget of memory for everything that clients make the broker keep.
//!
//! Counted are, by the capacity of their buffers: what is on its way to each client, packets that have not come whole, and what
//! TLS and WebSocket hold; and by size: sessions with their subscriptions and messages, and retained messages. When a quarter of
//! the budget is left, sessions without a connection are ended, the one that has been alone longest first; clients whose messages
//! have to be kept (retained, or for readers that are behind) are read later; and of clients that take nothing the one that holds most is disconnected. When nothing is left, that is done
//! without looking whether it takes anything. Who holds most is asked of accounts first (of addresses, where there are no
//! accounts), and then of the connections of that account, so that many small connections do not drive out one that is large.

use super::complaints::Kind;
use super::link::Link;
use super::{Hub, STANDSTILL};
use std::collections::HashMap;
use std::time::{Duration, Instant};

/// What a connection takes that sends and gets nothing, bytes, about.
const CONNECTION: usize = 4096;
/// Sessions without a connection that are kept.
const ABSENT: usize = 4096;
/// Whoever published within this time what has to be kept is read later when memory is short.
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

    /// The buffers of a connection outside the hub: packets that have not come whole, TLS, WebSocket.
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

    /// To be called when what is remembered of a client may have changed.
    pub(super) fn recount_session(&mut self, session: usize) {
        let session = &mut self.sessions[session];
        let size = session.size();
        self.used = self.used + size - std::mem::replace(&mut session.counted, size);
    }

    /// Makes room, where the budget is used up or nearly so.
    pub(super) fn relieve(&mut self, now: Instant) {
        while self.absent > ABSENT || (self.is_short() && self.absent > 0) {
            let Some(oldest) = self.longest_absent() else {
                break;
            };
            let client = self.sessions[oldest].client_id.clone();
            self.complaints.say(Kind::Full, now, || {
                format!("client {client}: its session is forgotten, too much is kept for clients that are away")
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
                    "the broker's memory ({budget} MiB) is used up; who holds most is disconnected"
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

    /// Of the account that holds most, the connection that holds most.
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
    let asked = link.asked.as_ref().map_or(0, |connect| connect.len());
    let size = CONNECTION + link.out.capacity() + link.buffers + asked;
    *used = *used + size - std::mem::replace(&mut link.counted, size);
}
