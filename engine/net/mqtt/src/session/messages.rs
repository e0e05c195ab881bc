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

/// A topic filter to which every connection subscribes.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Subscription {
    /// Topic filter, wildcards allowed.
    pub filter: String,
    /// Highest quality of service requested.
    pub qos: QoS,
}

/// A received message.
#[derive(Debug, Clone)]
pub struct Incoming {
    /// All bytes of one read, shared by the messages in it.
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

    /// Returns whether the broker had retained the message before the subscription.
    #[must_use]
    pub fn retained(&self) -> bool {
        self.retained
    }
}

/// An event from the broker for the connection.
#[derive(Debug)]
pub(crate) enum Received {
    Accepted,
    /// Refused for this reason; with a change that may help.
    Refused(String, Remedy),
    /// Answers to the subscription, one per filter.
    Subscribed(Vec<Granted>),
    Publish(Incoming),
    /// The broker denies messages on this topic, for this reason.
    Denied(String, String),
    /// The connection has ended, for this reason.
    Closed(String),
}

/// The answer to a subscription.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) enum Granted {
    Yes,
    No(String),
}
