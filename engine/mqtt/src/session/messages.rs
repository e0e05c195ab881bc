//! Subscriptions, messages, and the broker's answers.

use std::ops::Range;
use std::sync::Arc;

use mqtt_protocol_core::mqtt::packet::{Qos as CoreQos, v3_1_1, v5_0};

use crate::dialect::Remedy;

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
    /// MQTT 3.1.1, for brokers that do not support MQTT 5.
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

/// A received message.
#[derive(Debug, Clone)]
pub struct Incoming(pub(super) Publish);

#[derive(Debug, Clone)]
pub(super) enum Publish {
    /// At QoS 0, read by `plain`; `bytes` are those of one read of the socket.
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

/// What the broker sent, as far as the connection needs it.
#[derive(Debug)]
pub(crate) enum Received {
    Accepted,
    /// Refused with this reason, and what may help.
    Refused(String, Remedy),
    /// Subscribed, or not: one answer per filter.
    Subscribed(Vec<Granted>),
    Publish(Incoming),
    /// It does not distribute messages on this topic, for this reason.
    Denied(String, String),
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
    pub(super) fn by(code: u8, reason: impl std::fmt::Display) -> Self {
        if code < 0x80 {
            Self::Yes
        } else {
            Self::No(reason.to_string())
        }
    }
}
