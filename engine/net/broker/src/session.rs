//! The state that the broker stores for a client: MQTT 5.0, chapter 4.1.

use crate::access::{Access, Subject};
use crate::{message::Message, outbox::Outbox};
use std::collections::{HashSet, VecDeque};
use std::sync::Arc;
use std::time::Instant;
use swarmwright_packets::{Answer, Outgoing, Version, publish, reason};

/// Topic filters that one client can subscribe to, and the bytes that they may take together.
pub const MOST_FILTERS: usize = 4096;
pub const MOST_FILTER_BYTES: usize = 4 << 20;

/// Approximate memory of a level of a topic filter, and of an empty session, bytes.
const LEVEL: usize = 160;
const SESSION: usize = 1024;

fn filter_size(filter: &str) -> usize {
    2 * filter.len() + LEVEL * (1 + filter.bytes().filter(|&byte| byte == b'/').count())
}

/// A message of QoS 1 or 2 for one client.
pub struct Delivery {
    pub message: Arc<Message>,
    pub qos: u8,
    pub retain: bool,
    pub identifiers: Box<[u32]>,
}

struct Flight {
    id: u16,
    /// None once the client has the message (QoS 2, PUBREC seen): only PUBREL is repeated.
    delivery: Option<Delivery>,
}

/// A will that waits for its client to be lost.
pub struct Testament {
    pub message: Message,
    pub expiry: Option<u32>,
    pub delay: u32,
}

/// A client's subscriptions and unfinished messages; outlives connections when the client asks for it.
pub struct Session {
    pub client_id: Box<str>,
    pub user: Option<Box<str>>,
    /// The connection, by its number; None while the client is disconnected.
    pub link: Option<usize>,
    /// The topic filters that it subscribes to, and their approximate size in bytes.
    filters: HashSet<Box<str>>,
    filter_bytes: usize,
    /// When its last connection ended.
    pub left: Option<Instant>,
    /// Memory of the session in bytes, as counted by the broker.
    pub counted: usize,
    /// Seconds to live without a connection.
    pub expiry: u32,
    /// When the session of an absent client ends.
    pub ends: Option<Instant>,
    pub will: Option<Testament>,
    pub will_due: Option<Instant>,
    /// Packet identifiers of QoS 2 messages received and not yet released.
    pub inbound: HashSet<u16>,
    flights: VecDeque<Flight>,
    queue: VecDeque<Delivery>,
    /// Bytes of the queued and of the unacknowledged messages.
    queued_bytes: usize,
    last_id: u16,
    pub overflowed: bool,
}

/// What sending to a client depends on.
#[derive(Clone, Copy)]
pub struct Terms {
    pub version: Version,
    /// Unacknowledged messages that the client accepts.
    pub window: u16,
    /// Largest packet that the client accepts, bytes.
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

    /// Adds a topic filter; whether it is new. None = more filters than a client may have.
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

    /// Removes a topic filter; false = there was none.
    pub fn unsubscribe(&mut self, filter: &str) -> bool {
        let existed = self.filters.remove(filter);
        if existed {
            self.filter_bytes -= filter_size(filter);
        }
        existed
    }

    /// The topic filters, in no order.
    pub fn filters(&self) -> impl Iterator<Item = &str> {
        self.filters.iter().map(|filter| &**filter)
    }

    /// The client, for the access rules.
    pub fn subject(&self) -> Subject<'_> {
        Subject {
            user: self.user.as_deref(),
            client_id: &self.client_id,
        }
    }

    /// Bytes of the messages of QoS 1 and 2 that are queued or unacknowledged.
    pub fn queued_bytes(&self) -> usize {
        self.queued_bytes
    }

    /// Approximate memory of the session, bytes.
    pub fn size(&self) -> usize {
        let will = self.will.as_ref().map_or(0, |will| will.message.size());
        SESSION + 2 * self.client_id.len() + will + self.filter_bytes + self.queued_bytes
    }

    /// Queues a message of QoS 1 or 2; returns false if that would exceed `limit` bytes.
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

    /// Whether this is the acknowledgement that the message waits for. Unknown identifiers are answered, or ignored.
    pub fn expects(&self, id: u16, kind: Answer) -> bool {
        let Some(flight) = self.flights.iter().find(|flight| flight.id == id) else {
            return true;
        };
        match (kind, &flight.delivery) {
            (Answer::Release, _) => true,
            (Answer::Acknowledged, Some(delivery)) => delivery.qos == 1,
            (Answer::Received, Some(delivery)) => delivery.qos == 2,
            // PUBREC again after PUBREL was sent is harmless; a client may repeat it.
            (Answer::Received | Answer::Complete, None) => true,
            (Answer::Acknowledged, None) | (Answer::Complete, Some(_)) => false,
        }
    }

    /// PUBACK, PUBCOMP, or a PUBREC that refuses: the message is done. False = unknown identifier.
    pub fn finish(&mut self, id: u16) -> bool {
        let index = self.flights.iter().position(|flight| flight.id == id);
        let Some(flight) = index.and_then(|index| self.flights.remove(index)) else {
            return false;
        };
        self.release(flight.delivery);
        true
    }

    /// PUBREC: the client has the message. False = unknown identifier.
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

    /// Drops the messages that this client may no longer read.
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
    /// Sends at QoS 0, without storing.
    pub fn send(&self, out: &mut Outbox, terms: Terms, now: Instant) {
        write(out, self, 0, false, terms, now);
    }
}

/// False when the packet is larger than the client accepts: then it is not sent at all (MQTT 5.0, 3.1.2.11.4).
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
