//! Retained messages: the last message of each topic, for clients that subscribe later.

use crate::message::Message;
use std::collections::BTreeMap;
use std::ops::Bound;
use std::sync::Arc;
use std::time::Instant;
use swarmwright_packets::topic;

/// All retained messages, limited in total bytes.
pub struct Retained {
    messages: BTreeMap<Box<str>, Entry>,
    bytes: usize,
    limit: usize,
    /// Number of messages stored so far, which is the number of the next one.
    count: u64,
}

struct Entry {
    message: Arc<Message>,
    number: u64,
}

/// A search of the store for one topic filter, which can be done in pieces.
#[derive(Debug)]
pub struct Search {
    filter: Box<str>,
    /// Last examined topic.
    after: Option<Box<str>>,
    /// Messages from this number on are newer than the search; the subscriber received them when they were published.
    until: u64,
}

impl Retained {
    /// Creates an empty store with a limit in bytes.
    pub fn new(limit: usize) -> Self {
        Self {
            messages: BTreeMap::new(),
            bytes: 0,
            limit,
            count: 0,
        }
    }

    /// Stores a message in place of an earlier one; a message without payload only removes the earlier one. Returns
    /// false if there is no room.
    pub fn set(&mut self, message: &Arc<Message>) -> bool {
        if let Some(earlier) = self.messages.remove(&message.topic) {
            self.bytes -= earlier.message.size();
        }
        if message.payload.is_empty() {
            return true;
        }
        if self.bytes + message.size() > self.limit {
            return false;
        }
        self.bytes += message.size();
        let entry = Entry {
            message: Arc::clone(message),
            number: self.count,
        };
        self.count += 1;
        self.messages.insert(message.topic.clone(), entry);
        true
    }

    /// Returns the approximate number of bytes of all messages.
    pub fn size(&self) -> usize {
        self.bytes
    }

    /// Starts a search for the current messages that match a valid filter.
    pub fn search(&self, filter: &str) -> Search {
        Search {
            filter: filter.into(),
            after: None,
            until: self.count,
        }
    }

    /// Returns the next message of a search, in order of topics; `None` at the end, or once `budget`, the number of
    /// topics that may be examined, is 0. At the end of a search the budget is above 0.
    pub fn next(
        &self,
        search: &mut Search,
        budget: &mut usize,
        now: Instant,
    ) -> Option<Arc<Message>> {
        if *budget == 0 {
            return None;
        }
        let until = search.until;
        let fits = |entry: &&Entry| entry.number < until && !entry.message.is_void(now);
        let (fixed, has_wildcards) = fixed_part(&search.filter);
        if !has_wildcards {
            let first = search.after.replace(search.filter.clone()).is_none();
            let entry = first.then(|| self.messages.get(&search.filter)).flatten();
            return entry.filter(fits).map(|entry| Arc::clone(&entry.message));
        }
        let start = match &search.after {
            Some(after) => Bound::Excluded(after.as_ref()),
            None => Bound::Included(fixed),
        };
        for (topic, entry) in self.messages.range::<str, _>((start, Bound::Unbounded)) {
            if !topic.starts_with(fixed) {
                return None;
            }
            *budget -= 1;
            let is_wanted = topic::matches(&search.filter, topic) && fits(&entry);
            if is_wanted || *budget == 0 {
                search.after = Some(topic.clone());
            }
            if is_wanted {
                return Some(Arc::clone(&entry.message));
            }
            if *budget == 0 {
                return None;
            }
        }
        None
    }

    /// Removes expired messages.
    pub fn sweep(&mut self, now: Instant) {
        let bytes = &mut self.bytes;
        self.messages.retain(|_, entry| {
            let keep = !entry.message.is_void(now);
            if !keep {
                *bytes -= entry.message.size();
            }
            keep
        });
    }
}

/// Returns the common prefix of all topics that a filter matches, and whether the filter has wildcards.
fn fixed_part(filter: &str) -> (&str, bool) {
    match filter.find(['+', '#']) {
        // `a/#` matches `a` as well.
        Some(index) => (filter[..index].trim_end_matches('/'), true),
        None => (filter, false),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::time::Duration;
    use swarmwright_packets::Publish;

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

    /// Returns the topics that a search finds with this budget per piece.
    fn found(store: &Retained, mut search: Search, piece: usize, now: Instant) -> Vec<String> {
        let mut topics = Vec::new();
        loop {
            let mut budget = piece;
            while let Some(message) = store.next(&mut search, &mut budget, now) {
                topics.push(message.topic.to_string());
            }
            if budget > 0 {
                return topics;
            }
        }
    }

    #[test]
    fn a_search_in_pieces_finds_what_was_there_when_it_began() {
        let now = Instant::now();
        let mut store = Retained::new(1 << 20);
        for topic in ["a", "a/b", "a/b/c", "a/c", "ab", "b/c", "$a/b"] {
            assert!(store.set(&message(topic, b"1", &[], now)));
        }
        for (filter, expected) in [
            ("#", vec!["a", "a/b", "a/b/c", "a/c", "ab", "b/c"]),
            ("a/#", vec!["a", "a/b", "a/b/c", "a/c"]),
            ("+/c", vec!["a/c", "b/c"]),
            ("a/+", vec!["a/b", "a/c"]),
            ("a/b", vec!["a/b"]),
            ("x", vec![]),
            ("$a/+", vec!["$a/b"]),
        ] {
            for piece in [1, 2, 3, 100] {
                assert_eq!(
                    found(&store, store.search(filter), piece, now),
                    expected,
                    "{filter}"
                );
            }
        }
        let mut search = store.search("+/c");
        let mut budget = 100;
        assert!(store.next(&mut search, &mut budget, now).is_some());
        assert!(
            store.set(&message("b/c", b"2", &[], now)),
            "its subscriber got this one as it came"
        );
        assert!(store.next(&mut search, &mut budget, now).is_none());
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
        assert_eq!(found(&store, store.search("#"), 9, now), ["b"]);
        let later = now + Duration::from_secs(2);
        assert!(found(&store, store.search("b"), 9, later).is_empty());
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
