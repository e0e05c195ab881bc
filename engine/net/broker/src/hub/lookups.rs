//! Retained messages for new subscriptions, searched in slices, so that a client with many filters on a broker with
//! many retained messages does not delay other clients.

use super::Hub;
use super::link::{Link, mark};
use crate::retained::Search;
use crate::session::{Delivery, Session};
use std::sync::Arc;
use std::time::Instant;

/// Number of topics examined in one slice, which takes some 0.3 ms.
const SLICE: usize = 2000;
/// Number of bytes of messages after which a slice ends.
const SLICE_BYTES: usize = 1 << 20;

/// Retained messages that a subscription has not received yet.
pub struct Lookup {
    pub search: Search,
    pub qos: u8,
    pub identifier: Option<u32>,
}

impl Hub {
    /// Starts to send retained messages; sends the first slice immediately.
    pub(super) fn look_up(&mut self, id: usize, lookups: Vec<Lookup>, now: Instant) {
        if lookups.is_empty() {
            return;
        }
        let waits = !self.links[id].lookups.is_empty();
        self.links[id].lookups.extend(lookups);
        if !waits {
            self.slice(id, now);
            if !self.links[id].lookups.is_empty() {
                self.searching.push_back(id);
            }
        }
    }

    /// Runs one more slice of the searches, for the next connection in turn. Must be called repeatedly while
    /// [`Hub::is_searching`] is true; returns false if all waiting clients have to read first.
    pub fn search(&mut self, now: Instant) -> bool {
        for _ in 0..self.searching.len() {
            let Some(id) = self.searching.pop_front() else {
                return false;
            };
            let progress = self.links.contains(id) && self.slice(id, now);
            if self
                .links
                .get(id)
                .is_some_and(|link| !link.lookups.is_empty())
            {
                self.searching.push_back(id);
            }
            if progress {
                return true;
            }
        }
        false
    }

    /// Returns whether searches are in progress.
    pub fn is_searching(&self) -> bool {
        !self.searching.is_empty()
    }

    /// Runs one slice; returns false if nothing could be done because the reader is behind.
    fn slice(&mut self, id: usize, now: Instant) -> bool {
        let link = &mut self.links[id];
        let Some(session) = link.session.filter(|_| !link.closing) else {
            link.lookups.clear();
            return true;
        };
        // Only a quarter, since other messages to this client need room as well.
        let most = self.limits.backlog / 4;
        let (mut budget, before) = (SLICE, waiting(link, &self.sessions[session]));
        if before > most {
            return false;
        }
        while let Some(mut lookup) = link.lookups.pop_front() {
            while let Some(message) = self.retained.next(&mut lookup.search, &mut budget, now) {
                let remembered = &mut self.sessions[session];
                let may_read = self
                    .access
                    .as_ref()
                    .is_none_or(|access| access.may_read(remembered.subject(), &message.topic));
                if !may_read {
                    continue;
                }
                let delivery = Delivery {
                    qos: message.qos.min(lookup.qos),
                    message: Arc::clone(&message),
                    retain: true,
                    identifiers: lookup.identifier.into_iter().collect(),
                };
                if delivery.qos == 0 {
                    delivery.send(&mut link.out, link.terms, now);
                } else if remembered.enqueue(delivery, self.limits.backlog) {
                    remembered.advance(&mut link.out, link.terms, now);
                }
                let after = waiting(link, remembered);
                if after > most || after.saturating_sub(before) > SLICE_BYTES {
                    budget = 0;
                }
            }
            if budget == 0 {
                link.lookups.push_front(lookup);
                break;
            }
        }
        mark(link, id, &mut self.dirty);
        self.recount(id);
        self.recount_session(session);
        true
    }
}

/// Returns the number of bytes on their way to a client.
fn waiting(link: &Link, session: &Session) -> usize {
    link.out.len() + session.queued_bytes()
}
