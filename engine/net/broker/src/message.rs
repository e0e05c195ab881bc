//! Messages that the broker stores: retained, queued, or sent and not yet acknowledged.

use std::time::{Duration, Instant};
use swarmwright_packets::{Publish, expiry_of, without_expiry};

/// A published message with owned contents.
#[derive(Debug)]
pub struct Message {
    pub topic: Box<str>,
    pub payload: Box<[u8]>,
    /// MQTT 5 properties without the message expiry.
    pub properties: Box<[u8]>,
    pub qos: u8,
    /// Retain flag, as published.
    pub retain: bool,
    /// When the message expires, if it does.
    pub expires: Option<Instant>,
}

impl Message {
    /// Creates a copy of a message received at `now`.
    pub fn new(publish: &Publish<'_>, now: Instant) -> Self {
        let expires =
            expiry_of(publish.properties).map(|seconds| now + Duration::from_secs(seconds.into()));
        let properties = match expires {
            Some(_) => without_expiry(publish.properties).into(),
            None => publish.properties.into(),
        };
        Self {
            topic: publish.topic.into(),
            payload: publish.payload.into(),
            properties,
            qos: publish.qos,
            retain: publish.retain,
            expires,
        }
    }

    /// Returns the remaining seconds, rounded up; `None` without expiry.
    pub fn seconds_left(&self, now: Instant) -> Option<u32> {
        let left = self
            .expires?
            .saturating_duration_since(now)
            .as_millis()
            .div_ceil(1000);
        Some(u32::try_from(left).unwrap_or(u32::MAX))
    }

    pub fn is_void(&self, now: Instant) -> bool {
        self.expires.is_some_and(|end| end <= now)
    }

    /// Returns the approximate number of bytes needed to store the message.
    pub fn size(&self) -> usize {
        self.topic.len() + self.payload.len() + self.properties.len() + size_of::<Self>()
    }
}
