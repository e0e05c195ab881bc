//! Estimate of the largest size that the broker accepts, learnt from accepted sizes and lost connections.
//!
//! The limit is advisory: it grows again after a while, since a connection may have ended for another reason and the
//! broker's configuration may change.

use std::time::{Duration, Instant};

/// Number of connections in a row that must end on an untested size before the limit is lowered.
const CONFIRMATIONS_UNKNOWN: u32 = 2;
/// The same number for a size that was once accepted.
const CONFIRMATIONS_KNOWN: u32 = 4;
/// Number of further connections that must end on a message that cannot be split before the work is hopeless.
const HOPELESS: u32 = 3;
/// Time after which twice the size is tried; it doubles whenever that is too much.
const FIRST_PAUSE: Duration = Duration::from_secs(60);
const LONGEST_PAUSE: Duration = Duration::from_secs(3600);

/// Knowledge of the limit for one kind of size.
#[derive(Debug, Default)]
pub(crate) struct Limit {
    /// Largest accepted size.
    largest_accepted: usize,
    /// Number of connections in a row that ended on a size not accepted since, and the smallest such size.
    ends: u32,
    ended_on: usize,
    learnt: Option<Learnt>,
}

#[derive(Debug)]
struct Learnt {
    /// Smallest size on which connections ended repeatedly.
    broke: usize,
    advice: usize,
    grow_at: Instant,
    pause: Duration,
    /// Whether larger sizes have been tried since without reaching the limit.
    growing: bool,
    /// Number of connections that ended on a message that cannot be split.
    in_vain: u32,
}

impl Limit {
    /// Records that a size was accepted.
    pub fn took(&mut self, size: usize) {
        self.largest_accepted = self.largest_accepted.max(size);
        if size >= self.ended_on {
            self.ends = 0;
        }
        if self
            .learnt
            .as_ref()
            .is_some_and(|learnt| size >= learnt.broke)
        {
            self.learnt = None;
        }
    }

    /// Records that a connection ended while `size` was unacknowledged; `whole`: the message cannot be split. Returns
    /// whether the advice has changed.
    pub fn on_connection_end(&mut self, size: usize, whole: bool, now: Instant) -> bool {
        if self.ends == 0 {
            self.ended_on = size;
        }
        self.ends += 1;
        self.ended_on = self.ended_on.min(size);
        let patience = match &self.learnt {
            _ if size <= self.largest_accepted => CONFIRMATIONS_KNOWN,
            Some(_) => 1,
            None => CONFIRMATIONS_UNKNOWN,
        };
        if self.ends < patience {
            return false;
        }
        let size = std::mem::take(&mut self.ended_on);
        self.ends = 0;
        if size <= self.largest_accepted {
            self.largest_accepted = 0;
        }
        self.learn(size, whole, now);
        true
    }

    fn learn(&mut self, size: usize, whole: bool, now: Instant) {
        let before = self.learnt.take();
        let (mut pause, mut in_vain, mut broke) = (FIRST_PAUSE, 0, size);
        if let Some(before) = before {
            broke = broke.min(before.broke);
            in_vain = if whole { before.in_vain + 1 } else { 0 };
            pause = before.pause;
            if before.growing {
                pause = (pause * 2).min(LONGEST_PAUSE);
            }
        }
        // Use the largest accepted size if it is more than half of the rejected one; otherwise try the half.
        let advice = (broke / 2)
            .max(self.largest_accepted.min(broke.saturating_sub(1)))
            .max(1);
        self.learnt = Some(Learnt {
            broke,
            advice,
            grow_at: now + pause,
            pause,
            growing: false,
            in_vain,
        });
    }

    /// Raises the advice when its pause is over.
    pub fn tick(&mut self, now: Instant) {
        if let Some(learnt) = self.learnt.as_mut().filter(|learnt| learnt.grow_at <= now) {
            learnt.advice = learnt.advice.saturating_mul(2);
            learnt.grow_at = now + learnt.pause;
            learnt.growing = true;
        }
    }

    /// Returns the size to stay within if possible; `None` for no limit.
    pub fn advice(&self) -> Option<usize> {
        self.learnt.as_ref().map(|learnt| learnt.advice)
    }

    /// Returns the smallest size on which connections ended repeatedly, if any.
    pub fn broke(&self) -> Option<usize> {
        self.learnt.as_ref().map(|learnt| learnt.broke)
    }

    /// Returns the largest accepted size; 0 if there is none.
    pub fn largest_accepted(&self) -> usize {
        self.largest_accepted
    }

    /// Returns whether the advice is stable: more than half of it has been accepted.
    pub fn is_settled(&self) -> bool {
        self.advice()
            .is_some_and(|advice| advice / 2 < self.largest_accepted)
    }

    /// Returns whether connections end repeatedly on a message that cannot be split.
    pub fn is_hopeless(&self) -> bool {
        self.learnt
            .as_ref()
            .is_some_and(|learnt| learnt.in_vain >= HOPELESS)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Simulates a broker that accepts sizes up to `most`, to which one message a second is sent, as large as the
    /// advice allows up to `wanted`. Returns how many connections ended in this many seconds.
    fn losses(
        limit: &mut Limit,
        most: usize,
        wanted: usize,
        seconds: u64,
        start: Instant,
    ) -> usize {
        let mut losses = 0;
        for second in 0..seconds {
            let now = start + Duration::from_secs(second);
            limit.tick(now);
            let size = limit.advice().unwrap_or(usize::MAX).min(wanted);
            if size > most {
                limit.on_connection_end(size, false, now);
                losses += 1;
            } else {
                limit.took(size);
            }
        }
        losses
    }

    #[test]
    fn sizes_are_halved_until_they_go_through_and_grow_again_ever_more_rarely() {
        let (start, mut limit) = (Instant::now(), Limit::default());
        // Ends at 100,000 twice, 50,000, and 25,000.
        assert_eq!(losses(&mut limit, 20_000, 100_000, 20, start), 4);
        assert_eq!(
            (limit.advice(), limit.broke()),
            (Some(12_500), Some(25_000))
        );
        assert_eq!(limit.largest_accepted(), 12_500);
        assert!(limit.is_settled());
        // Twice the size is tried after 1, 2, 4, ... minutes.
        assert_eq!(losses(&mut limit, 20_000, 100_000, 3600, start), 5);
        assert_eq!(limit.advice(), Some(12_500));
    }

    #[test]
    fn a_limit_that_was_lifted_is_forgotten() {
        let (start, mut limit) = (Instant::now(), Limit::default());
        losses(&mut limit, 20_000, 100_000, 20, start);
        assert_eq!(losses(&mut limit, usize::MAX, 100_000, 100, start), 0);
        assert_eq!(limit.advice(), None);
        assert_eq!(limit.largest_accepted(), 100_000);
    }

    #[test]
    fn a_connection_that_ends_once_teaches_nothing() {
        let (start, mut limit) = (Instant::now(), Limit::default());
        for _ in 0..10 {
            assert!(!limit.on_connection_end(9000, false, start));
            limit.took(9000);
        }
        assert_eq!(limit.advice(), None);
        // A smaller size was accepted, which proves nothing about larger ones.
        assert!(!limit.on_connection_end(12_000, false, start));
        limit.took(10_000);
        assert!(limit.on_connection_end(11_000, false, start));
        assert_eq!(
            (limit.advice(), limit.broke()),
            (Some(10_000), Some(11_000))
        );
    }

    #[test]
    fn what_once_went_through_needs_more_to_be_doubted() {
        let (start, mut limit) = (Instant::now(), Limit::default());
        limit.took(9000);
        for _ in 0..3 {
            assert!(!limit.on_connection_end(8000, false, start));
        }
        assert!(limit.on_connection_end(8000, false, start));
        assert_eq!((limit.advice(), limit.largest_accepted()), (Some(4000), 0));
    }

    #[test]
    fn what_cannot_be_smaller_is_hopeless_after_some_times() {
        let (start, mut limit) = (Instant::now(), Limit::default());
        limit.took(15_000);
        for ends in 1..=4 {
            limit.on_connection_end(81_000, true, start);
            assert!(!limit.is_hopeless(), "{ends}");
        }
        assert!(limit.on_connection_end(81_000, true, start));
        assert!(limit.is_hopeless());
        assert_eq!(
            (limit.broke(), limit.largest_accepted()),
            (Some(81_000), 15_000)
        );
        // A size that is accepted in the end was not hopeless.
        limit.took(81_000);
        assert!(!limit.is_hopeless());
    }

    #[test]
    fn what_can_be_smaller_is_never_hopeless() {
        let (start, mut limit) = (Instant::now(), Limit::default());
        for _ in 0..100 {
            limit.on_connection_end(81_000, false, start);
        }
        assert!(!limit.is_hopeless());
    }
}
