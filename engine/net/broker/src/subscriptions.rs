//! Subscriptions: the topic filters of all sessions as a tree of levels, so that finding the readers of a topic costs
//! time in proportion to its levels, not to the number of subscriptions.

use std::collections::{BTreeMap, HashMap};

/// The deepest topic filter, levels. Deeper ones are refused: no protocol has them, and each level takes memory.
pub const DEEPEST: usize = 128;

/// How a client subscribes to one topic filter.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Options {
    pub qos: u8,
    pub no_local: bool,
    pub retain_as_published: bool,
    pub identifier: Option<u32>,
}

/// The topic filters of all sessions; a session is known by its number.
#[derive(Default)]
pub struct Subscriptions {
    root: Level,
}

#[derive(Default)]
struct Level {
    /// What comes after this level; `+` and `#` are keys like others.
    next: HashMap<Box<str>, Level>,
    /// The sessions whose filter ends here.
    readers: BTreeMap<usize, Options>,
}

impl Subscriptions {
    /// Adds the subscription of a session, in place of an earlier one with this filter, which is valid and no deeper than
    /// [`DEEPEST`].
    pub fn add(&mut self, session: usize, filter: &str, options: Options) {
        let mut level = &mut self.root;
        for name in filter.split('/') {
            // Two look-ups rather than an owned key for a level that is there already.
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

    /// Whether there are no subscriptions.
    #[cfg(test)]
    pub fn is_empty(&self) -> bool {
        self.root.next.is_empty()
    }

    /// All subscriptions that cover a topic name, as session and options, sorted by session and subscription identifier.
    pub fn covering(&self, topic: &str) -> Vec<(usize, Options)> {
        let mut subscribers = Vec::new();
        let names: Vec<&str> = topic.split('/').take(DEEPEST + 1).collect();
        // Topics that start with `$` are covered by filters that do so too (MQTT 5.0, 4.7.2).
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
    // `a/#` covers `a` as well.
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

/// True when the level holds nothing any more.
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
