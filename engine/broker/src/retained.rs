//! Retained messages: the last one of each topic, for those who subscribe later.

use crate::{message::Message, topic};
use std::collections::BTreeMap;
use std::sync::Arc;
use std::time::Instant;

/// All retained messages, bounded by bytes.
pub struct Retained {
    messages: BTreeMap<Box<str>, Arc<Message>>,
    bytes: usize,
    limit: usize,
}

impl Retained {
    /// An empty store that takes up to `limit` bytes.
    pub fn new(limit: usize) -> Self {
        Self {
            messages: BTreeMap::new(),
            bytes: 0,
            limit,
        }
    }

    /// Keeps the message in place of an earlier one; one without payload only removes. False = no room.
    pub fn set(&mut self, message: &Arc<Message>) -> bool {
        if let Some(earlier) = self.messages.remove(&message.topic) {
            self.bytes -= earlier.size();
        }
        if message.payload.is_empty() {
            return true;
        }
        if self.bytes + message.size() > self.limit {
            return false;
        }
        self.bytes += message.size();
        self.messages
            .insert(message.topic.clone(), Arc::clone(message));
        true
    }

    /// Those that a filter covers and that are not void, by topic.
    pub fn matching(&self, filter: &str, now: Instant) -> Vec<Arc<Message>> {
        if !filter.contains(['+', '#']) {
            let found = self
                .messages
                .get(filter)
                .filter(|message| !message.is_void(now));
            return found.cloned().into_iter().collect();
        }
        self.messages
            .values()
            .filter(|message| topic::matches(filter, &message.topic) && !message.is_void(now))
            .cloned()
            .collect()
    }

    /// Forgets those that have become void.
    pub fn sweep(&mut self, now: Instant) {
        let bytes = &mut self.bytes;
        self.messages.retain(|_, message| {
            let keep = !message.is_void(now);
            if !keep {
                *bytes -= message.size();
            }
            keep
        });
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::codec::Publish;
    use std::time::Duration;

    fn message(topic: &str, payload: &[u8], properties: &[u8], now: Instant) -> Arc<Message> {
        let publish = Publish {
            topic,
            payload,
            properties,
            qos: 0,
            retain: true,
            id: 0,
        };
        Arc::new(Message::new(&publish, now))
    }

    #[test]
    fn nothing_stays_behind_when_messages_are_replaced_cleared_or_void() {
        let now = Instant::now();
        let mut store = Retained::new(10_000);
        for round in 0..1000u32 {
            assert!(store.set(&message("a", &round.to_be_bytes(), &[], now)));
        }
        assert!(store.set(&message("a", b"", &[], now)));
        assert!(store.set(&message("b", b"soon void", &[2, 0, 0, 0, 1], now)));
        assert_eq!(store.matching("#", now).len(), 1);
        let later = now + Duration::from_secs(2);
        assert!(store.matching("b", later).is_empty());
        store.sweep(later);
        assert_eq!((store.bytes, store.messages.len()), (0, 0));
    }

    #[test]
    fn a_full_store_refuses() {
        let now = Instant::now();
        let mut store = Retained::new(1000);
        assert!(!store.set(&message("big", &[1; 2000], &[], now)));
        assert!(store.set(&message("small", &[1; 20], &[], now)));
    }
}
