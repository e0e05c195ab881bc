//! The broker without its sockets: bytes and time in, bytes out.
//!
//! One thread owns the hub. A *link* is a connection, a *session* what the broker remembers of a client; a link has a session
//! from its CONNECT to its end. Packets for a link collect in its outbox until the server sends them.

mod admission;
mod complaints;
mod connect;
mod lookups;
mod memory;
mod publish;
mod subscribe;
#[cfg(test)]
mod tests;

use crate::access::Access;
use crate::codec::{self, Answer, Packet, Refusal, Version, reason};
use crate::config::Limits;
use crate::outbox::Outbox;
use crate::passwords::Passwords;
use crate::retained::Retained;
use crate::session::{Session, Terms};
use crate::subscriptions::Subscriptions;
use complaints::{Complaints, Kind};
use lookups::Lookup;
use publish::{Frames, Route};
use slab::Slab;
use std::collections::{HashMap, VecDeque};
use std::sync::Arc;
use std::time::{Duration, Instant};

/// A connection must introduce itself within this time.
const INTRODUCTION: Duration = Duration::from_secs(10);
/// Client identifier, will, user name and password with 64 KiB each, and properties.
const LARGEST_CONNECT: usize = 1 << 19;
/// A reader that took nothing for this long no longer slows down those who publish to it.
const STANDSTILL: Duration = Duration::from_secs(2);
/// Answers to a client's own packets, bytes, that it may leave unread; then it is read later.
const UNREAD_ANSWERS: usize = 1 << 18;

/// A reader with more bytes than this to read is behind.
const BEHIND: usize = 1 << 16;
/// What a packet costs whatever it says, and the bytes that are read, or copied for a reader, for one unit of work.
const WORK_OF_PACKET: usize = 4;
const BYTES_READ_OF_WORK: usize = 32;
const BYTES_OF_WORK: usize = 256;

/// Everything the broker knows.
pub struct Hub {
    limits: Limits,
    passwords: Option<Passwords>,
    access: Option<Access>,
    links: Slab<Link>,
    /// Connections that have not been let in, and those of them that are to be closed at once.
    strangers: usize,
    dropped: Vec<usize>,
    sessions: Slab<Session>,
    by_client: HashMap<Box<str>, usize>,
    subscriptions: Subscriptions,
    retained: Retained,
    /// Connections that wait for retained messages, in turn.
    searching: VecDeque<usize>,
    /// Who gets the messages of a topic; emptied when any subscription or session changes.
    routes: HashMap<Box<str>, Arc<[Route]>>,
    frames: Frames,
    dirty: Vec<usize>,
    doomed: Vec<usize>,
    assigned: u64,
    /// Bytes kept for links and sessions, about; see `memory`.
    used: usize,
    /// What clients' packets have cost so far; see `work`.
    work: usize,
    /// Sessions without a connection.
    absent: usize,
    complaints: Complaints,
}

/// What to do after a packet.
enum Next {
    /// Take the next one.
    Packet,
    /// Wait until the password that it brought was looked at.
    Verdict,
}

/// One connection.
pub struct Link {
    peer: String,
    /// Where it comes from, as far as that is told apart: see `admission`.
    network: Box<str>,
    /// Its CONNECT, while its password is being looked at.
    asked: Option<Box<[u8]>>,
    out: Outbox,
    /// Of what waits, answers to the client's own packets, at most: bytes.
    answers: usize,
    /// Retained messages that it is still to be sent.
    lookups: VecDeque<Lookup>,
    /// Bytes that the server holds for it beside the outbox, and all that were counted.
    buffers: usize,
    counted: usize,
    /// When it last published what the broker has to keep: retained, or for readers that are behind.
    filled: Option<Instant>,
    session: Option<usize>,
    /// It has not been let in.
    is_stranger: bool,
    terms: Terms,
    keep_alive: Option<Duration>,
    heard: Instant,
    /// Since when, or when last, the client took bytes.
    progress: Instant,
    /// The reader whose backlog this publisher waits for.
    held_by: Option<usize>,
    /// Packets that may come now, and when that was reckoned; below 0 while the client has to wait.
    allowance: f64,
    allowed_at: Instant,
    dirty: bool,
    closing: bool,
}

impl Hub {
    /// An empty broker.
    pub fn new(limits: Limits, passwords: Option<Passwords>, access: Option<Access>) -> Self {
        let retained = Retained::new(limits.retained);
        Self {
            limits,
            passwords,
            access,
            links: Slab::new(),
            strangers: 0,
            dropped: Vec::new(),
            sessions: Slab::new(),
            by_client: HashMap::new(),
            subscriptions: Subscriptions::default(),
            retained,
            searching: VecDeque::new(),
            routes: HashMap::new(),
            frames: Frames::default(),
            dirty: Vec::new(),
            doomed: Vec::new(),
            assigned: 0,
            used: 0,
            work: 0,
            absent: 0,
            complaints: Complaints::default(),
        }
    }

    /// A connection came; the number that names it until `closed`. None = too many.
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
        self.strangers += 1;
        let id = self.links.insert(Link {
            network: admission::network_of(&peer),
            peer,
            asked: None,
            out: Outbox::default(),
            answers: 0,
            lookups: VecDeque::new(),
            buffers: 0,
            counted: 0,
            filled: None,
            session: None,
            is_stranger: true,
            terms: Terms {
                version: Version::Three,
                window: 1,
                maximum_packet: usize::MAX,
            },
            keep_alive: None,
            heard: now,
            progress: now,
            held_by: None,
            allowance: f64::from(self.limits.rate),
            allowed_at: now,
            dirty: false,
            closing: false,
        });
        self.recount(id);
        Some(id)
    }

    /// Bytes came; returns how many of them were packets and are done with. The rest has to be given again, with more behind it.
    pub fn receive(&mut self, id: usize, bytes: &[u8], now: Instant) -> usize {
        let mut done = 0;
        let link = &mut self.links[id];
        // Strangers do not gain time by sending piecemeal.
        if link.session.is_some() {
            link.heard = now;
        }
        while !self.links[id].closing && self.links[id].asked.is_none() {
            let (first, head, body) = match self.frame(id, &bytes[done..]) {
                Ok(Some(frame)) => frame,
                Ok(None) => return done,
                Err(refusal) => {
                    self.refuse(id, refusal, now);
                    break;
                }
            };
            let start = done + head;
            done = start + body;
            self.links[id].allowance -= 1.0;
            self.work += WORK_OF_PACKET;
            let version = self.links[id].terms.version;
            let outcome = codec::decode(first, &bytes[start..done], version)
                .and_then(|packet| self.handle(id, packet, now));
            match outcome {
                Ok(Next::Packet) => {}
                Ok(Next::Verdict) => {
                    self.links[id].asked = Some(bytes[start..done].into());
                    self.recount(id);
                }
                Err(refusal) => self.refuse(id, refusal, now),
            }
            self.relieve(now);
            self.settle(now);
        }
        if self.links[id].closing {
            bytes.len()
        } else {
            done
        }
    }

    /// The first packet of `bytes`, where it is complete. Strangers may send a CONNECT and nothing else, at once.
    fn frame(&self, id: usize, bytes: &[u8]) -> Result<Option<(u8, usize, usize)>, Refusal> {
        let is_known = self.links[id].session.is_some();
        if !is_known && bytes.first().is_some_and(|&first| first != 0x10) {
            return Err(Refusal::protocol("the first packet must be CONNECT"));
        }
        let limit = if is_known {
            self.limits.packet
        } else {
            self.limits.packet.min(LARGEST_CONNECT)
        };
        let frame = codec::frame(bytes, limit)?;
        Ok(frame.filter(|(_, head, body)| bytes.len() >= head + body))
    }

    /// Bytes came, whatever they say.
    pub fn note_bytes(&mut self, count: usize) {
        self.work += count / BYTES_READ_OF_WORK;
    }

    /// What the packets of all clients have cost so far, in units of some 25 ns.
    pub fn work(&self) -> usize {
        self.work
    }

    /// The connection is gone.
    pub fn closed(&mut self, id: usize, now: Instant) {
        self.leave(id, true, now);
        let link = self.links.remove(id);
        self.used -= link.counted;
        if link.is_stranger {
            self.strangers -= 1;
        }
        if link.asked.is_some()
            && let Some(passwords) = &mut self.passwords
        {
            passwords.forget(id);
        }
        self.settle(now);
    }

    /// Time passed: silent clients, expired sessions, wills and messages. To be called about once a second.
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

    /// The broker stops: every client is told.
    pub fn stop(&mut self) {
        let ids: Vec<usize> = self.links.iter().map(|(id, _)| id).collect();
        for id in ids {
            let link = &mut self.links[id];
            if link.session.is_some() && !link.closing {
                let version = link.terms.version;
                codec::disconnect(
                    link.out.end(),
                    reason::SHUTTING_DOWN,
                    "the broker is stopping",
                    version,
                );
            }
            link.closing = true;
            self.mark(id);
        }
    }

    /// The connections that have bytes to send or are to be closed, each once.
    pub fn take_dirty(&mut self) -> Vec<usize> {
        let dirty = std::mem::take(&mut self.dirty);
        for &id in &dirty {
            if let Some(link) = self.links.get_mut(id) {
                link.dirty = false;
            }
        }
        dirty
    }

    /// What is to be sent on a connection.
    pub fn outbox(&mut self, id: usize) -> &mut Outbox {
        &mut self.links[id].out
    }

    /// The client took bytes.
    pub fn sent(&mut self, id: usize, count: usize, now: Instant) {
        let link = &mut self.links[id];
        link.out.sent(count);
        link.answers = link.answers.saturating_sub(count);
        link.progress = now;
        self.recount(id);
    }

    /// Is the connection to be closed once its outbox is empty?
    pub fn is_closing(&self, id: usize) -> bool {
        self.links[id].closing
    }

    /// Has this client sent more than it may, so that it is read later?
    fn is_too_fast(&mut self, id: usize, now: Instant) -> bool {
        let Some(link) = self.links.get_mut(id).filter(|link| link.allowance < 0.0) else {
            return false;
        };
        let rate = f64::from(self.limits.rate);
        let passed = now.saturating_duration_since(link.allowed_at).as_secs_f64();
        link.allowance = (link.allowance + rate * passed).min(rate);
        link.allowed_at = now;
        link.allowance < 0.0
    }

    /// Should this client not be read for now: because it is too fast, does not read the answers to what it sent, waits for retained
    /// messages, or publishes while memory is short or a reader that does read is far behind?
    pub fn is_held(&mut self, id: usize, now: Instant) -> bool {
        if self.is_too_fast(id, now) {
            return true;
        }
        // The connection may have ended since it was noted as readable.
        let Some(link) = self.links.get(id) else {
            return false;
        };
        if link.asked.is_some() || link.is_behind() || self.must_wait(link, now) {
            return true;
        }
        let Some(reader) = link.held_by else {
            return false;
        };
        let held = self.links.get(reader).is_some_and(|reader| {
            !reader.closing
                && reader.out.len() > self.limits.backlog / 2
                && now - reader.progress < STANDSTILL
        });
        if !held {
            self.links[id].held_by = None;
        }
        held
    }

    fn handle(&mut self, id: usize, packet: Packet<'_>, now: Instant) -> Result<Next, Refusal> {
        let packet = match packet {
            Packet::Connect(connect) => return self.connect(id, &connect, now),
            other => other,
        };
        let Some(session) = self.links[id].session else {
            return Err(Refusal::protocol("the first packet must be CONNECT"));
        };
        match packet {
            Packet::Connect(_) => {}
            Packet::Publish(publish) => self.published(id, session, &publish, now)?,
            Packet::Acknowledge(kind, packet, code) => {
                self.acknowledged(id, session, kind, packet, code, now)
            }
            Packet::Subscribe {
                id: packet,
                identifier,
                filters,
            } => self.subscribe(id, session, packet, identifier, &filters, now),
            Packet::Unsubscribe {
                id: packet,
                filters,
            } => self.unsubscribe(id, session, packet, &filters),
            Packet::Ping => self.answer(id, |out, _| codec::pingresp(out)),
            Packet::Disconnect {
                reason,
                session_expiry,
            } => self.goodbye(id, session, reason, session_expiry, now)?,
        }
        Ok(Next::Packet)
    }

    fn acknowledged(
        &mut self,
        id: usize,
        session: usize,
        kind: Answer,
        packet: u16,
        code: u8,
        now: Instant,
    ) {
        let remembered = &mut self.sessions[session];
        let known = |known| {
            if known {
                reason::SUCCESS
            } else {
                reason::UNKNOWN_PACKET_ID
            }
        };
        let reply = match kind {
            Answer::Acknowledged | Answer::Complete => {
                remembered.finish(packet);
                None
            }
            Answer::Received if code >= 0x80 => {
                remembered.finish(packet);
                None
            }
            Answer::Received => Some((Answer::Release, known(remembered.received(packet)))),
            Answer::Release => Some((Answer::Complete, known(remembered.inbound.remove(&packet)))),
        };
        if let Some((kind, code)) = reply {
            self.answer(id, |out, version| {
                codec::acknowledge(out, kind, packet, code, version);
            });
        }
        let link = &mut self.links[id];
        self.sessions[session].advance(&mut link.out, link.terms, now);
        self.mark(id);
        self.recount_session(session);
    }

    /// Appends an answer to a client's own packet.
    fn answer(&mut self, id: usize, write: impl FnOnce(&mut Vec<u8>, Version)) {
        let link = &mut self.links[id];
        let before = link.out.len();
        write(link.out.end(), link.terms.version);
        link.answers += link.out.len() - before;
        self.mark(id);
    }

    /// Says in the log what a client did.
    fn complain(&mut self, kind: Kind, session: usize, now: Instant, what: impl std::fmt::Display) {
        let client = &self.sessions[session].client_id;
        self.complaints
            .say(kind, now, || format!("client {client}: {what}"));
    }

    /// Ends a connection for something its client did, and says why: to the client and in the log.
    fn refuse(&mut self, id: usize, refusal: Refusal, now: Instant) {
        let link = &mut self.links[id];
        if link.closing {
            return;
        }
        match link.session {
            Some(session) => {
                let client = &self.sessions[session].client_id;
                self.complaints.say(Kind::Disconnected, now, || {
                    format!(
                        "client {client} at {}: {}; disconnected",
                        link.peer, refusal.what
                    )
                });
                codec::disconnect(
                    link.out.end(),
                    refusal.reason,
                    refusal.what,
                    link.terms.version,
                );
            }
            None => {
                self.complaints.say(Kind::Refused, now, || {
                    format!("{}: {}; refused", link.peer, refusal.what)
                });
                codec::connack(
                    link.out.end(),
                    link.terms.version,
                    false,
                    refusal.reason,
                    None,
                    refusal.what,
                );
            }
        }
        link.closing = true;
        self.mark(id);
        self.leave(id, true, now);
    }

    /// Has the server look at this connection, to which something was appended.
    fn mark(&mut self, id: usize) {
        mark(&mut self.links[id], id, &mut self.dirty);
        self.recount(id);
    }

    /// Disconnects those that fell too far behind while messages were routed.
    fn settle(&mut self, now: Instant) {
        while let Some(id) = self.doomed.pop() {
            if self.links.get(id).is_some_and(|link| !link.closing) {
                self.cut_off(id, "too far behind in reading", now);
            }
        }
    }

    /// Disconnects a client and drops what waits for it, which would not reach it before the connection ends.
    fn cut_off(&mut self, id: usize, what: &'static str, now: Instant) {
        let link = &mut self.links[id];
        let behind = link.out.len() + link.buffers;
        self.complaints.say(Kind::Disconnected, now, || {
            format!("{}: {behind} bytes kept for it", link.peer)
        });
        link.out.abandon();
        link.lookups.clear();
        // The server lets go of them when it sees that the connection is closing.
        link.buffers = 0;
        self.recount(id);
        self.refuse(id, Refusal::new(reason::QUOTA_EXCEEDED, what), now);
    }
}

impl Link {
    /// Leaves too many answers unread, or is still being sent what it asked for.
    fn is_behind(&self) -> bool {
        self.answers > UNREAD_ANSWERS || !self.lookups.is_empty()
    }

    fn lateness(&self, now: Instant) -> Option<Refusal> {
        // A client that is read later may have a PINGREQ among the bytes that were not read; taking bytes is a sign of life.
        let alive = if self.is_behind() {
            self.heard.max(self.progress)
        } else {
            self.heard
        };
        let silence = now.saturating_duration_since(alive);
        match (self.session, self.keep_alive) {
            _ if self.closing => None,
            (None, _) if silence > INTRODUCTION && self.asked.is_none() => {
                Some(Refusal::protocol("no CONNECT within 10 s"))
            }
            // A publisher that is held back may have a PINGREQ among the bytes that were not read.
            (Some(_), Some(limit)) if silence > limit && self.held_by.is_none() => {
                Some(Refusal::new(
                    reason::KEEP_ALIVE_TIMEOUT,
                    "silent for one and a half keep-alive intervals",
                ))
            }
            _ => None,
        }
    }
}

fn mark(link: &mut Link, id: usize, dirty: &mut Vec<usize>) {
    if !link.dirty {
        link.dirty = true;
        dirty.push(id);
    }
}
