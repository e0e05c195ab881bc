//! MQTT 5 or 3.1.1 without I/O: bytes in, bytes and packets out. A thin face over `mqtt-protocol-core`.

use std::ops::Range;
use std::sync::Arc;
use std::time::{Duration, Instant};

use mqtt_protocol_core::mqtt::common::Cursor;
use mqtt_protocol_core::mqtt::connection::{Event as CoreEvent, TimerKind};
use mqtt_protocol_core::mqtt::packet::{
    ContentType, CorrelationData, MaximumPacketSize, MessageExpiryInterval, Packet, Property,
    Qos as CoreQos, ResponseTopic, SubEntry, SubOpts, v3_1_1, v5_0,
};
use mqtt_protocol_core::mqtt::prelude::*;
use mqtt_protocol_core::mqtt::result_code::{ConnectReasonCode, ConnectReturnCode, MqttError};
use mqtt_protocol_core::mqtt::{self, role};

use crate::manner::{Manner, Remedy};
use crate::plain::{self, Cut};
use crate::publication::PublishOptions;
use crate::reading::Reading;
use crate::settings::Settings;

/// The largest packet that a broker may send here (MQTT 5), bytes: the protocol's largest message, its topic and properties.
const LARGEST_PACKET: u32 = (64 << 20) + (1 << 20);

/// The packet that asks a broker whether it is there.
const PINGREQ: [u8; 2] = [0xc0, 0];

/// Quality of service of a message.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum QoS {
    /// At most once: as reliable as the TCP connection.
    AtMostOnce,
    /// At least once.
    AtLeastOnce,
}

impl From<QoS> for CoreQos {
    fn from(qos: QoS) -> Self {
        match qos {
            QoS::AtMostOnce => Self::AtMostOnce,
            QoS::AtLeastOnce => Self::AtLeastOnce,
        }
    }
}

/// Version of MQTT that a connection speaks.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Version {
    /// MQTT 5.
    V5,
    /// MQTT 3.1.1, for brokers that know no other.
    V3,
}

/// A topic filter to be subscribed at every connection.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Subscription {
    /// Topic filter, wildcards allowed.
    pub filter: String,
    /// Highest quality of service wanted.
    pub qos: QoS,
}

/// A message that came in.
#[derive(Debug, Clone)]
pub struct Incoming(Publish);

#[derive(Debug, Clone)]
enum Publish {
    /// At QoS 0, read by hand; `bytes` is everything that one read brought.
    Plain {
        bytes: Arc<[u8]>,
        topic: Arc<str>,
        payload: Range<usize>,
        retained: bool,
    },
    V5(Box<v5_0::Publish>),
    V3(Box<v3_1_1::Publish>),
}

impl Incoming {
    /// Topic name.
    #[must_use]
    pub fn topic(&self) -> &str {
        match &self.0 {
            Publish::Plain { topic, .. } => topic,
            Publish::V5(publish) => publish.topic_name(),
            Publish::V3(publish) => publish.topic_name(),
        }
    }

    /// Payload.
    #[must_use]
    pub fn payload(&self) -> &[u8] {
        match &self.0 {
            Publish::Plain { bytes, payload, .. } => &bytes[payload.clone()],
            Publish::V5(publish) => publish.payload().as_slice(),
            Publish::V3(publish) => publish.payload().as_slice(),
        }
    }

    /// Whether the broker kept the message from before the subscription.
    #[must_use]
    pub fn retained(&self) -> bool {
        match &self.0 {
            Publish::Plain { retained, .. } => *retained,
            Publish::V5(publish) => publish.retain(),
            Publish::V3(publish) => publish.retain(),
        }
    }
}

/// What the broker sent, as far as it matters above.
#[derive(Debug)]
pub(crate) enum Received {
    Accepted,
    /// Refused with this reason, and what may help.
    Refused(String, Remedy),
    /// Subscribed, or not: one answer per filter.
    Subscribed(Vec<Granted>),
    Publish(Incoming),
    /// The connection is over.
    Closed(String),
}

/// The answer to a subscription.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) enum Granted {
    Yes,
    No(String),
}

impl Granted {
    fn by(code: u8, reason: impl std::fmt::Display) -> Self {
        if code < 0x80 {
            Self::Yes
        } else {
            Self::No(reason.to_string())
        }
    }
}

/// One MQTT connection's state.
pub(crate) struct Session {
    version: Version,
    core: mqtt::Connection<role::Client>,
    ping_at: Option<Instant>,
    silent_at: Option<Instant>,
    /// The beginning of a packet whose end has not come.
    partial: Vec<u8>,
    /// The broker has accepted the connection: plain messages need not go through the core.
    accepted: bool,
    /// Nothing that comes after this counts.
    over: bool,
    /// The largest packet that the broker takes.
    largest: usize,
    /// The highest quality of service that the broker takes.
    most: QoS,
    /// Whether the broker takes messages that it is to keep.
    retains: bool,
    /// What the broker has read; of use where it does not say how much it takes.
    reading: Reading,
    /// The topic of the last plain message: most have the same one, which is then neither checked nor copied.
    last_topic: Arc<str>,
}

impl Session {
    pub fn new(version: Version) -> Self {
        let mut core = mqtt::Connection::new(match version {
            Version::V5 => mqtt::Version::V5_0,
            Version::V3 => mqtt::Version::V3_1_1,
        });
        core.set_auto_pub_response(true);
        core.set_pingresp_recv_timeout(20_000);
        Self {
            version,
            core,
            ping_at: None,
            silent_at: None,
            partial: Vec::new(),
            accepted: false,
            over: false,
            largest: usize::MAX,
            most: QoS::AtLeastOnce,
            retains: true,
            reading: Reading::default(),
            last_topic: Arc::default(),
        }
    }

    /// Bytes of the largest packet that the broker takes; `usize::MAX` when it does not say.
    pub fn largest(&self) -> usize {
        self.largest
    }

    pub fn version(&self) -> Version {
        self.version
    }

    /// Puts the CONNECT packet into `out`.
    pub fn connect(
        &mut self,
        settings: &Settings,
        client_id: &str,
        manner: Manner,
        out: &mut Vec<u8>,
    ) -> Result<(), MqttError> {
        macro_rules! connect {
            ($module:ident) => {{
                let mut builder = $module::Connect::builder()
                    .client_id(client_id)?
                    .clean_start(true)
                    .keep_alive(settings.keep_alive);
                if let Some(username) = &settings.username {
                    builder = builder.user_name(username)?;
                    if let Some(password) = &settings.password {
                        builder = builder.password(password.as_bytes().to_vec())?;
                    }
                }
                if let Some(will) = &settings.will {
                    builder = builder.will_message(
                        &will.topic,
                        will.payload.clone(),
                        manner.will_qos.into(),
                        manner.will_retained,
                    )?;
                }
                builder
            }};
        }
        let packet: Packet = match self.version {
            Version::V5 => {
                let mut builder =
                    connect!(v5_0).props(vec![MaximumPacketSize::new(LARGEST_PACKET)?.into()]);
                if let Some(will) = &settings.will {
                    builder =
                        builder.will_props(vec![MessageExpiryInterval::new(will.expiry)?.into()]);
                }
                builder.build()?.into()
            }
            Version::V3 => connect!(v3_1_1).build()?.into(),
        };
        self.send(packet, out)
    }

    pub fn subscribe(
        &mut self,
        subscriptions: &[Subscription],
        out: &mut Vec<u8>,
    ) -> Result<(), MqttError> {
        let entries = subscriptions
            .iter()
            .map(|subscription| {
                // What this client publishes itself is no news to it (MQTT 5).
                let options = SubOpts::new()
                    .set_qos(self.allowed(subscription.qos).into())
                    .set_nl(self.version == Version::V5);
                SubEntry::new(subscription.filter.as_str(), options)
            })
            .collect::<Result<Vec<_>, _>>()?;
        let id = self.core.acquire_packet_id()?;
        let packet: Packet = match self.version {
            Version::V5 => v5_0::Subscribe::builder()
                .packet_id(id)
                .entries(entries)
                .build()?
                .into(),
            Version::V3 => v3_1_1::Subscribe::builder()
                .packet_id(id)
                .entries(entries)
                .build()?
                .into(),
        };
        self.send(packet, out)
    }

    pub fn publish(
        &mut self,
        topic: &str,
        payload: &[u8],
        options: &PublishOptions<'_>,
        out: &mut Vec<u8>,
    ) -> Result<(), MqttError> {
        let options = &PublishOptions {
            qos: self.allowed(options.qos),
            retain: options.retain && self.retains,
            ..*options
        };
        let before = out.len();
        // The keep-alive timer runs on meanwhile: a ping too many is harmless.
        let plain = self.accepted && options.qos == QoS::AtMostOnce && !options.retain;
        if !(plain && plain::write(topic, payload, options, self.version, self.largest, out)) {
            self.publish_by_core(topic, payload, options, out)?;
        }
        let bytes = out.len() - before;
        if self.largest == usize::MAX && self.reading.sent(bytes) {
            self.reading.asked(bytes);
            // Not by the core, whose patience with the answer is that with an idle connection.
            out.extend_from_slice(&PINGREQ);
        }
        Ok(())
    }

    /// Bytes of the largest packet that the broker has read and that was not small, 0 for none; and of the largest one
    /// that it may not have read, 0 where none is larger. Both 0 where it says how much it takes.
    pub fn read(&self) -> (usize, usize) {
        (self.reading.read(), self.reading.unread())
    }

    /// What the broker takes of a quality of service.
    fn allowed(&self, qos: QoS) -> QoS {
        match self.most {
            QoS::AtMostOnce => QoS::AtMostOnce,
            QoS::AtLeastOnce => qos,
        }
    }

    fn publish_by_core(
        &mut self,
        topic: &str,
        payload: &[u8],
        options: &PublishOptions<'_>,
        out: &mut Vec<u8>,
    ) -> Result<(), MqttError> {
        let id = match options.qos {
            QoS::AtMostOnce => None,
            QoS::AtLeastOnce => Some(self.core.acquire_packet_id()?),
        };
        macro_rules! publish {
            ($module:ident) => {{
                let builder = $module::Publish::builder()
                    .topic_name(topic)?
                    .qos(options.qos.into())
                    .retain(options.retain)
                    .payload(payload);
                if let Some(id) = id {
                    builder.packet_id(id)
                } else {
                    builder
                }
            }};
        }
        let packet: Packet = match self.version {
            Version::V5 => {
                let mut properties: Vec<Property> = Vec::new();
                if let Some(seconds) = options.expiry {
                    properties.push(MessageExpiryInterval::new(seconds)?.into());
                }
                if let Some(text) = options.content_type {
                    properties.push(ContentType::new(text)?.into());
                }
                if let Some(topic) = options.response_topic {
                    // The crate does not look, and a broker would end the connection.
                    if !plain::is_topic(topic) {
                        return Err(MqttError::TopicNameInvalid);
                    }
                    properties.push(ResponseTopic::new(topic)?.into());
                }
                if let Some(data) = options.correlation {
                    properties.push(CorrelationData::new(data.to_vec())?.into());
                }
                let builder = publish!(v5_0);
                if properties.is_empty() {
                    builder.build()?.into()
                } else {
                    builder.props(properties).build()?.into()
                }
            }
            Version::V3 => publish!(v3_1_1).build()?.into(),
        };
        self.send(packet, out)
    }

    pub fn disconnect(&mut self, out: &mut Vec<u8>) -> Result<(), MqttError> {
        let packet: Packet = match self.version {
            Version::V5 => v5_0::Disconnect::builder().build()?.into(),
            Version::V3 => v3_1_1::Disconnect::builder().build()?.into(),
        };
        self.send(packet, out)
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

    /// Takes bytes from the broker; answers go to `out`, everything that matters above to `received`.
    pub fn receive(
        &mut self,
        bytes: &[u8],
        out: &mut Vec<u8>,
        received: &mut impl FnMut(Received),
    ) {
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

    /// Takes all packets that are there as a whole; how many bytes they are.
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
                // The core says what is wrong.
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
        [self.ping_at, self.silent_at].into_iter().flatten().min()
    }

    /// Fires the timers that are due.
    pub fn tick(&mut self, now: Instant, out: &mut Vec<u8>, received: &mut impl FnMut(Received)) {
        if self.silent_at.is_some_and(|at| at <= now) {
            self.silent_at = None;
            received(Received::Closed(
                "the broker has not answered a ping for 20 s".to_owned(),
            ));
        } else if self.ping_at.is_some_and(|at| at <= now) {
            self.ping_at = None;
            for event in self.core.notify_timer_fired(TimerKind::PingreqSend) {
                self.handle(event, out, received);
            }
        }
    }

    fn handle(&mut self, event: CoreEvent, out: &mut Vec<u8>, received: &mut impl FnMut(Received)) {
        match event {
            CoreEvent::RequestSendPacket { packet, .. } => {
                if matches!(packet, Packet::V5_0Pingreq(_) | Packet::V3_1_1Pingreq(_)) {
                    self.reading.asked(0);
                }
                for buffer in packet.to_buffers() {
                    out.extend_from_slice(&buffer);
                }
            }
            CoreEvent::RequestTimerReset { kind, duration_ms } => {
                if let Some(timer) = self.timer(kind) {
                    *timer = Some(Instant::now() + Duration::from_millis(duration_ms));
                }
            }
            CoreEvent::RequestTimerCancel(kind) => {
                if let Some(timer) = self.timer(kind) {
                    *timer = None;
                }
            }
            CoreEvent::NotifyPacketReceived(packet) => match packet {
                Packet::V5_0Publish(publish) => {
                    received(Received::Publish(Incoming(Publish::V5(Box::new(publish)))))
                }
                Packet::V3_1_1Publish(publish) => {
                    received(Received::Publish(Incoming(Publish::V3(Box::new(publish)))))
                }
                Packet::V5_0Pingresp(_) | Packet::V3_1_1Pingresp(_) => self.reading.answered(),
                Packet::V5_0Connack(connack) => received(match connack.reason_code() {
                    ConnectReasonCode::Success => {
                        self.accepted = true;
                        self.limit(connack.props());
                        Received::Accepted
                    }
                    code => Received::Refused(
                        code.to_string(),
                        match code {
                            ConnectReasonCode::UnsupportedProtocolVersion => Remedy::Older,
                            ConnectReasonCode::QosNotSupported => Remedy::WillAtMostOnce,
                            ConnectReasonCode::RetainNotSupported => Remedy::WillNotRetained,
                            ConnectReasonCode::ServerBusy
                            | ConnectReasonCode::ServerUnavailable
                            | ConnectReasonCode::ConnectionRateExceeded => Remedy::Again,
                            _ => Remedy::None,
                        },
                    ),
                }),
                Packet::V3_1_1Connack(connack) => received(match connack.return_code() {
                    ConnectReturnCode::Accepted => {
                        self.accepted = true;
                        Received::Accepted
                    }
                    ConnectReturnCode::ServerUnavailable => {
                        Received::Refused("it is not available".to_owned(), Remedy::Again)
                    }
                    code => Received::Refused(code.to_string(), Remedy::None),
                }),
                Packet::V5_0Suback(suback) => {
                    received(Received::Subscribed(
                        suback
                            .reason_codes()
                            .into_iter()
                            .map(|code| Granted::by(code as u8, code))
                            .collect(),
                    ));
                }
                Packet::V3_1_1Suback(suback) => {
                    received(Received::Subscribed(
                        suback
                            .return_codes()
                            .into_iter()
                            .map(|code| Granted::by(code as u8, code))
                            .collect(),
                    ));
                }
                Packet::V5_0Disconnect(disconnect) => {
                    self.over = true;
                    received(Received::Closed(disconnect.reason_code().map_or_else(
                        || "the broker disconnected".to_owned(),
                        |code| code.to_string(),
                    )))
                }
                _ => {}
            },
            CoreEvent::NotifyError(error) => {
                self.over = true;
                received(Received::Closed(format!("MQTT protocol error: {error:?}")))
            }
            CoreEvent::RequestClose => {
                self.over = true;
                received(Received::Closed("the MQTT protocol demands it".to_owned()))
            }
            CoreEvent::NotifyPacketIdReleased(_) => {}
        }
    }

    /// Keeps to what the broker says of itself.
    fn limit(&mut self, properties: &[Property]) {
        for property in properties {
            match property {
                Property::MaximumPacketSize(size) => {
                    self.largest = usize::try_from(size.val()).unwrap_or(usize::MAX);
                }
                Property::MaximumQos(most) if most.val() == 0 => self.most = QoS::AtMostOnce,
                Property::RetainAvailable(retains) => self.retains = retains.val() == 1,
                _ => {}
            }
        }
    }

    fn timer(&mut self, kind: TimerKind) -> Option<&mut Option<Instant>> {
        match kind {
            TimerKind::PingreqSend => Some(&mut self.ping_at),
            TimerKind::PingrespRecv => Some(&mut self.silent_at),
            TimerKind::PingreqRecv => None,
        }
    }
}

#[cfg(test)]
mod tests;
