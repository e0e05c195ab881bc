//! Session state that the broker stores for a client: MQTT 5.0, chapter 4.1.

use crate::access::{Access, Subject};
use crate::{message::Message, outbox::Outbox};
use std::collections::{HashSet, VecDeque};
use std::sync::Arc;
use std::time::Instant;
use swarmwright_packets::{Answer, Outgoing, Version, publish, reason};

/// Largest number of topic filters of one client, and their total size in bytes.
pub const MOST_FILTERS: usize = 4096;
pub const MOST_FILTER_BYTES: usize = 4 << 20;

/// Approximate memory in bytes of a level of a topic filter, and of an empty session.
const LEVEL: usize = 160;
const SESSION: usize = 1024;

fn filter_size(filter: &str) -> usize {
    2 * filter.len() + LEVEL * (1 + filter.bytes().filter(|&byte| byte == b'/').count())
}

/// A QoS 1 or 2 message for one client.
pub struct Delivery {
    pub message: Arc<Message>,
    pub qos: u8,
    pub retain: bool,
    pub identifiers: Box<[u32]>,
}

struct Flight {
    id: u16,
    /// The message; `None` once the client has it (QoS 2, after PUBREC), when only PUBREL is repeated.
    delivery: Option<Delivery>,
}

/// A will, published when its client is lost.
pub struct Testament {
    pub message: Message,
    pub expiry: Option<u32>,
    pub delay: u32,
}

/// Subscriptions and unfinished messages of a client; it outlives connections if the client asks for it.
pub struct Session {
    pub client_id: Box<str>,
    pub user: Option<Box<str>>,
    /// Number of the connection; `None` while the client is disconnected.
    pub link: Option<usize>,
    /// Subscribed topic filters, and their approximate size in bytes.
    filters: HashSet<Box<str>>,
    filter_bytes: usize,
    /// When the last connection ended.
    pub left: Option<Instant>,
    /// Memory of the session in bytes, as counted by the broker.
    pub counted: usize,
    /// Seconds that the session lives without a connection.
    pub expiry: u32,
    /// When the session of a disconnected client ends.
    pub ends: Option<Instant>,
    pub will: Option<Testament>,
    pub will_due: Option<Instant>,
    /// Packet identifiers of received QoS 2 messages that have not been released.
    pub inbound: HashSet<u16>,
    flights: VecDeque<Flight>,
    queue: VecDeque<Delivery>,
    /// Bytes of queued and unacknowledged messages.
    queued_bytes: usize,
    last_id: u16,
    pub overflowed: bool,
}

/// Parameters for sending to a client.
#[derive(Clone, Copy)]
pub struct Terms {
    pub version: Version,
    /// Largest number of unacknowledged messages that the client accepts.
    pub window: u16,
    /// Size in bytes of the largest packet that the client accepts.
    pub maximum_packet: usize,
}

impl Session {
    pub fn new(client_id: &str, user: Option<&str>) -> Self {
        Self {
            client_id: client_id.into(),
            user: user.map(Into::into),
            link: None,
            left: None,
            counted: 0,
            filters: HashSet::new(),
            filter_bytes: 0,
            expiry: 0,
            ends: None,
            will: None,
            will_due: None,
            inbound: HashSet::new(),
            flights: VecDeque::new(),
            queue: VecDeque::new(),
            queued_bytes: 0,
            last_id: 0,
            overflowed: false,
        }
    }

    /// Adds a topic filter. Returns whether it is new; `None` if the client has too many filters.
    pub fn subscribe(&mut self, filter: &str) -> Option<bool> {
        if self.filters.contains(filter) {
            return Some(false);
        }
        let bytes = self.filter_bytes + filter_size(filter);
        if self.filters.len() >= MOST_FILTERS || bytes > MOST_FILTER_BYTES {
            return None;
        }
        self.filter_bytes = bytes;
        self.filters.insert(filter.into());
        Some(true)
    }

    /// Removes a topic filter. Returns whether it existed.
    pub fn unsubscribe(&mut self, filter: &str) -> bool {
        let existed = self.filters.remove(filter);
        if existed {
            self.filter_bytes -= filter_size(filter);
        }
        existed
    }

    /// Returns the topic filters, in no particular order.
    pub fn filters(&self) -> impl Iterator<Item = &str> {
        self.filters.iter().map(|filter| &**filter)
    }

    /// Returns the client, for access rules.
    pub fn subject(&self) -> Subject<'_> {
        Subject {
            user: self.user.as_deref(),
            client_id: &self.client_id,
        }
    }

    /// Returns the bytes of queued and unacknowledged QoS 1 and 2 messages.
    pub fn queued_bytes(&self) -> usize {
        self.queued_bytes
    }

    /// Returns the approximate memory of the session in bytes.
    pub fn size(&self) -> usize {
        let will = self.will.as_ref().map_or(0, |will| will.message.size());
        SESSION + 2 * self.client_id.len() + will + self.filter_bytes + self.queued_bytes
    }

    /// Queues a QoS 1 or 2 message; returns false if that would exceed `limit` bytes.
    pub fn enqueue(&mut self, delivery: Delivery, limit: usize) -> bool {
        let size = delivery.message.size();
        if self.queued_bytes + size > limit {
            return false;
        }
        self.queued_bytes += size;
        self.queue.push_back(delivery);
        true
    }

    /// Sends queued messages as far as the client's window allows.
    pub fn advance(&mut self, out: &mut Outbox, terms: Terms, now: Instant) {
        while self.flights.len() < usize::from(terms.window) {
            let Some(delivery) = self.queue.pop_front() else {
                return;
            };
            if !delivery.message.is_void(now) {
                let id = self.next_id();
                if write(out, &delivery, id, false, terms, now) {
                    self.flights.push_back(Flight {
                        id,
                        delivery: Some(delivery),
                    });
                    continue;
                }
            }
            self.queued_bytes -= delivery.message.size();
        }
    }

    /// Repeats the unfinished messages of an earlier connection, in order.
    pub fn resume(&mut self, out: &mut Outbox, terms: Terms, now: Instant) {
        let queued_bytes = &mut self.queued_bytes;
        self.flights.retain(|flight| match &flight.delivery {
            Some(delivery) => {
                let fits = write(out, delivery, flight.id, true, terms, now);
                if !fits {
                    *queued_bytes -= delivery.message.size();
                }
                fits
            }
            None => {
                swarmwright_packets::acknowledge(
                    out.end(),
                    Answer::Release,
                    flight.id,
                    reason::SUCCESS,
                    terms.version,
                );
                true
            }
        });
        self.advance(out, terms, now);
    }

    /// Returns whether this is the acknowledgement that the message waits for. Unknown identifiers are handled
    /// elsewhere.
    pub fn expects(&self, id: u16, kind: Answer) -> bool {
        let Some(flight) = self.flights.iter().find(|flight| flight.id == id) else {
            return true;
        };
        match (kind, &flight.delivery) {
            (Answer::Release, _) => true,
            (Answer::Acknowledged, Some(delivery)) => delivery.qos == 1,
            (Answer::Received, Some(delivery)) => delivery.qos == 2,
            // A client may harmlessly repeat PUBREC after PUBREL was sent.
            (Answer::Received | Answer::Complete, None) => true,
            (Answer::Acknowledged, None) | (Answer::Complete, Some(_)) => false,
        }
    }

    /// Completes a message after PUBACK, PUBCOMP, or a refusing PUBREC. Returns false for an unknown identifier.
    pub fn finish(&mut self, id: u16) -> bool {
        let index = self.flights.iter().position(|flight| flight.id == id);
        let Some(flight) = index.and_then(|index| self.flights.remove(index)) else {
            return false;
        };
        self.release(flight.delivery);
        true
    }

    /// Records that the client has the message, after PUBREC. Returns false for an unknown identifier.
    pub fn received(&mut self, id: u16) -> bool {
        match self.flights.iter_mut().find(|flight| flight.id == id) {
            Some(flight) => {
                let delivery = flight.delivery.take();
                self.release(delivery);
                true
            }
            None => false,
        }
    }

    /// Drops queued messages that this client may no longer read.
    pub fn keep_readable(&mut self, access: &Access) {
        let subject = Subject {
            user: self.user.as_deref(),
            client_id: &self.client_id,
        };
        let mut dropped = 0;
        self.queue.retain(|delivery| {
            let may = access.may_read(subject, &delivery.message.topic);
            dropped += if may { 0 } else { delivery.message.size() };
            may
        });
        self.queued_bytes -= dropped;
    }

    fn release(&mut self, delivery: Option<Delivery>) {
        self.queued_bytes -= delivery.map_or(0, |delivery| delivery.message.size());
    }

    fn next_id(&mut self) -> u16 {
        // The window is smaller than the number of identifiers, so one is always free.
        loop {
            self.last_id = self.last_id.checked_add(1).unwrap_or(1);
            if !self.flights.iter().any(|flight| flight.id == self.last_id) {
                return self.last_id;
            }
        }
    }
}

impl Delivery {
    /// Sends the message with QoS 0, without storing it.
    pub fn send(&self, out: &mut Outbox, terms: Terms, now: Instant) {
        write(out, self, 0, false, terms, now);
    }
}

/// Appends a PUBLISH. Returns false if the packet is larger than the client accepts; it is then not sent at all (MQTT
/// 5.0, 3.1.2.11.4).
fn write(
    out: &mut Outbox,
    delivery: &Delivery,
    id: u16,
    again: bool,
    terms: Terms,
    now: Instant,
) -> bool {
    let message = &delivery.message;
    let start = out.end().len();
    let outgoing = Outgoing {
        topic: &message.topic,
        payload: &message.payload,
        properties: &message.properties,
        expiry: message.seconds_left(now),
        identifiers: &delivery.identifiers,
        qos: delivery.qos,
        retain: delivery.retain,
        again,
        id,
    };
    publish(out.end(), &outgoing, terms.version);
    let fits = out.end().len() - start <= terms.maximum_packet;
    if !fits {
        out.end().truncate(start);
    }
    fits
}
