//! Timers of a server.

use std::time::{Duration, Instant};

use super::rival::Listening;
use super::{Machine, SETTLE, State};

/// How long actuators may be missing before a warning is issued.
const TELL_AFTER: Duration = Duration::from_secs(5);

impl Machine {
    /// Returns when to call `tick` next, if no message comes first.
    #[must_use]
    pub fn next_tick(&self) -> Option<Instant> {
        let own = match &self.state {
            State::Free | State::Working(_) => None,
            State::Stepping(batch) if batch.goes_on => Some(batch.waiting_since),
            State::Stepping(batch) => Some(self.deadline(batch.waiting_since, batch.told)),
            State::Configured { until } | State::Held { until, .. } => Some(*until),
            State::Running(run) => run
                .resume_at
                .or(Some(self.deadline(run.waiting_since, run.told))),
        };
        let settle = self
            .changed_at
            .filter(|_| !self.offline && self.listening.is_none())
            .map(|at| at + SETTLE);
        let listened = self.listening.as_ref().map(Listening::until);
        [
            own,
            settle,
            self.next_early(),
            listened,
            self.next_leaving(),
            self.complaints.due(),
            self.rivals.due(),
        ]
        .into_iter()
        .flatten()
        .min()
    }

    /// Restarts the waiting times of the turn that began at `turn`. Its messages were sent only `now`, and the other
    /// side could not react earlier, however long the simulation took.
    pub fn computed(&mut self, turn: Instant, now: Instant) {
        match &mut self.state {
            State::Running(run) if run.waiting_since == turn => run.waiting_since = now,
            State::Stepping(batch) if batch.waiting_since == turn && !batch.goes_on => {
                batch.waiting_since = now;
            }
            State::Held { until, .. } if self.entered_at == Some(turn) => {
                *until += now.saturating_duration_since(turn);
            }
            _ => {}
        }
    }

    /// Returns when to warn about missing actuators, or to give up the run.
    fn deadline(&self, waiting_since: Instant, warned: bool) -> Instant {
        let patience = if warned {
            self.step_timeout
        } else {
            self.step_timeout.min(TELL_AFTER)
        };
        waiting_since + patience
    }

    /// Handles everything that is due by `now`. `stamp` returns the current time in RFC 3339, for presence.
    pub fn tick(&mut self, now: Instant, stamp: impl FnOnce() -> String) {
        self.clock = Some(now);
        let left_out = [self.complaints.left_out(now), self.rivals.left_out(now)];
        left_out
            .into_iter()
            .flatten()
            .for_each(|text| self.warn(text));
        self.refuse_early(now);
        self.leave_to_rival(now);
        if self.has_listened(now) {
            self.publish_presence(stamp());
            return self.catch_up(now);
        }
        match &mut self.state {
            State::Configured { until } if *until <= now => {
                self.warn(
                    "parameters arrived without a control message to start the run; free again"
                        .to_owned(),
                );
                self.enter(State::Free, now);
            }
            State::Held { until, .. } if *until <= now => self.enter(State::Free, now),
            State::Running(run) if run.resume_at.is_some_and(|at| at <= now) => {
                run.resume_at = None;
                self.sense(now);
            }
            State::Running(run) if run.waited(now) >= self.step_timeout => {
                let words = run.waiting_for(now);
                let (reply, hash) = (run.reply.clone(), run.hash.clone());
                self.warn(format!(
                    "{words}; the run is given up, the server is free again"
                ));
                self.report(reply, hash, words.into(), false);
                self.enter(State::Free, now);
            }
            State::Stepping(batch) if batch.goes_on => self.sense_batch(now),
            State::Stepping(batch) => {
                let waited = now.saturating_duration_since(batch.waiting_since);
                let words = batch.waiting_for(now);
                if waited >= self.step_timeout {
                    self.give_up_batch(words, now);
                } else if !batch.told && waited >= TELL_AFTER {
                    batch.told = true;
                    self.warn(words);
                }
            }
            State::Running(run) if !run.told && run.waited(now) >= TELL_AFTER => {
                run.told = true;
                let words = run.waiting_for(now);
                self.warn(words);
            }
            _ => {}
        }
        let silent = self.offline || self.listening.is_some();
        if !silent && self.changed_at.is_some_and(|at| at + SETTLE <= now) {
            self.publish_presence(stamp());
        }
    }
}
