//! How large something may be that the broker takes, learnt from what went through and from connections that ended.
//!
//! It is advice: it grows again after a while, since a connection may have ended for another reason, and brokers are
//! configured anew.

use std::time::{Duration, Instant};

/// How often in a row a connection must end on something of a size of which it is not known that it goes through, ...
const CONFIRMATIONS_UNKNOWN: u32 = 2;
/// ... and of a size that once went through.
const CONFIRMATIONS_KNOWN: u32 = 4;
/// How often more it must end on what cannot be made smaller before that is hopeless.
const HOPELESS: u32 = 3;
/// After what time twice as much is tried; the time doubles whenever that is too much.
const FIRST_PAUSE: Duration = Duration::from_secs(60);
const LONGEST_PAUSE: Duration = Duration::from_secs(3600);

/// What is known of one kind of size.
#[derive(Debug, Default)]
pub(crate) struct Limit {
    /// The largest that went through.
    largest_accepted: usize,
    /// Number of consecutive connections that ended on a packet size that was never accepted since, and the smallest such size.
    ends: u32,
    ended_on: usize,
    learnt: Option<Learnt>,
}

#[derive(Debug)]
struct Learnt {
    /// The smallest size on which connections ended again and again.
    broke: usize,
    advice: usize,
    grow_at: Instant,
    pause: Duration,
    /// Whether larger sizes were tried since, without reaching the limit.
    growing: bool,
    /// How often a connection ended although nothing could be smaller.
    in_vain: u32,
}

impl Limit {
    /// So much went through.
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

    /// A connection ended when so much had been sent and was not known to have gone through; `whole`: it cannot be sent
    /// in smaller parts. Whether the advice is another one now.
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
        // What went through is larger than half of what did not, or the half is tried.
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

    /// Time has passed: more is tried.
    pub fn tick(&mut self, now: Instant) {
        if let Some(learnt) = self.learnt.as_mut().filter(|learnt| learnt.grow_at <= now) {
            learnt.advice = learnt.advice.saturating_mul(2);
            learnt.grow_at = now + learnt.pause;
            learnt.growing = true;
        }
    }

    /// What is not to be exceeded where that can be avoided; none for no limit.
    pub fn advice(&self) -> Option<usize> {
        self.learnt.as_ref().map(|learnt| learnt.advice)
    }

    /// The smallest size on which connections ended again and again, if there is one.
    pub fn broke(&self) -> Option<usize> {
        self.learnt.as_ref().map(|learnt| learnt.broke)
    }

    /// The largest size that went through; 0 for none.
    pub fn largest_accepted(&self) -> usize {
        self.largest_accepted
    }

    /// Whether about as much as is advised has gone through: the advice stands for a while.
    pub fn is_settled(&self) -> bool {
        self.advice()
            .is_some_and(|advice| advice / 2 < self.largest_accepted)
    }

    /// Whether connections end again and again on what cannot be made smaller.
    pub fn is_hopeless(&self) -> bool {
        self.learnt
            .as_ref()
            .is_some_and(|learnt| learnt.in_vain >= HOPELESS)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A broker that takes `most`, to which as much is sent as the advice allows of `wanted`: how often connections ended
    /// in so many seconds, a message each.
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
        // 100,000 twice, 50,000, 25,000.
        assert_eq!(losses(&mut limit, 20_000, 100_000, 20, start), 4);
        assert_eq!(
            (limit.advice(), limit.broke()),
            (Some(12_500), Some(25_000))
        );
        assert_eq!(limit.largest_accepted(), 12_500);
        assert!(limit.is_settled());
        // After one, two, four .. minutes, twice the size is tried.
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
        // Less went through, which says nothing of more.
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
        // What goes through in the end was not hopeless.
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
