//! The hub's state of one connection.

use super::lookups::Lookup;
use crate::outbox::Outbox;
use crate::session::Terms;
use std::collections::VecDeque;
use std::time::{Duration, Instant};
use swarmwright_packets::{Refusal, Version, reason};

/// Time within which a connection must send its CONNECT.
const INTRODUCTION: Duration = Duration::from_secs(10);
/// Largest number of bytes of answers that a client may leave unread before reading from it is delayed.
const UNREAD_ANSWERS: usize = 1 << 18;

/// State of one connection.
pub struct Link {
    pub(super) peer: String,
    /// Network of the peer, see `admission`.
    pub(super) network: Box<str>,
    /// CONNECT packet, while its password is being checked.
    pub(super) asked: Option<Box<[u8]>>,
    pub(super) out: Outbox,
    /// Upper bound on the bytes of answers to the client's packets in the outbox.
    pub(super) answers: usize,
    /// Incomplete searches for retained messages.
    pub(super) lookups: VecDeque<Lookup>,
    /// Bytes that the server holds for the connection besides the outbox, and the total that was counted.
    pub(super) buffers: usize,
    pub(super) counted: usize,
    /// When the client last published messages that the broker must store: retained ones, or ones for readers that are
    /// behind.
    pub(super) filled: Option<Instant>,
    pub(super) session: Option<usize>,
    /// Whether its CONNECT has not been accepted yet.
    pub(super) is_unauthenticated: bool,
    /// Whether it came through a Unix socket.
    pub(super) is_private: bool,
    pub(super) terms: Terms,
    pub(super) keep_alive: Option<Duration>,
    pub(super) heard: Instant,
    /// When the client last accepted bytes.
    pub(super) progress: Instant,
    /// Reader whose backlog this publisher waits for.
    pub(super) held_by: Option<usize>,
    /// Number of packets that the client may send now, as of `allowed_at`; negative while the client has to wait.
    pub(super) allowance: f64,
    pub(super) allowed_at: Instant,
    pub(super) dirty: bool,
    pub(super) closing: bool,
}

impl Link {
    /// Creates the state before CONNECT. `rate`: packets that the client may send per second.
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
                // Send no reason strings until CONNECT has announced a maximum.
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

    /// Returns whether the client leaves too many answers unread, or is still receiving retained messages for its
    /// subscriptions.
    pub(super) fn is_behind(&self) -> bool {
        self.answers > UNREAD_ANSWERS || !self.lookups.is_empty()
    }

    pub(super) fn lateness(&self, now: Instant) -> Option<Refusal> {
        // A client whose reading is delayed may have sent a PINGREQ that was not read; accepting bytes shows that it is
        // alive.
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
