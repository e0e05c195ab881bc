//! Subscriptions: the topic filters of all sessions as a tree of levels, so that the time to find the readers of a
//! topic is proportional to its number of levels instead of the number of subscriptions.

use std::collections::{BTreeMap, HashMap};

/// Largest number of levels of a topic filter. Deeper ones are refused: no protocol needs them, and each level takes
/// memory.
pub const DEEPEST: usize = 128;

/// Options of a client's subscription to one topic filter.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Options {
    pub qos: u8,
    pub no_local: bool,
    pub retain_as_published: bool,
    pub identifier: Option<u32>,
}

/// Topic filters of all sessions, which are identified by number.
#[derive(Default)]
pub struct Subscriptions {
    root: Level,
}

#[derive(Default)]
struct Level {
    /// Next levels; `+` and `#` are ordinary keys.
    next: HashMap<Box<str>, Level>,
    /// Sessions whose filters end at this level.
    readers: BTreeMap<usize, Options>,
}

impl Subscriptions {
    /// Adds a session's subscription, replacing an earlier one with this filter. The filter must be valid and no deeper
    /// than [`DEEPEST`].
    pub fn add(&mut self, session: usize, filter: &str, options: Options) {
        let mut level = &mut self.root;
        for name in filter.split('/') {
            // Two look-ups avoid an owned key for an existing level.
            if !level.next.contains_key(name) {
                level.next.insert(name.into(), Level::default());
            }
            let Some(next) = level.next.get_mut(name) else {
                return;
            };
            level = next;
        }
        level.readers.insert(session, options);
    }

    /// Removes a subscription, and the levels that became empty.
    pub fn remove(&mut self, session: usize, filter: &str) {
        prune(&mut self.root, session, filter.split('/'));
    }

    /// Returns whether there are no subscriptions.
    #[cfg(test)]
    pub fn is_empty(&self) -> bool {
        self.root.next.is_empty()
    }

    /// Returns all subscriptions that match a topic name, sorted by session and subscription identifier.
    pub fn covering(&self, topic: &str) -> Vec<(usize, Options)> {
        let mut subscribers = Vec::new();
        let names: Vec<&str> = topic.split('/').take(DEEPEST + 1).collect();
        // Topics that start with `$` only match filters that do, too (MQTT 5.0, 4.7.2).
        collect(&self.root, &names, topic.starts_with('$'), &mut subscribers);
        subscribers.sort_by_key(|(session, options)| (*session, options.identifier));
        subscribers
    }
}

fn collect(level: &Level, names: &[&str], hidden: bool, subscribers: &mut Vec<(usize, Options)>) {
    let readers = |level: &Level, subscribers: &mut Vec<_>| {
        subscribers.extend(
            level
                .readers
                .iter()
                .map(|(&session, &options)| (session, options)),
        );
    };
    // `a/#` matches `a` as well.
    if let Some(rest) = level.next.get("#").filter(|_| !hidden) {
        readers(rest, subscribers);
    }
    let Some((name, after)) = names.split_first() else {
        return readers(level, subscribers);
    };
    if let Some(next) = level.next.get(*name) {
        collect(next, after, false, subscribers);
    }
    if let Some(next) = level.next.get("+").filter(|_| !hidden) {
        collect(next, after, false, subscribers);
    }
}

/// Removes a subscription below a level. Returns whether the level is empty.
fn prune<'a>(level: &mut Level, session: usize, mut names: impl Iterator<Item = &'a str>) -> bool {
    match names.next() {
        None => {
            level.readers.remove(&session);
        }
        Some(name) => {
            if let Some(next) = level.next.get_mut(name)
                && prune(next, session, names)
            {
                level.next.remove(name);
            }
        }
    }
    level.next.is_empty() && level.readers.is_empty()
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;
    use swarmwright_packets::topic;

    fn options(identifier: u32) -> Options {
        Options {
            qos: 0,
            no_local: false,
            retain_as_published: false,
            identifier: Some(identifier),
        }
    }

    proptest! {
        #[test]
        fn the_tree_finds_what_comparing_each_filter_finds(
            filters in prop::collection::vec(prop::collection::vec("[ab+#]?|\\$a", 1..5), 1..40),
            topics in prop::collection::vec(prop::collection::vec("[ab]?|\\$a", 1..6), 1..20),
            removed in prop::collection::vec(any::<prop::sample::Index>(), 0..20),
        ) {
            let mut filters: Vec<String> = filters.iter().map(|levels| levels.join("/")).filter(|it| topic::is_filter(it)).collect();
            filters.sort();
            filters.dedup();
            let mut tree = Subscriptions::default();
            for (session, filter) in filters.iter().enumerate() {
                tree.add(session, filter, options(0));
            }
            let mut kept: Vec<(usize, &String)> = filters.iter().enumerate().collect();
            for index in removed {
                if !kept.is_empty() {
                    let (session, filter) = kept.remove(index.index(kept.len()));
                    tree.remove(session, filter);
                }
            }
            for topic in topics.iter().map(|levels| levels.join("/")).filter(|it| topic::is_name(it)) {
                let found: Vec<usize> = tree.covering(&topic).into_iter().map(|(session, _)| session).collect();
                let expected: Vec<usize> =
                    kept.iter().filter(|(_, filter)| topic::matches(filter, &topic)).map(|(session, _)| *session).collect();
                prop_assert_eq!(found, expected, "{}", topic);
            }
            for (session, filter) in kept {
                tree.remove(session, filter);
            }
            prop_assert!(tree.root.next.is_empty());
        }
    }

    #[test]
    fn the_last_options_of_a_filter_count() {
        let mut tree = Subscriptions::default();
        tree.add(1, "a/+", options(5));
        tree.add(1, "a/+", options(6));
        tree.add(1, "a/#", options(2));
        let identifiers: Vec<_> = tree
            .covering("a/b")
            .into_iter()
            .map(|(_, it)| it.identifier)
            .collect();
        assert_eq!(identifiers, [Some(2), Some(6)]);
    }
}
