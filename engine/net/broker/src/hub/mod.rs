//! The broker without sockets and clock: received bytes and time as input, bytes to send as output.
//!
//! One thread owns the hub. A *link* is a connection; a *session* is the state that the broker stores for a client. A
//! link has a session from its CONNECT to its end. Packets for a link collect in its outbox until the server sends
//! them.

mod admission;
mod complaints;
mod connect;
mod ending;
mod link;
mod lookups;
mod memory;
mod pace;
mod packets;
mod publish;
mod subscribe;
#[cfg(test)]
mod tests;

use crate::access::Access;
use crate::config::Limits;
use crate::outbox::Outbox;
use crate::passwords::{Keys, Passwords};
use crate::retained::Retained;
use crate::session::Session;
use crate::subscriptions::Subscriptions;
use complaints::{Complaints, Kind};
use link::{Link, mark};
use publish::{Frames, Route};
use slab::Slab;
use std::collections::{HashMap, VecDeque};
use std::sync::Arc;
use std::time::{Duration, Instant};
use swarmwright_packets::Refusal;

/// Time without accepting bytes after which a reader no longer slows down its publishers.
const STANDSTILL: Duration = Duration::from_secs(2);
/// Number of unread bytes above which a reader is behind.
const BEHIND: usize = 1 << 16;
/// Work of a packet in units, and the numbers of bytes that can be read, or copied for a reader, per unit.
const WORK_OF_PACKET: usize = 4;
const BYTES_READ_OF_WORK: usize = 32;
const BYTES_OF_WORK: usize = 256;

/// State of the broker.
pub struct Hub {
    limits: Limits,
    passwords: Option<Passwords>,
    keys: Option<Keys>,
    access: Option<Access>,
    links: Slab<Link>,
    /// Number of unauthenticated connections, and those of them to close at once.
    unauthenticated: usize,
    dropped: Vec<usize>,
    sessions: Slab<Session>,
    by_client: HashMap<Box<str>, usize>,
    subscriptions: Subscriptions,
    retained: Retained,
    /// Connections that wait for retained messages, in the order of service.
    searching: VecDeque<usize>,
    /// Subscribers of recent topics; cleared when any subscription or session changes.
    routes: HashMap<Box<str>, Arc<[Route]>>,
    frames: Frames,
    dirty: Vec<usize>,
    to_cut_off: Vec<usize>,
    assigned: u64,
    /// Approximate number of bytes stored for links and sessions; see `memory`.
    used: usize,
    /// Work of all packets so far; see `work`.
    work: usize,
    /// Number of sessions without a connection.
    absent: usize,
    complaints: Complaints,
}

impl Hub {
    /// Creates a broker without clients.
    pub fn new(
        limits: Limits,
        passwords: Option<Passwords>,
        keys: Option<Keys>,
        access: Option<Access>,
    ) -> Self {
        let retained = Retained::new(limits.retained);
        Self {
            limits,
            passwords,
            keys,
            access,
            links: Slab::new(),
            unauthenticated: 0,
            dropped: Vec::new(),
            sessions: Slab::new(),
            by_client: HashMap::new(),
            subscriptions: Subscriptions::default(),
            retained,
            searching: VecDeque::new(),
            routes: HashMap::new(),
            frames: Frames::default(),
            dirty: Vec::new(),
            to_cut_off: Vec::new(),
            assigned: 0,
            used: 0,
            work: 0,
            absent: 0,
            complaints: Complaints::default(),
        }
    }

    /// Accepts a connection and returns its number, valid until `closed`; `None` if there are too many.
    pub fn open(&mut self, peer: String, now: Instant) -> Option<usize> {
        let clients = self.links.len();
        if clients >= self.limits.clients || self.memory() > self.limits.memory {
            self.complaints.say(Kind::Refused, now, || {
                let why = if clients >= self.limits.clients {
                    format!("{clients} clients are connected already")
                } else {
                    "the broker's memory is used up".into()
                };
                format!("{peer}: refused, {why}")
            });
            return None;
        }
        self.unauthenticated += 1;
        let id = self.links.insert(Link::new(peer, self.limits.rate, now));
        self.recount(id);
        Some(id)
    }

    /// Records that the connection came through a socket whose file only permitted users may open.
    pub fn note_private(&mut self, id: usize) {
        self.links[id].is_private = true;
    }

    /// Counts received bytes as work, whatever their content.
    pub fn note_bytes(&mut self, count: usize) {
        self.work += count / BYTES_READ_OF_WORK;
    }

    /// Returns the work that packets of all clients have caused so far, in units of about 25 ns.
    pub fn work(&self) -> usize {
        self.work
    }

    /// Removes a connection that has been closed.
    pub fn closed(&mut self, id: usize, now: Instant) {
        self.leave(id, true, now);
        let link = self.links.remove(id);
        self.used -= link.counted;
        if link.is_unauthenticated {
            self.unauthenticated -= 1;
        }
        if link.asked.is_some()
            && let Some(passwords) = &mut self.passwords
        {
            passwords.forget(id);
        }
        self.settle(now);
    }

    /// Handles silent clients and expired sessions, wills and messages. Must be called about once a second.
    pub fn tick(&mut self, now: Instant) {
        let late: Vec<(usize, Refusal)> = self
            .links
            .iter()
            .filter_map(|(id, link)| Some((id, link.lateness(now)?)))
            .collect();
        for (id, refusal) in late {
            self.refuse(id, refusal, now);
        }
        self.expire_sessions(now);
        self.retained.sweep(now);
        if let Some(passwords) = &mut self.passwords {
            passwords.sweep(now);
        }
        self.complaints.sweep(now);
        self.relieve(now);
        self.settle(now);
    }

    /// Takes the connections that have bytes to send or must be closed, each once.
    pub fn take_dirty(&mut self) -> Vec<usize> {
        let dirty = std::mem::take(&mut self.dirty);
        for &id in &dirty {
            if let Some(link) = self.links.get_mut(id) {
                link.dirty = false;
            }
        }
        dirty
    }

    /// Returns the outbox of a connection.
    pub fn outbox(&mut self, id: usize) -> &mut Outbox {
        &mut self.links[id].out
    }

    /// Records that the client accepted bytes.
    pub fn sent(&mut self, id: usize, count: usize, now: Instant) {
        let link = &mut self.links[id];
        link.out.sent(count);
        link.answers = link.answers.saturating_sub(count);
        link.progress = now;
        self.recount(id);
    }

    /// Returns whether the connection must be closed once its outbox is empty.
    pub fn is_closing(&self, id: usize) -> bool {
        self.links[id].closing
    }

    /// Logs an incident with a client.
    fn complain(
        &mut self,
        kind: Kind,
        session: usize,
        now: Instant,
        complaint: impl std::fmt::Display,
    ) {
        let session = &self.sessions[session];
        let peer = session.link.map(|link| self.links[link].peer.as_str());
        self.complaints.say(kind, now, || {
            let (client, user) = (&session.client_id, session.user.as_deref());
            let account = user.map(|user| format!(" of account {user}"));
            let address = peer.map(|peer| format!(" at {peer}"));
            format!(
                "client {client}{}{}: {complaint}",
                account.unwrap_or_default(),
                address.unwrap_or_default()
            )
        });
    }

    /// Marks a connection to which bytes were appended, so that the server sends them.
    fn mark(&mut self, id: usize) {
        mark(&mut self.links[id], id, &mut self.dirty);
        self.recount(id);
    }
}
