//! What the hub keeps of one connection.

use super::lookups::Lookup;
use crate::outbox::Outbox;
use crate::session::Terms;
use std::collections::VecDeque;
use std::time::{Duration, Instant};
use swarmwright_packets::{Refusal, Version, reason};

/// A connection must send its CONNECT within this time.
const INTRODUCTION: Duration = Duration::from_secs(10);
/// Answers, bytes, that a client may leave unread; beyond that it is read later.
const UNREAD_ANSWERS: usize = 1 << 18;

/// One connection.
pub struct Link {
    pub(super) peer: String,
    /// The network that it comes from, see `admission`.
    pub(super) network: Box<str>,
    /// Its CONNECT, while its password is being checked.
    pub(super) asked: Option<Box<[u8]>>,
    pub(super) out: Outbox,
    /// Upper bound on the answers to the client's packets among the waiting bytes.
    pub(super) answers: usize,
    /// Searches for retained messages that are not complete.
    pub(super) lookups: VecDeque<Lookup>,
    /// Bytes that the server holds for it beside the outbox, and all that were counted.
    pub(super) buffers: usize,
    pub(super) counted: usize,
    /// When it last published messages that the broker has to store: retained, or for readers that are behind.
    pub(super) filled: Option<Instant>,
    pub(super) session: Option<usize>,
    /// Its CONNECT has not been accepted yet.
    pub(super) is_unauthenticated: bool,
    /// It came through a Unix socket.
    pub(super) is_private: bool,
    pub(super) terms: Terms,
    pub(super) keep_alive: Option<Duration>,
    pub(super) heard: Instant,
    /// When the client last accepted bytes.
    pub(super) progress: Instant,
    /// The reader whose backlog this publisher waits for.
    pub(super) held_by: Option<usize>,
    /// Packets that the client may send now, and when that was computed; below 0 while the client has to wait.
    pub(super) allowance: f64,
    pub(super) allowed_at: Instant,
    pub(super) dirty: bool,
    pub(super) closing: bool,
}

impl Link {
    /// A connection that has not sent its CONNECT. rate: packets that it may send in a second.
    pub(super) fn new(peer: String, rate: u32, now: Instant) -> Self {
        Self {
            network: super::admission::network_of(&peer),
            peer,
            asked: None,
            out: Outbox::default(),
            answers: 0,
            lookups: VecDeque::new(),
            buffers: 0,
            counted: 0,
            filled: None,
            session: None,
            is_unauthenticated: true,
            is_private: false,
            terms: Terms {
                version: Version::Three,
                window: 1,
                // Until its CONNECT has said it, no reasons as text.
                maximum_packet: swarmwright_packets::BARE,
            },
            keep_alive: None,
            heard: now,
            progress: now,
            held_by: None,
            allowance: f64::from(rate),
            allowed_at: now,
            dirty: false,
            closing: false,
        }
    }

    /// Whether it leaves too many answers unread, or still receives the retained messages that it subscribed to.
    pub(super) fn is_behind(&self) -> bool {
        self.answers > UNREAD_ANSWERS || !self.lookups.is_empty()
    }

    pub(super) fn lateness(&self, now: Instant) -> Option<Refusal> {
        // A client that is read later may have sent a PINGREQ that was not read; accepting bytes shows that it is alive.
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
            // A publisher that is held back may have sent a PINGREQ that was not read.
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

pub(super) fn mark(link: &mut Link, id: usize, dirty: &mut Vec<usize>) {
    if !link.dirty {
        link.dirty = true;
        dirty.push(id);
    }
}
