//! Detection of servers whose answers are delayed because the broker holds small packets back.
//!
//! If Nagle's algorithm is on in the broker, it holds the second of two small packets back until the first has been
//! acknowledged, and operating systems delay acknowledgements when they have nothing to send. A server waits for the
//! messages of several agents, so each of its steps takes as long as the acknowledgement. Simulations whose steps
//! really take that long look the same, so the broker is probed before the user is warned.

use std::fmt;
use std::ops::RangeInclusive;
use std::time::Duration;

/// Delays of acknowledgements in milliseconds: Linux (measured: 42 to 48); twice that, or macOS; Windows.
const LATE: [RangeInclusive<u128>; 3] = [38..=52, 76..=110, 195..=220];
/// Answers within this time of the previous one belong to the same group.
const SOON: Duration = Duration::from_millis(5);
/// Smallest number of messages sent together for a delay to count: a single message is never held back.
const TOGETHER: u32 = 2;
/// Number of delayed answers that raises suspicion, and their smallest share of the time.
const ENOUGH: u32 = 20;
const MOST: f64 = 0.5;

/// Timing of the answers of one server in stepwise mode.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct Answers {
    /// Number of messages sent to the server since it was last waited for.
    together: u32,
    late: u32,
    late_seconds: f64,
    seconds: f64,
}

impl Answers {
    /// Records that messages were sent.
    pub fn on_sent(&mut self, messages: u32) {
        self.together = self.together.saturating_add(messages);
    }

    /// Records an answer after a wait of this length.
    pub fn on_answer(&mut self, wait: Duration) {
        self.seconds += wait.as_secs_f64();
        if wait < SOON {
            return;
        }
        let together = std::mem::take(&mut self.together) >= TOGETHER;
        let milliseconds = wait.as_millis();
        if together && LATE.iter().any(|late| late.contains(&milliseconds)) {
            self.late += 1;
            self.late_seconds += wait.as_secs_f64();
        }
    }

    fn share(&self) -> f64 {
        self.late_seconds / self.seconds.max(1e-9)
    }

    /// Returns whether the broker seems to hold messages to the server back.
    fn are_late(&self) -> bool {
        self.late >= ENOUGH && self.share() >= MOST
    }
}

/// A server whose answers seem to be delayed.
#[derive(Debug, Clone, Copy)]
struct Suspect {
    server: u64,
    answers: Answers,
}

impl fmt::Display for Suspect {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { server, answers } = self;
        write!(
            formatter,
            "{} answers of server {server} took {:.0} ms each, {:.0} % of the time of its evaluations",
            answers.late,
            answers.late_seconds / f64::from(answers.late.max(1)) * 1e3,
            answers.share() * 1e2,
        )
    }
}

/// Advice to the user.
const REMEDY: &str = "have the broker send small packets at once (Mosquitto: `set_tcp_nodelay true`; others: \
     docs/how-to/external-broker.md)";

/// The first server whose answers seem to be delayed; the broker is then probed once.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct Lag(Option<Suspect>);

impl Lag {
    /// Returns whether a server is the first one whose answers seem to be delayed.
    pub fn is_news(&mut self, server: u64, answers: Answers) -> bool {
        let news = self.0.is_none() && answers.are_late();
        if news {
            self.0 = Some(Suspect { server, answers });
        }
        news
    }

    /// Describes the delay for the user after the broker at `address` was probed. `answer`: whether it holds small
    /// packets back, or why the probe failed.
    pub fn describe(&self, answer: Result<bool, String>, address: &str) -> Option<String> {
        let suspect = self.0?;
        match answer {
            Ok(false) => None,
            Ok(true) => Some(format!(
                "evaluation is slow: the broker at {address} holds small packets back until earlier ones are acknowledged \
                 (Nagle's algorithm), and {suspect}, unless its simulation needs that long for a step; {REMEDY}, or the server \
                 acknowledge at once (TCP_QUICKACK)"
            )),
            Err(reason) => Some(format!(
                "evaluation is slow: {suspect}, as happens where a broker holds small packets back (Nagle's algorithm) or the \
                 simulation needs that long for a step; whether the broker at {address} does could not be determined: {reason}; \
                 if so, {REMEDY}"
            )),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Returns whether a server with `agents` agents and steps of these durations in milliseconds is suspicious.
    fn suspicious(agents: u32, steps: impl IntoIterator<Item = f64>) -> bool {
        let mut answers = Answers::default();
        answers.on_sent(2);
        for milliseconds in steps {
            answers.on_answer(Duration::from_secs_f64(milliseconds / 1e3));
            answers.on_sent(1);
            for _ in 1..agents {
                answers.on_answer(Duration::from_micros(80));
                answers.on_sent(1);
            }
        }
        answers.are_late()
    }

    #[test]
    fn steps_that_wait_for_acknowledgements_are_suspicious() {
        // As measured with Mosquitto on Linux; some steps are quick because their packets happened to travel together.
        let measured = [44.1, 44.0, 48.2, 43.9, 0.4, 88.3, 44.0, 47.6, 0.3, 42.5];
        assert!(suspicious(3, measured.into_iter().cycle().take(40)));
        assert!(!suspicious(3, measured), "too few");
        assert!(suspicious(2, [100.4; 30]), "macOS");
    }

    #[test]
    fn other_steps_are_not() {
        assert!(!suspicious(3, [0.3; 10_000]), "fast");
        assert!(!suspicious(3, [20.0; 1000]), "slow");
        assert!(!suspicious(3, [65.0; 1000]), "slow");
        assert!(
            !suspicious(1, [44.0; 1000]),
            "one agent's message waits for nothing"
        );
        let mixed = (0..1000).map(|step| f64::from(step % 10) * 14.0);
        assert!(!suspicious(3, mixed), "jitter");
        let rarely = (0..1000).map(|step| if step % 10 == 0 { 44.0 } else { 60.0 });
        assert!(!suspicious(3, rarely), "most of the time goes elsewhere");
    }
}
