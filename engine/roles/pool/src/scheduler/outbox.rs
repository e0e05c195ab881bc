//! What is to be done next, and what the user is told.

use std::collections::{BTreeMap, HashMap, HashSet};

use crate::journal::FailedEvaluation;
use swarmwright_protocol::{MOST_REASON, MOST_STACK, Topic, shortened};

/// Different warnings that are remembered, so that each is made once.
const MOST_REMEMBERED: usize = 1000;
/// Different warnings of one group that are made.
const MOST_IN_GROUP: usize = 3;
/// What is counted where there are more kinds of warnings than that.
const OTHERS: &str = "an evaluation failed for yet another reason";

/// What the scheduler wants done.
#[derive(Debug, Clone, PartialEq)]
pub enum Action {
    /// Publish with QoS 0.
    Publish(Topic, Vec<u8>),
    /// Publish a control message on a server's own topic with QoS 0.
    Control {
        /// The server.
        server: u64,
        /// The message.
        payload: Vec<u8>,
    },
    /// Publish on a server's own topic with QoS 0.
    Request {
        /// The server.
        server: u64,
        /// The request's number: the correlation data.
        request: u64,
        /// Payload of the question.
        payload: Vec<u8>,
    },
    /// Tell the user.
    Warn(String),
    /// Tell the user, once for each server, that its results count without audits.
    Unaudited(String),
    /// Note that an evaluation has failed for good.
    Failed {
        /// Which one.
        evaluation: FailedEvaluation,
        /// Why, for people.
        text: String,
        /// Whether the user is to be told now: others have not failed for the same reason before.
        first: bool,
    },
    /// A watched server has not answered in time: the supervisor of its process is to look at it.
    Overdue(u64),
    /// Find out whether the broker holds small packets back, and tell it by [`Scheduler::broker_holds_back`].
    AskBroker,
}

/// Actions that have not been carried out yet, and which warnings have been made.
#[derive(Debug, Default)]
pub(crate) struct Outbox {
    actions: Vec<Action>,
    /// Warnings that are not made again.
    once: HashSet<String>,
    /// Groups of warnings: how many were made of each, and the last one.
    groups: HashMap<String, (usize, String)>,
    /// Warnings that were made, and how often each was repeated since that was last told.
    repeated: BTreeMap<String, u64>,
    /// Reasons why episodes failed in simulations, and whether a stack trace was reported.
    failures: HashMap<String, bool>,
}

impl Outbox {
    /// What is to be done now; empties the list.
    pub fn drain(&mut self) -> std::vec::Drain<'_, Action> {
        self.actions.drain(..)
    }

    pub fn push(&mut self, action: Action) {
        self.actions.push(action);
    }

    pub fn publish(&mut self, topic: Topic, payload: Vec<u8>) {
        self.push(Action::Publish(topic, payload));
    }

    pub fn warn(&mut self, text: String) {
        self.push(Action::Warn(text));
    }

    /// A warning that is made only once, however often its cause comes back.
    pub fn warn_once(&mut self, text: String) {
        if self.once.len() < MOST_REMEMBERED && self.once.insert(text.clone()) {
            self.warn(text);
        }
    }

    /// A warning that results count without audits, made only once.
    pub fn warn_unaudited(&mut self, text: String) {
        let about = "results that count without audits".to_owned();
        if self.once.len() < MOST_REMEMBERED && self.once.insert(about) {
            self.push(Action::Unaudited(text));
        }
    }

    /// A warning of which the first one about something is made, and no other.
    pub fn warn_first(&mut self, about: String, text: String) {
        if self.once.len() < MOST_REMEMBERED && self.once.insert(about) {
            self.warn(text);
        }
    }

    /// A warning about what may be wrong in many ways: the first few are made, the others are counted with the last of them.
    pub fn warn_grouped(&mut self, group: String, text: String) {
        if self.once.contains(&text) || self.once.len() >= MOST_REMEMBERED {
            return;
        }
        let group = self.groups.entry(group).or_default();
        if group.0 < MOST_IN_GROUP {
            *group = (group.0 + 1, text.clone());
            return self.warn_once(text);
        }
        *self.repeated.entry(group.1.clone()).or_default() += 1;
    }

    /// Number of different warnings issued [once](Self::warn_once).
    pub fn warned_once(&self) -> usize {
        self.once.len()
    }

    /// A warning that may be repeated many times: it is made once, and then counted.
    pub fn warn_counted(&mut self, text: String) {
        if self.is_first(&text) {
            self.warn(text);
        }
    }

    /// An evaluation has failed for good. The user is told as by [`warn_counted`](Self::warn_counted).
    pub fn evaluation_failed(&mut self, evaluation: FailedEvaluation, text: String) {
        let first = self.is_first(&text);
        self.push(Action::Failed {
            evaluation,
            text,
            first,
        });
    }

    /// Whether a warning that may be repeated is to be made now; else it is counted.
    fn is_first(&mut self, text: &str) -> bool {
        if let Some(more) = self.repeated.get_mut(text) {
            *more += 1;
            false
        } else if self.repeated.len() < MOST_REMEMBERED {
            self.repeated.insert(text.to_owned(), 0);
            true
        } else {
            *self.repeated.entry(OTHERS.to_owned()).or_default() += 1;
            false
        }
    }

    /// How often warnings were repeated since the last call, a line for each.
    pub fn take_repeated(&mut self) -> Vec<String> {
        let counted = self.repeated.iter_mut().filter(|(_, more)| **more > 0);
        counted
            .map(|(text, more)| match std::mem::take(more) {
                1 => format!("1 more warning of the same kind: {text}"),
                count => format!("{count} more warnings of the same kind: {text}"),
            })
            .collect()
    }

    /// An episode failed in the simulation's code: tells the user once for each reason. Returns the reason and, once,
    /// the stack, of a length that can be kept.
    pub fn episode_failed(
        &mut self,
        server: u64,
        reason: String,
        stack: Option<String>,
    ) -> (String, Option<String>) {
        let reason = shortened(reason, MOST_REASON);
        if !self.failures.contains_key(&reason) {
            if self.failures.len() >= MOST_REMEMBERED {
                return (reason, None);
            }
            self.warn(format!("an episode failed on server {server}: {reason}"));
        }
        let stack = self.stack_once(&reason, stack);
        (reason, stack)
    }

    /// The stack, of a length that can be kept, where none was told for this reason before.
    pub fn stack_once(&mut self, reason: &str, stack: Option<String>) -> Option<String> {
        if !self.failures.contains_key(reason) && self.failures.len() >= MOST_REMEMBERED {
            return None;
        }
        let has_stack = self.failures.entry(reason.to_owned()).or_default();
        let stack = stack.filter(|_| !*has_stack);
        *has_stack |= stack.is_some();
        stack.map(|stack| shortened(stack, MOST_STACK))
    }
}
