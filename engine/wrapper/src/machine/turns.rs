//! Turns: several optimization tools that want one server have it one after another.
//!
//! A tool that asks for a server while another one has it is remembered. Between two episodes, batches or requests of a
//! tool whose turn is over, the server goes to the one that has waited longest.

use std::collections::VecDeque;
use std::time::{Duration, Instant};

use swarmwright_protocol::{Refusal, RefusalKind};

use super::{Machine, PATIENCE, State};

/// How long a tool has a server for itself before another one gets it.
const TURN: Duration = Duration::from_secs(5);
/// For how long a question is still good: tools ask every two seconds.
const ASKED: Duration = Duration::from_secs(3);
/// How long a server waits for the tool whose turn it is.
const RESERVED: Duration = Duration::from_secs(3);
/// Tools that are remembered.
const MOST: usize = 256;

/// Whose turn it is, and who waits.
#[derive(Debug, Default)]
pub(super) struct Turns {
    holder: Option<String>,
    since: Option<Instant>,
    /// The holder has not begun yet: waiting for it is no part of its turn.
    reserved: bool,
    /// Tools that asked, the one that has waited longest first, with the time of their last question.
    waiting: VecDeque<(String, Instant)>,
}

impl Turns {
    /// A tool asked in vain.
    pub fn ask(&mut self, tool: &str, now: Instant) {
        if let Some((_, asked)) = self.waiting.iter_mut().find(|(known, _)| known == tool) {
            *asked = now;
        } else if self.waiting.len() < MOST {
            self.waiting.push_back((tool.to_owned(), now));
        }
    }

    /// Who has the server from now on, and whether something is being computed.
    pub fn held_by(&mut self, holder: Option<String>, active: bool, now: Instant) {
        if self.holder != holder || (active && self.reserved) {
            self.since = Some(now);
            self.reserved = !active;
            if let Some(holder) = &holder {
                self.waiting.retain(|(tool, _)| tool != holder);
            }
            self.holder = holder;
        }
    }

    fn is_over(&self, now: Instant) -> bool {
        self.since
            .is_some_and(|since| now.saturating_duration_since(since) >= TURN)
    }

    /// Who is to have the server next, once the turn is over.
    fn next(&mut self, now: Instant) -> Option<String> {
        self.waiting
            .retain(|(_, asked)| now.saturating_duration_since(*asked) < ASKED);
        if !self.is_over(now) {
            return None;
        }
        self.waiting.pop_front().map(|(tool, _)| tool)
    }
}

impl Machine {
    /// A run is over: its tool, if it gave its name, keeps the server for the next one, unless it is another one's turn.
    pub(super) fn leave(&mut self, now: Instant) {
        if let Some(next) = self.turns.next(now) {
            return self.hand_over(next, now);
        }
        let state = match self.holder() {
            Some(tool) => State::Held {
                tool,
                until: now + PATIENCE,
            },
            None => State::Free,
        };
        self.enter(state, now);
    }

    /// The server waits for a tool, which hears of it at once.
    pub(super) fn hand_over(&mut self, tool: String, now: Instant) {
        let until = now + RESERVED;
        self.enter(State::Held { tool, until }, now);
        self.tell_at_once(now);
    }

    /// Answers the requests that wait when it is another tool's turn. Whether it is.
    pub(super) fn turn_ends(&mut self, now: Instant) -> bool {
        let Some(next) = self.turns.next(now) else {
            return false;
        };
        if let State::Working(work) = &mut self.state {
            for request in work.drain() {
                let refusal = Refusal {
                    kind: RefusalKind::Taken,
                    reason: format!("it is the turn of {next}"),
                };
                self.send_result(request.number, request.reply, &[], Err(refusal), 0.0);
            }
        }
        self.hand_over(next, now);
        true
    }
}
