//! Conversion of instants to the time of day.

use std::time::{Instant, SystemTime, UNIX_EPOCH};

use crate::journal::Attempt;

/// An instant and its time of day.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Wall {
    zero: Instant,
    since_1970: f64,
}

impl Wall {
    /// Creates a clock at the current time.
    pub fn new(now: Instant) -> Self {
        let since_1970 = SystemTime::now().duration_since(UNIX_EPOCH);
        Self {
            zero: now,
            since_1970: since_1970.unwrap_or_default().as_secs_f64(),
        }
    }

    /// Returns an attempt with its start in seconds since 1970.
    pub fn dated(self, attempt: Attempt, started: Instant) -> Attempt {
        let since = started.saturating_duration_since(self.zero);
        Attempt {
            started: self.since_1970 + since.as_secs_f64(),
            ..attempt
        }
    }
}

#[cfg(test)]
mod tests {
    use std::time::Duration;

    use super::*;

    #[test]
    fn attempts_have_the_time_of_day_at_which_they_began() {
        let now = Instant::now();
        let wall = Wall::new(now);
        let dated = |seconds| {
            let started = now + Duration::from_secs(seconds);
            wall.dated(Attempt::default(), started).started
        };
        let today = SystemTime::now().duration_since(UNIX_EPOCH).unwrap();
        assert!((dated(0) - today.as_secs_f64()).abs() < 60.0);
        assert!((dated(90) - dated(0) - 90.0).abs() < 1e-3);
    }
}
