//! Measured durations, and a bound above which the next one is suspicious.

use std::time::Duration;

/// Number of durations needed before a bound is set.
const MIN_SAMPLES: u32 = 4;
/// Factor by which a duration may exceed the longest recent one.
const TOLERANCE_FACTOR: f64 = 8.0;
/// Factor by which the longest duration decays with each further one, so that a single slow one is forgotten over time.
pub(crate) const DECAY: f64 = 0.99;

/// Statistics of one kind of duration on one server.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct Pace {
    longest: f64,
    known: u32,
}

impl Pace {
    pub fn measured(&mut self, duration: Duration) {
        self.longest = (self.longest * DECAY).max(duration.as_secs_f64());
        self.known = self.known.saturating_add(1);
    }

    /// Returns the duration above which one is suspicious, at least `least`; `None` while too few are known.
    pub fn bound(&self, least: Duration) -> Option<Duration> {
        (self.known >= MIN_SAMPLES)
            .then(|| {
                Duration::try_from_secs_f64(self.longest * TOLERANCE_FACTOR)
                    .unwrap_or(Duration::MAX)
            })
            .map(|bound| bound.max(least))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_bound_is_learnt_and_follows_what_becomes_slower() {
        let mut pace = Pace::default();
        let least = Duration::from_millis(100);
        for _ in 0..MIN_SAMPLES {
            assert_eq!(pace.bound(least), None);
            pace.measured(Duration::from_millis(20));
        }
        assert_eq!(pace.bound(least), Some(Duration::from_millis(160)));
        assert_eq!(
            pace.bound(Duration::from_secs(1)),
            Some(Duration::from_secs(1))
        );
        pace.measured(Duration::from_millis(500));
        assert_eq!(pace.bound(least), Some(Duration::from_secs(4)));
        for _ in 0..1000 {
            pace.measured(Duration::from_millis(20));
        }
        assert_eq!(pace.bound(least), Some(Duration::from_millis(160)));
    }
}
