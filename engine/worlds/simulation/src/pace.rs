//! Duration of evaluations, and whether they justify more than one thread.

use std::sync::atomic::{AtomicUsize, Ordering};
use std::time::Duration;

/// For how many evaluations a thread takes about as long as a part of a whole, as far as is known.
#[derive(Debug)]
pub struct Pace {
    part: Duration,
    /// Where all threads work, each.
    each: AtomicUsize,
    /// Where only one works; 0: it is not known.
    alone: AtomicUsize,
}

impl Pace {
    /// `first`: evaluations of a thread, as long as nothing is known.
    #[must_use]
    pub fn new(part: Duration, first: usize) -> Self {
        Self {
            part,
            each: AtomicUsize::new(first),
            alone: AtomicUsize::new(0),
        }
    }

    /// For how many evaluations a thread takes as long as a part.
    #[must_use]
    pub fn each(&self) -> usize {
        self.each.load(Ordering::Relaxed)
    }

    /// Whether one thread takes less than a part divided by `share` for these evaluations; if unknown, whether all threads do.
    #[must_use]
    pub fn is_less(&self, share: usize, evaluations: usize, threads: usize) -> bool {
        match self.alone.load(Ordering::Relaxed) {
            0 => evaluations.div_ceil(threads).saturating_mul(share) < self.each(),
            alone => evaluations.saturating_mul(share) < alone,
        }
    }

    /// Notes how long `threads` threads took for evaluations.
    pub fn note(&self, evaluations: usize, threads: usize, took: Duration) {
        let factor = self.part.as_secs_f64() / took.as_secs_f64().max(1e-6);
        let each = scaled(evaluations.div_ceil(threads), factor);
        self.each.store(each, Ordering::Relaxed);
        let before = self.alone.load(Ordering::Relaxed);
        let alone = match (threads, before) {
            // It may have been interrupted by another process.
            (1, _) => each.max(before / 2),
            (_, 0) => 0,
            // It is tried again now and then.
            _ => each.max(before.saturating_add(before / 64 + 1)),
        };
        self.alone.store(alone, Ordering::Relaxed);
    }
}

#[expect(
    clippy::cast_possible_truncation,
    clippy::cast_precision_loss,
    clippy::cast_sign_loss,
    reason = "limited to what an index can be"
)]
fn scaled(count: usize, factor: f64) -> usize {
    (count as f64 * factor.clamp(0.1, 1000.0)).clamp(1.0, 1e9) as usize
}
