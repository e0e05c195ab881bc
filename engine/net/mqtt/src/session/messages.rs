//! Subscriptions, messages, and the broker's answers.

use std::ops::Range;
use std::sync::Arc;

use crate::dialect::Remedy;

/// Quality of service of a message.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum QoS {
    /// At most once: as reliable as the TCP connection.
    AtMostOnce,
    /// At least once.
    AtLeastOnce,
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
pub struct Incoming {
    /// All that was received at once; shared by the messages in it.
    pub(super) bytes: Arc<[u8]>,
    pub(super) topic: Arc<str>,
    pub(super) payload: Range<usize>,
    pub(super) retained: bool,
}

impl Incoming {
    /// Topic name.
    #[must_use]
    pub fn topic(&self) -> &str {
        &self.topic
    }

    /// Payload.
    #[must_use]
    pub fn payload(&self) -> &[u8] {
        &self.bytes[self.payload.clone()]
    }

    /// Whether the broker kept the message from before the subscription.
    #[must_use]
    pub fn retained(&self) -> bool {
        self.retained
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
