//! MQTT 5 or 3.1.1 without I/O: bytes in, bytes and what they say out. The packets themselves are those of `swarmwright-packets`.

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

/// The largest packet that a broker may send here (MQTT 5), bytes: the protocol's largest message, its topic and properties.
const LARGEST_PACKET: u32 = (64 << 20) + (1 << 20);

/// How many topics are remembered.
const MOST_TOPICS: usize = 1000;

/// How many answers are waited for at the same time, at most, for messages that need none.
const MOST_AWAITED: usize = 16;

/// How many messages may be unacknowledged at the same time, even where the broker accepts more.
const MOST_UNACKNOWLEDGED: usize = 1 << 14;

/// Parts of the keep-alive interval after which silence is noticed. Up to two of them before a ping and half of the interval for its
/// answer make the whole interval.
const CHECKS: u32 = 4;

/// How far a connection has come.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Stage {
    /// CONNECT is not answered yet.
    Connecting,
    /// The broker has accepted the connection.
    Accepted,
    /// Further bytes are ignored.
    Over,
}

/// What the broker accepts.
#[derive(Debug)]
struct Limits {
    /// The largest packet, bytes.
    largest: usize,
    /// How many messages may be unacknowledged.
    unacknowledged: usize,
    /// Largest number of them for messages that need no answer.
    awaited: usize,
    /// The highest quality of service.
    qos: QoS,
    /// Whether it supports retained messages.
    retains: bool,
}

/// One MQTT connection's state.
pub(crate) struct Session {
    version: Version,
    stage: Stage,
    /// After how long a broker that hears nothing gives this client up; none if never.
    patience: Option<Duration>,
    ping_at: Option<Instant>,
    keep_alive: Duration,
    /// When it is next checked whether the broker is silent.
    check_at: Instant,
    /// Bytes came since the last check.
    heard: bool,
    /// The broker was silent at the last check, and was asked for an answer.
    asked: bool,
    /// The part of an incomplete packet received so far.
    partial: Vec<u8>,
    limits: Limits,
    /// What the broker has read; used where it announces no limit.
    reading: Reading,
    /// Topics on which was published: the first message on each is acknowledged, since a broker that denies it says so
    /// there only.
    topics: HashSet<Box<str>>,
    /// Identifiers and topics of what the broker has not acknowledged yet.
    unacknowledged: BTreeMap<u16, Box<str>>,
    /// Identifier of a subscription that is not answered, and its number of filters.
    subscribing: Option<(u16, usize)>,
    /// The packet identifier used last.
    last_id: u16,
    /// The topic of the last message received: most have the same one, which is then neither checked nor copied.
    last_topic: Arc<str>,
}

impl Session {
    /// `keep_alive`: seconds, as in the settings.
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

    /// Bytes of the largest packet that the broker accepts; `usize::MAX` if it announces no limit.
    pub fn largest(&self) -> usize {
        self.limits.largest
    }

    pub fn version(&self) -> Version {
        self.version
    }

    /// Appends a message to `out`, at QoS 0 where the broker takes no further messages that have to be acknowledged.
    pub fn publish(
        &mut self,
        topic: &str,
        payload: &[u8],
        options: &PublishOptions<'_>,
        out: &mut Vec<u8>,
    ) -> Result<(), Invalid> {
        // The identifier of a message that is acknowledged must have room too.
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

    /// Bytes of the largest packet that the broker has read and that was not small, 0 for none; and of the largest one
    /// that it may not have read, 0 where none is larger. Both 0 where it announces a limit.
    pub fn read(&self) -> (usize, usize) {
        (self.reading.read(), self.reading.unread())
    }

    /// Whether nothing was published on a topic yet, and the answer can be waited for. Where there are very many topics,
    /// also now and then for one of them.
    fn is_first(&mut self, topic: &str) -> bool {
        if self.topics.contains(topic) || self.unacknowledged.len() >= self.limits.awaited {
            return false;
        }
        if self.topics.len() == MOST_TOPICS {
            self.topics.clear();
        }
        self.topics.insert(topic.into())
    }

    /// The packet identifier of a message; None if the broker takes no further messages that have to be acknowledged.
    fn next_id(&mut self) -> Option<u16> {
        if self.unacknowledged.len() >= self.limits.unacknowledged {
            return None;
        }
        Some(self.fresh_id())
    }

    /// A packet identifier that is not in use: most of them never are.
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

    /// Takes bytes from the broker; answers go to `out`, events for the connection to `received`.
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

    /// Takes all complete packets; returns how many bytes they have.
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
                // What is no broker at all may promise more bytes than it sends.
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

    /// Bytes of the payload, if the packet is a plain message on the same topic as the one before.
    fn repeated(&self, first: u8, body: &[u8]) -> Option<usize> {
        let (topic, payload) = client::bare(first, body, self.version)?;
        let is_same = !topic.is_empty() && topic == self.last_topic.as_bytes();
        is_same.then_some(payload.len())
    }

    /// Acknowledges a message, whose topic is the last one from here on.
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

    /// The next time at which `tick` is needed.
    pub fn next_timer(&self) -> Instant {
        self.ping_at
            .map_or(self.check_at, |at| at.min(self.check_at))
    }

    /// Fires the timers that are due.
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

    /// Pings a silent broker, and gives up a broker that does not answer.
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
