//! Warnings about what others send: each is made once, and few of a kind in a time, whatever they send.

use std::collections::{HashMap, HashSet};
use std::time::{Duration, Instant};

/// Different warnings that are remembered, so that each is made once.
const REMEMBERED: usize = 1000;
/// Different warnings of a kind that are made within [`WINDOW`].
const MOST: usize = 10;
/// Kinds that are told apart within it: some have words of other peers.
const KINDS: usize = 20;
/// After this time those that were left out are counted in one more, and others are made again.
const WINDOW: Duration = Duration::from_secs(10);

/// What was warned of.
#[derive(Debug, Default)]
pub(super) struct Complaints {
    made: HashSet<String>,
    /// When the window ends.
    until: Option<Instant>,
    /// Warnings within it by their kind, which is what stands before the first colon.
    kinds: HashMap<String, usize>,
    left_out: usize,
}

impl Complaints {
    /// Whether a warning is to be made.
    pub fn make(&mut self, text: &str, now: Instant) -> bool {
        if self.made.contains(text) {
            return false;
        }
        if self.left_out == 0 && self.until.is_none_or(|until| until <= now) {
            self.until = Some(now + WINDOW);
            self.kinds.clear();
        }
        let kind = text.split(':').next().unwrap_or_default();
        let is_counted = self.kinds.len() < KINDS || self.kinds.contains_key(kind);
        let count = self
            .kinds
            .entry(if is_counted { kind } else { "" }.to_owned())
            .or_default();
        *count += 1;
        if *count > MOST {
            self.left_out += 1;
            return false;
        }
        if self.made.len() >= REMEMBERED {
            self.made.clear();
        }
        self.made.insert(text.to_owned())
    }

    /// When it is to be said how many were left out.
    pub fn due(&self) -> Option<Instant> {
        self.until.filter(|_| self.left_out > 0)
    }

    /// Says how many were left out, if that is due.
    pub fn left_out(&mut self, now: Instant) -> Option<String> {
        self.due().filter(|due| *due <= now)?;
        let count = std::mem::take(&mut self.left_out);
        Some(format!(
            "{count} more warnings within {} s are not shown",
            WINDOW.as_secs()
        ))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// How many of 500 different warnings are made.
    fn made(complaints: &mut Complaints, kinds: usize, window: usize, now: Instant) -> usize {
        (0..500)
            .filter(|text| complaints.make(&format!("{}: {window} {text}", text % kinds), now))
            .count()
    }

    #[test]
    fn whatever_comes_few_of_a_kind_are_made_and_the_others_are_counted() {
        let mut complaints = Complaints::default();
        let mut now = Instant::now();
        for window in 0..300 {
            assert_eq!(made(&mut complaints, 2, window, now), 2 * MOST);
            assert_eq!(complaints.due(), Some(now + WINDOW));
            assert_eq!(complaints.left_out(now), None);
            now += WINDOW;
            assert!(
                !complaints.make(&format!("0: late, {window}"), now),
                "first it is said how many there were"
            );
            let said = complaints.left_out(now).unwrap_or_default();
            assert!(said.starts_with("481 more"), "{said}");
            assert_eq!(complaints.due(), None);
        }
    }

    #[test]
    fn kinds_with_words_of_others_are_bounded() {
        let mut complaints = Complaints::default();
        let now = Instant::now();
        assert_eq!(made(&mut complaints, 500, 0, now), KINDS + MOST);
    }

    #[test]
    fn each_is_made_once() {
        let (mut complaints, now) = (Complaints::default(), Instant::now());
        assert!(complaints.make("one", now));
        assert!(!complaints.make("one", now));
        assert!(!complaints.make("one", now + 2 * WINDOW));
        assert_eq!(complaints.left_out(now + 2 * WINDOW), None);
    }
}
