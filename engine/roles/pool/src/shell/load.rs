//! Load of the machine.

use std::num::NonZero;
use std::time::{Duration, Instant};

/// Interval between two measurements.
const INTERVAL: Duration = Duration::from_millis(500);
/// Share of the slowdown that is kept from one measurement to the next, so that a quiet moment does not count as the end
/// of the load.
const DECAY: f64 = 0.9;
/// Upper limit of the slowdown.
const MOST: f64 = 30.0;

/// The most recent measurement of the machine's load.
pub(crate) struct Load {
    look_at: Instant,
    slowdown: f64,
}

impl Load {
    pub fn new(now: Instant) -> Self {
        Self {
            look_at: now,
            slowdown: 1.0,
        }
    }

    /// Measures the factor by which the machine slows down its processes; `None` if no measurement is due.
    pub fn look(&mut self, now: Instant) -> Option<f64> {
        if now < self.look_at {
            return None;
        }
        self.look_at = now + INTERVAL;
        let processors = std::thread::available_parallelism().map_or(1, NonZero::get);
        // Only Linux has this file.
        let text = std::fs::read_to_string("/proc/loadavg").unwrap_or_default();
        let load = slowdown(&text, processors);
        self.slowdown = load.max(self.slowdown * DECAY).clamp(1.0, MOST);
        Some(self.slowdown)
    }
}

/// Returns the number of runnable threads per processor, at least 1; `loadavg` is the text of Linux's `/proc/loadavg`.
fn slowdown(loadavg: &str, processors: usize) -> f64 {
    let mut words = loadavg.split_ascii_whitespace();
    let minute = words.next().and_then(|word| word.parse::<f64>().ok());
    let now = words.nth(2).and_then(|word| word.split_once('/'));
    let now = now.and_then(|(running, _)| running.parse::<f64>().ok());
    #[expect(clippy::cast_precision_loss, reason = "a few processors")]
    let processors = processors.max(1) as f64;
    let load = minute.unwrap_or(0.0).max(now.unwrap_or(0.0)) / processors;
    if load.is_finite() { load.max(1.0) } else { 1.0 }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn threads_that_wait_for_a_processor_slow_the_others_down() {
        let is = |text: &str, processors, expected: f64| {
            let found = slowdown(text, processors);
            assert!((found - expected).abs() < 1e-9, "{text}: {found}");
        };
        is("0.50 0.40 0.30 1/900 4242", 2, 1.0);
        is("24.00 20.95 15.19 3/1200 4242", 2, 12.0);
        is("0.10 0.05 0.01 8/1200 4242", 2, 4.0);
        for text in ["", "a b c d e", "nan 0 0 1/2 3", "1.0"] {
            is(text, 2, 1.0);
        }
    }

    #[test]
    fn a_busy_machine_is_not_forgotten_at_once() {
        let now = Instant::now();
        let mut load = Load::new(now);
        assert!(load.look(now).is_some_and(|slowdown| slowdown >= 1.0));
        assert_eq!(load.look(now), None);
        load.slowdown = MOST;
        let later = load.look(now + INTERVAL).unwrap_or_default();
        assert!(later >= MOST * DECAY, "{later}");
    }
}
