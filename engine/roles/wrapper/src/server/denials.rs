//! Topics on which the broker denies publishing.

use std::collections::HashSet;
use std::time::{Duration, Instant};

/// Period after the start in which a server leaves if the broker denies its presence and closes the connection; later,
/// access may be restored.
const BEGINNING: Duration = Duration::from_secs(10);
/// Time after a denial within which the end of the connection is attributed to it.
const AT_ONCE: Duration = Duration::from_secs(2);
/// Largest number of different denials that are reported; some topics contain text of tools.
const MOST: usize = 100;

/// Denials that a server has received.
#[derive(Debug)]
pub(super) struct Denials {
    began: Instant,
    told: HashSet<String>,
    /// When presence was last denied, and the message.
    presence: Option<(Instant, String)>,
}

impl Denials {
    /// Creates the state of a server that starts.
    pub fn new(now: Instant) -> Self {
        Self {
            began: now,
            told: HashSet::new(),
            presence: None,
        }
    }

    /// Records a denial. Returns whether to warn about it; it recurs with every reconnection.
    pub fn note(&mut self, message: &str, is_presence: bool, now: Instant) -> bool {
        if is_presence {
            self.presence = Some((now, message.to_owned()));
        }
        self.told.len() < MOST && self.told.insert(message.to_owned())
    }

    /// Handles the end of the connection. Returns the denial because of which this server must leave, as no tool would
    /// use it.
    pub fn reason_to_leave(&self, now: Instant) -> Option<String> {
        let (at, message) = self.presence.as_ref()?;
        (now < self.began + BEGINNING && now < *at + AT_ONCE).then(|| message.clone())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_server_leaves_where_its_presence_is_denied_from_the_beginning() {
        let start = Instant::now();
        let at = |seconds| start + Duration::from_secs(seconds);
        let mut denials = Denials::new(start);
        assert!(denials.note("a fitness", false, at(0)));
        assert_eq!(denials.reason_to_leave(at(0)), None);
        assert!(denials.note("its presence", true, at(1)));
        assert!(!denials.note("its presence", true, at(1)), "told once");
        assert_eq!(
            denials.reason_to_leave(at(2)).as_deref(),
            Some("its presence")
        );
        assert_eq!(denials.reason_to_leave(at(4)), None, "for another reason");
        assert!(!denials.note("its presence", true, at(60)));
        assert_eq!(denials.reason_to_leave(at(60)), None, "it was at work");
    }

    #[test]
    fn what_is_told_is_bounded() {
        let now = Instant::now();
        let mut denials = Denials::new(now);
        let told = (0..1000).filter(|topic| denials.note(&topic.to_string(), false, now));
        assert_eq!(told.count(), MOST);
    }
}
