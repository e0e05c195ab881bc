//! Warnings about messages of others: each is issued once, and the number per kind and time is limited.

use std::collections::{HashMap, HashSet};
use std::time::{Duration, Instant};

/// Largest number of different warnings that are remembered to suppress repetitions.
const REMEMBERED: usize = 1000;
/// Largest number of different warnings per kind within [`WINDOW`].
const MOST: usize = 10;
/// Largest number of kinds per window; some kinds contain text of other clients.
const KINDS: usize = 20;
/// Period after which the suppressed warnings are reported as a count and the limits start anew.
const WINDOW: Duration = Duration::from_secs(10);

/// Warnings issued so far, and their counts.
#[derive(Debug, Default)]
pub(super) struct Complaints {
    made: HashSet<String>,
    /// End of the window.
    until: Option<Instant>,
    /// Number of warnings in the window by kind, which is the text before the first colon.
    kinds: HashMap<String, usize>,
    left_out: usize,
}

impl Complaints {
    /// Returns whether to issue a warning.
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

    /// Returns when to report the number of suppressed warnings.
    pub fn due(&self) -> Option<Instant> {
        self.until.filter(|_| self.left_out > 0)
    }

    /// Returns the report of suppressed warnings, if it is due.
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

    /// Returns how many of 500 different warnings are issued.
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
