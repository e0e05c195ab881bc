//! Outages of the broker, during which silence is not the servers' fault.

use std::collections::VecDeque;
use std::time::{Duration, Instant, SystemTime};

/// Largest number of outages that are kept; the oldest ones are forgotten first.
const MAX_KEPT: usize = 100;
/// Number of the latest outages that are described one by one.
const MAX_TOLD: usize = 3;

/// An outage, measured by both clocks; `end` is `None` while it lasts.
#[derive(Debug)]
struct Outage {
    start: (Instant, SystemTime),
    end: Option<(Instant, SystemTime)>,
    reason: String,
}

/// Outages of the connection to the broker.
#[derive(Debug, Default)]
pub(crate) struct Outages {
    all: VecDeque<Outage>,
}

impl Outages {
    /// Records that the connection broke.
    pub fn lost(&mut self, reason: &str, now: Instant, wall: SystemTime) {
        if self.is_down() {
            return;
        }
        if self.all.len() >= MAX_KEPT {
            self.all.pop_front();
        }
        self.all.push_back(Outage {
            start: (now, wall),
            end: None,
            reason: reason.to_owned(),
        });
    }

    /// Records that the connection was restored.
    pub fn back(&mut self, now: Instant, wall: SystemTime) {
        if let Some(last) = self.all.back_mut() {
            last.end.get_or_insert((now, wall));
        }
    }

    /// Returns whether the broker is unreachable.
    pub fn is_down(&self) -> bool {
        self.all.back().is_some_and(|last| last.end.is_none())
    }

    /// Returns how long the broker has been unreachable; zero if it is reachable.
    pub fn down_for(&self, now: Instant) -> Duration {
        let last = self.all.back().filter(|last| last.end.is_none());
        last.map_or(Duration::ZERO, |last| {
            now.saturating_duration_since(last.start.0)
        })
    }

    /// Returns how long the broker has been reachable since `since`.
    pub fn reachable(&self, since: Instant, now: Instant) -> Duration {
        let down: Duration = self
            .all
            .iter()
            .map(|outage| {
                let end = outage.end.map_or(now, |(end, _)| end);
                end.saturating_duration_since(outage.start.0.max(since))
            })
            .sum();
        now.saturating_duration_since(since).saturating_sub(down)
    }

    /// Describes the outages since `since`; `None` if there were none.
    pub fn describe(&self, since: Instant, now: Instant, wall: SystemTime) -> Option<String> {
        let recent = |outage: &&Outage| outage.end.is_none_or(|(end, _)| end > since);
        let outages: Vec<&Outage> = self.all.iter().filter(recent).collect();
        let latest = outages[outages.len().saturating_sub(MAX_TOLD)..].iter();
        let latest: Vec<String> = latest
            .map(|outage| {
                let (end, until) = outage.end.unwrap_or((now, wall));
                let seconds = end.saturating_duration_since(outage.start.0).as_secs_f64();
                let [from, to] = [outage.start.1, until].map(humantime::format_rfc3339_seconds);
                format!("from {from} to {to} ({seconds:.1} s; {})", outage.reason)
            })
            .collect();
        if latest.is_empty() {
            return None;
        }
        let before = match outages.len() - latest.len() {
            0 => String::new(),
            more => format!("{more} times before, and "),
        };
        Some(format!("{before}{}", latest.join(" and ")))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn time_without_broker_is_told_and_does_not_count() {
        let (start, wall) = (Instant::now(), SystemTime::UNIX_EPOCH);
        let at = |seconds| {
            let after = Duration::from_secs(seconds);
            (start + after, wall + after)
        };
        let mut outages = Outages::default();
        assert_eq!(outages.describe(start, at(9).0, at(9).1), None);
        outages.lost("reset", at(2).0, at(2).1);
        assert_eq!(outages.down_for(at(4).0), Duration::from_secs(2));
        outages.back(at(5).0, at(5).1);
        assert!(!outages.is_down());
        outages.lost("closed", at(9).0, at(9).1);
        let (now, time) = at(10);
        assert_eq!(outages.reachable(start, now), Duration::from_secs(6));
        assert_eq!(outages.reachable(at(4).0, now), Duration::from_secs(4));
        let told = outages.describe(start, now, time).unwrap_or_default();
        assert_eq!(
            told,
            "from 1970-01-01T00:00:02Z to 1970-01-01T00:00:05Z (3.0 s; reset) and from 1970-01-01T00:00:09Z to \
             1970-01-01T00:00:10Z (1.0 s; closed)"
        );
        let later = outages.describe(at(6).0, now, time).unwrap_or_default();
        assert!(later.starts_with("from 1970-01-01T00:00:09Z"), "{later}");
        for second in 11..30 {
            outages.back(at(second).0, at(second).1);
            outages.lost("closed", at(second).0, at(second).1);
        }
        let (now, time) = at(30);
        let told = outages.describe(start, now, time).unwrap_or_default();
        assert!(told.starts_with("18 times before, and from"), "{told}");
    }
}
