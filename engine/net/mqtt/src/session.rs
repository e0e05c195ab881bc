//! MQTT 5 or 3.1.1 without I/O: converts received bytes to events, and requests to bytes, with packets of
//! `swarmwright-packets`.

mod answers;
mod messages;
mod requests;

pub(crate) use messages::{Granted, Received};
pub use messages::{Incoming, QoS, Subscription};
pub use swarmwright_packets::Version;

use std::collections::{BTreeMap, HashSet};
use std::ops::Range;
use std::sync::Arc;
use std::time::{Duration, Instant};

use swarmwright_packets::client::{self, Invalid, PINGREQ, Packet};
use swarmwright_packets::{Answer, Outgoing, Publish, Refusal, acknowledge, frame, reason, topic};

use crate::publication::PublishOptions;
use crate::reading::Reading;

/// Largest packet in bytes that a broker may send to this client (MQTT 5): the largest message of the protocol, its
/// topic and properties.
const LARGEST_PACKET: u32 = (64 << 20) + (1 << 20);

/// Largest number of topics that are remembered.
const MOST_TOPICS: usize = 1000;

/// Largest number of answers awaited at the same time for messages that need none.
const MOST_AWAITED: usize = 16;

/// Largest number of unacknowledged messages, even if the broker accepts more.
const MOST_UNACKNOWLEDGED: usize = 1 << 14;

/// Number of checks per keep-alive interval. Up to two of them before a ping and half of the interval for its answer
/// add up to the whole interval.
const CHECKS: u32 = 4;

/// Stage of a connection.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Stage {
    /// CONNECT has not been answered yet.
    Connecting,
    /// The broker has accepted the connection.
    Accepted,
    /// The connection has ended; further bytes are ignored.
    Over,
}

/// Limits of the broker.
#[derive(Debug)]
struct Limits {
    /// Size in bytes of the largest packet.
    largest: usize,
    /// Largest number of unacknowledged messages.
    unacknowledged: usize,
    /// Largest number of these that need no answer.
    awaited: usize,
    /// Highest quality of service.
    qos: QoS,
    /// Whether the broker supports retained messages.
    retains: bool,
}

/// State of one MQTT connection.
pub(crate) struct Session {
    version: Version,
    stage: Stage,
    /// Silence after which the broker gives this client up; `None` if it never does.
    patience: Option<Duration>,
    ping_at: Option<Instant>,
    keep_alive: Duration,
    /// When to check next whether the broker is silent.
    check_at: Instant,
    /// Whether bytes have arrived since the last check.
    heard: bool,
    /// Whether the broker was silent at the last check and was pinged.
    asked: bool,
    /// Received part of an incomplete packet.
    partial: Vec<u8>,
    limits: Limits,
    /// Packets that the broker has read; used if it announces no limit.
    reading: Reading,
    /// Topics used so far: the first message on each is acknowledged, since that is where a broker reports a denial.
    topics: HashSet<Box<str>>,
    /// Identifiers and topics of unacknowledged messages.
    unacknowledged: BTreeMap<u16, Box<str>>,
    /// Identifier and number of filters of an unanswered subscription.
    subscribing: Option<(u16, usize)>,
    /// Last packet identifier used.
    last_id: u16,
    /// Topic of the last received message: most messages repeat it, so that it is neither checked nor copied again.
    last_topic: Arc<str>,
}

impl Session {
    /// Creates the state before CONNECT. `keep_alive`: interval in seconds, as in the settings.
    pub fn new(version: Version, keep_alive: u16) -> Self {
        let keep_alive = Duration::from_secs(keep_alive.into());
        Self {
            version,
            stage: Stage::Connecting,
            patience: Some(keep_alive),
            ping_at: None,
            keep_alive,
            check_at: Instant::now() + keep_alive / CHECKS,
            heard: false,
            asked: false,
            partial: Vec::new(),
            limits: Limits {
                largest: usize::MAX,
                unacknowledged: MOST_UNACKNOWLEDGED,
                awaited: MOST_AWAITED,
                qos: QoS::AtLeastOnce,
                retains: true,
            },
            reading: Reading::default(),
            topics: HashSet::new(),
            unacknowledged: BTreeMap::new(),
            subscribing: None,
            last_id: 0,
            last_topic: Arc::default(),
        }
    }

    /// Returns the size in bytes of the largest packet that the broker accepts; `usize::MAX` if it announces no limit.
    pub fn largest(&self) -> usize {
        self.limits.largest
    }

    pub fn version(&self) -> Version {
        self.version
    }

    /// Appends a message to `out`, with QoS 0 if the broker accepts no further unacknowledged messages.
    pub fn publish(
        &mut self,
        topic: &str,
        payload: &[u8],
        options: &PublishOptions<'_>,
        out: &mut Vec<u8>,
    ) -> Result<(), Invalid> {
        // A message that is acknowledged also needs room for its identifier.
        let fits = options.room(topic) + payload.len() <= self.limits.largest;
        let qos = if options.confirm && fits && self.is_first(topic) {
            QoS::AtLeastOnce
        } else {
            options.qos
        };
        let id = match qos.min(self.limits.qos) {
            QoS::AtMostOnce => None,
            QoS::AtLeastOnce => self.next_id(),
        };
        let properties = match self.version {
            Version::Three => Vec::new(),
            Version::Five => options.properties().encoded()?,
        };
        let message = Outgoing {
            topic,
            payload,
            properties: &properties,
            expiry: None,
            identifiers: &[],
            qos: u8::from(id.is_some()),
            retain: options.retain && self.limits.retains,
            again: false,
            id: id.unwrap_or_default(),
        };
        let before = out.len();
        client::publish(out, &message, self.version, self.limits.largest)?;
        if let Some(id) = id {
            self.unacknowledged.insert(id, topic.into());
        }
        let bytes = out.len() - before;
        if self.limits.largest == usize::MAX && self.reading.sent(bytes) {
            self.reading.asked(bytes);
            out.extend_from_slice(&PINGREQ);
        }
        Ok(())
    }

    /// Returns the sizes in bytes of the largest packet that the broker has read, and of the largest packet that it may
    /// not have read. The first is 0 if all were small, the second if none is larger than the first; both are 0 if the
    /// broker announces a limit.
    pub fn read(&self) -> (usize, usize) {
        (self.reading.read(), self.reading.unread())
    }

    /// Returns whether this is the first message on a topic and its answer can be awaited. If there are very many
    /// topics, some are occasionally treated as new.
    fn is_first(&mut self, topic: &str) -> bool {
        if self.topics.contains(topic) || self.unacknowledged.len() >= self.limits.awaited {
            return false;
        }
        if self.topics.len() == MOST_TOPICS {
            self.topics.clear();
        }
        self.topics.insert(topic.into())
    }

    /// Returns a packet identifier for a message; `None` if the broker accepts no further unacknowledged messages.
    fn next_id(&mut self) -> Option<u16> {
        if self.unacknowledged.len() >= self.limits.unacknowledged {
            return None;
        }
        Some(self.fresh_id())
    }

    /// Returns a packet identifier that is not in use.
    fn fresh_id(&mut self) -> u16 {
        loop {
            self.last_id = self.last_id.wrapping_add(1);
            let id = self.last_id;
            let subscribing = self.subscribing.is_some_and(|(it, _)| it == id);
            if id != 0 && !subscribing && !self.unacknowledged.contains_key(&id) {
                return id;
            }
        }
    }

    /// Processes bytes from the broker; answers are appended to `out`, and events passed to `received`.
    pub fn receive(
        &mut self,
        bytes: &[u8],
        out: &mut Vec<u8>,
        received: &mut impl FnMut(Received),
    ) {
        self.heard = true;
        if self.partial.is_empty() {
            let done = self.receive_packets(bytes, out, received);
            self.partial.extend_from_slice(&bytes[done..]);
        } else {
            let mut joined = std::mem::take(&mut self.partial);
            joined.extend_from_slice(bytes);
            let done = self.receive_packets(&joined, out, received);
            joined.drain(..done);
            self.partial = joined;
        }
    }

    /// Processes all complete packets and returns their total size in bytes.
    fn receive_packets(
        &mut self,
        bytes: &[u8],
        out: &mut Vec<u8>,
        received: &mut impl FnMut(Received),
    ) -> usize {
        let most = match self.version {
            Version::Three => usize::MAX,
            Version::Five => LARGEST_PACKET as usize,
        };
        let mut shared: Option<Arc<[u8]>> = None;
        let mut start = 0;
        while start < bytes.len() && self.stage != Stage::Over {
            let outcome = match frame(&bytes[start..], most) {
                // A server that is not an MQTT broker may announce more bytes than it sends.
                _ if self.stage == Stage::Connecting && !matches!(bytes[start], 0x20 | 0xe0) => {
                    Err(answers::NO_CONNACK)
                }
                Ok(None) => return start,
                Ok(Some((_, header, length))) if bytes.len() - start < header + length => {
                    return start;
                }
                Ok(Some((first, header, length))) => {
                    let body = &bytes[start + header..start + header + length];
                    start += header + length;
                    if let Some(payload) = self.repeated(first, body) {
                        let bytes = shared.get_or_insert_with(|| bytes.into());
                        let payload = start - payload..start;
                        received(self.message(bytes, payload, first & 1 == 1));
                        continue;
                    }
                    match client::decode(first, body, self.version) {
                        Ok(Packet::Publish(message)) => self.take(&message, out).map(|()| {
                            let bytes = shared.get_or_insert_with(|| bytes.into());
                            let payload = start - message.payload.len()..start;
                            received(self.message(bytes, payload, message.retain));
                        }),
                        Ok(packet) => self.handle(&packet, received),
                        Err(refusal) => Err(refusal),
                    }
                }
                Err(refusal) => Err(refusal),
            };
            if let Err(refusal) = outcome {
                self.refuse(refusal, out, received);
            }
        }
        bytes.len()
    }

    /// Returns the length of the payload if the packet is a plain message on the same topic as the last one.
    fn repeated(&self, first: u8, body: &[u8]) -> Option<usize> {
        let (topic, payload) = client::bare(first, body, self.version)?;
        let is_same = !topic.is_empty() && topic == self.last_topic.as_bytes();
        is_same.then_some(payload.len())
    }

    /// Acknowledges a message and remembers its topic as the last one.
    fn take(&mut self, message: &Publish<'_>, out: &mut Vec<u8>) -> Result<(), Refusal> {
        if !topic::is_name(message.topic) {
            let explanation = "a message on a topic that cannot be published to";
            return Err(Refusal::protocol(explanation));
        }
        if *message.topic != *self.last_topic {
            self.last_topic = message.topic.into();
        }
        if message.qos > 0 {
            let code = reason::SUCCESS;
            acknowledge(out, Answer::Acknowledged, message.id, code, self.version);
        }
        Ok(())
    }

    fn message(&self, bytes: &Arc<[u8]>, payload: Range<usize>, retained: bool) -> Received {
        Received::Publish(Incoming {
            bytes: Arc::clone(bytes),
            topic: Arc::clone(&self.last_topic),
            payload,
            retained,
        })
    }

    /// Returns when to call `tick` next.
    pub fn next_timer(&self) -> Instant {
        self.ping_at
            .map_or(self.check_at, |at| at.min(self.check_at))
    }

    /// Handles the timers that are due.
    pub fn tick(&mut self, now: Instant, out: &mut Vec<u8>, received: &mut impl FnMut(Received)) {
        if self.ping_at.is_some_and(|at| at <= now) {
            self.ping(now, out);
        }
        if self.check_at <= now {
            self.check(now, out, received);
        }
    }

    fn ping(&mut self, now: Instant, out: &mut Vec<u8>) {
        self.reading.asked(0);
        out.extend_from_slice(&PINGREQ);
        self.ping_at = self.patience.map(|patience| now + patience);
    }

    /// Pings a silent broker, and gives up one that does not answer.
    fn check(&mut self, now: Instant, out: &mut Vec<u8>, received: &mut impl FnMut(Received)) {
        let was_asked = std::mem::replace(&mut self.asked, false);
        if std::mem::take(&mut self.heard) {
            self.check_at = now + self.keep_alive / CHECKS;
        } else if !was_asked {
            self.asked = true;
            self.ping(now, out);
            self.check_at = now + self.keep_alive / 2;
        } else {
            self.check_at = now + self.keep_alive;
            received(Received::Closed(format!(
                "the broker has not answered a ping for {} s",
                self.keep_alive.as_secs_f64() / 2.0
            )));
        }
    }
}

#[cfg(test)]
mod tests;
