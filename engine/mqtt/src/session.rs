//! MQTT 5 or 3.1.1 without I/O: bytes in, bytes and packets out. A thin layer over `mqtt-protocol-core`.

mod events;
mod messages;
mod packets;

pub(crate) use messages::{Granted, Received};
pub use messages::{Incoming, QoS, Subscription, Version};

use std::collections::HashSet;
use std::ops::Range;
use std::sync::Arc;
use std::time::{Duration, Instant};

use mqtt_protocol_core::mqtt::common::Cursor;
use mqtt_protocol_core::mqtt::connection::{Event as CoreEvent, TimerKind};
use mqtt_protocol_core::mqtt::packet::Packet;
use mqtt_protocol_core::mqtt::result_code::MqttError;
use mqtt_protocol_core::mqtt::{self, role};

use messages::Publish;

use crate::plain::{self, Cut};
use crate::publication::PublishOptions;
use crate::reading::Reading;

/// The packet PINGREQ.
const PINGREQ: [u8; 2] = [0xc0, 0];

/// How many topics are remembered.
const MOST_TOPICS: usize = 1000;

/// How many answers are waited for at the same time, at most.
const MOST_AWAITED: usize = 16;

/// Parts of the keep-alive interval after which silence is noticed. Up to two of them before a ping and half of the interval for its
/// answer make the whole interval.
const CHECKS: u32 = 4;

/// One MQTT connection's state.
pub(crate) struct Session {
    version: Version,
    core: mqtt::Connection<role::Client>,
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
    /// The broker has accepted the connection: plain messages need not go through the core.
    accepted: bool,
    /// The connection is over: further bytes are ignored.
    over: bool,
    /// The largest packet that the broker accepts.
    largest: usize,
    /// The highest quality of service that the broker supports.
    most: QoS,
    /// Whether the broker supports retained messages.
    retains: bool,
    /// What the broker has read; used where it announces no limit.
    reading: Reading,
    /// Topics on which was published: the first message on each is acknowledged, since a broker that denies it says so
    /// there only.
    topics: HashSet<Box<str>>,
    /// Identifiers and topics of what the broker has not acknowledged yet.
    unacknowledged: Vec<(u16, Box<str>)>,
    /// How many of these there may be, of messages that need no answer.
    awaited: usize,
    /// The topic of the last plain message: most have the same one, which is then neither checked nor copied.
    last_topic: Arc<str>,
}

impl Session {
    /// `keep_alive`: seconds, as in the settings.
    pub fn new(version: Version, keep_alive: u16) -> Self {
        let keep_alive = Duration::from_secs(keep_alive.into());
        let mut core = mqtt::Connection::new(match version {
            Version::V5 => mqtt::Version::V5_0,
            Version::V3 => mqtt::Version::V3_1_1,
        });
        core.set_auto_pub_response(true);
        Self {
            version,
            core,
            ping_at: None,
            keep_alive,
            check_at: Instant::now() + keep_alive / CHECKS,
            heard: false,
            asked: false,
            partial: Vec::new(),
            accepted: false,
            over: false,
            largest: usize::MAX,
            most: QoS::AtLeastOnce,
            retains: true,
            reading: Reading::default(),
            topics: HashSet::new(),
            unacknowledged: Vec::new(),
            awaited: MOST_AWAITED,
            last_topic: Arc::default(),
        }
    }

    /// Bytes of the largest packet that the broker accepts; `usize::MAX` if it announces no limit.
    pub fn largest(&self) -> usize {
        self.largest
    }

    pub fn version(&self) -> Version {
        self.version
    }

    pub fn publish(
        &mut self,
        topic: &str,
        payload: &[u8],
        options: &PublishOptions<'_>,
        out: &mut Vec<u8>,
    ) -> Result<(), MqttError> {
        // The identifier of a message that is acknowledged must have room too.
        let fits = options.room(topic) + payload.len() <= self.largest;
        let qos = if options.confirm && fits && self.is_first(topic) {
            QoS::AtLeastOnce
        } else {
            options.qos
        };
        let options = &PublishOptions {
            qos: self.allowed(qos),
            retain: options.retain && self.retains,
            ..*options
        };
        let before = out.len();
        // The keep-alive timer is not reset: an additional ping is harmless.
        let plain = self.accepted && options.qos == QoS::AtMostOnce && !options.retain;
        if !(plain && plain::write(topic, payload, options, self.version, self.largest, out)) {
            self.publish_by_core(topic, payload, options, out)?;
        }
        let bytes = out.len() - before;
        if self.largest == usize::MAX && self.reading.sent(bytes) {
            self.reading.asked(bytes);
            // Not sent by the core, whose time-out for the answer is that of an idle connection.
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
        if self.topics.contains(topic) || self.unacknowledged.len() >= self.awaited {
            return false;
        }
        if self.topics.len() == MOST_TOPICS {
            self.topics.clear();
        }
        self.topics.insert(topic.into())
    }

    /// The quality of service, reduced to what the broker supports.
    fn allowed(&self, qos: QoS) -> QoS {
        match self.most {
            QoS::AtMostOnce => QoS::AtMostOnce,
            QoS::AtLeastOnce => qos,
        }
    }

    fn send(&mut self, packet: Packet, out: &mut Vec<u8>) -> Result<(), MqttError> {
        let mut failed = None;
        for event in self.core.send(packet) {
            if let CoreEvent::NotifyError(error) = event {
                failed = Some(error);
            } else {
                self.handle(event, out, &mut |_| {});
            }
        }
        failed.map_or(Ok(()), Err)
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
        let mut shared: Option<Arc<[u8]>> = None;
        let mut start = 0;
        while start < bytes.len() && !self.over {
            let (header, end) = match plain::cut(&bytes[start..]) {
                Cut::Incomplete => return start,
                // The core reports the error.
                Cut::Malformed => (0, bytes.len()),
                Cut::Whole { header, length } => (header, start + length),
            };
            let packet = &bytes[start..end];
            if let Some((topic, payload)) = self.read_plain(packet, header) {
                received(Received::Publish(Incoming(Publish::Plain {
                    retained: packet[0] & 1 == 1,
                    bytes: Arc::clone(shared.get_or_insert_with(|| bytes.into())),
                    topic,
                    payload: start + payload.start..start + payload.end,
                })));
            } else {
                let mut cursor = Cursor::new(packet);
                while !cursor.remaining_slice().is_empty() {
                    for event in self.core.recv(&mut cursor) {
                        self.handle(event, out, received);
                    }
                }
            }
            start = end;
        }
        bytes.len()
    }

    /// Topic and place of the payload, if the packet is a plain message that need not go through the core.
    fn read_plain(&mut self, packet: &[u8], header: usize) -> Option<(Arc<str>, Range<usize>)> {
        if !self.accepted {
            return None;
        }
        let (topic, payload) = plain::read(packet, header, self.version)?;
        let topic = packet.get(topic)?;
        if topic.is_empty() || topic != self.last_topic.as_bytes() {
            self.last_topic = plain::topic(topic)?.into();
        }
        Some((Arc::clone(&self.last_topic), payload))
    }

    /// The next time at which `tick` is needed.
    pub fn next_timer(&self) -> Option<Instant> {
        self.ping_at
            .map_or(Some(self.check_at), |at| Some(at.min(self.check_at)))
    }

    /// Fires the timers that are due.
    pub fn tick(&mut self, now: Instant, out: &mut Vec<u8>, received: &mut impl FnMut(Received)) {
        if self.ping_at.is_some_and(|at| at <= now) {
            self.ping_at = None;
            for event in self.core.notify_timer_fired(TimerKind::PingreqSend) {
                self.handle(event, out, received);
            }
        }
        if self.check_at <= now {
            self.check(now, out, received);
        }
    }

    /// Asks a broker that has been silent, and gives up one that does not answer.
    ///
    /// Pings of the core depend on what is sent: a client that publishes now and then would never ask.
    fn check(&mut self, now: Instant, out: &mut Vec<u8>, received: &mut impl FnMut(Received)) {
        let asked = std::mem::replace(&mut self.asked, false);
        if std::mem::take(&mut self.heard) {
            self.check_at = now + self.keep_alive / CHECKS;
        } else if !asked {
            self.asked = true;
            self.reading.asked(0);
            out.extend_from_slice(&PINGREQ);
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
