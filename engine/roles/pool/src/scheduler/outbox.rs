//! Pending actions, and rules for how often a warning is shown.

use std::collections::{BTreeMap, HashMap, HashSet};

use crate::journal::FailedEvaluation;
use swarmwright_protocol::{MOST_REASON, MOST_STACK, Topic, shortened};

/// Largest number of different warnings that are remembered to suppress repetitions.
const MOST_REMEMBERED: usize = 1000;
/// Largest number of different warnings issued per group.
const MOST_IN_GROUP: usize = 3;
/// Text under which further warnings are counted once `MOST_REMEMBERED` is reached.
const OTHERS: &str = "an evaluation failed for yet another reason";

/// An action that the scheduler requests.
#[derive(Debug, Clone, PartialEq)]
pub enum Action {
    /// Publish with QoS 0.
    Publish(Topic, Vec<u8>),
    /// Publish a control message on a server's own topic with QoS 0.
    Control {
        /// Id of the server.
        server: u64,
        /// Payload of the message.
        payload: Vec<u8>,
    },
    /// Publish on a server's own topic with QoS 0.
    Request {
        /// Id of the server.
        server: u64,
        /// Number of the request, sent as correlation data.
        request: u64,
        /// Payload of the request.
        payload: Vec<u8>,
    },
    /// Warn the user.
    Warn(String),
    /// Warn the user that results of a server are accepted without audits.
    Unaudited(String),
    /// Record that an evaluation has failed permanently.
    Failed {
        /// The evaluation.
        evaluation: FailedEvaluation,
        /// Reason, for users.
        text: String,
        /// Whether to tell the user now: it is the first failure with this text.
        first: bool,
    },
    /// Ask the supervisor of a server that has not answered in time to check its process.
    Overdue(u64),
    /// Find out whether the broker holds small packets back, and report it with [`Scheduler::broker_holds_back`].
    AskBroker,
}

/// Pending actions, and the warnings issued so far.
#[derive(Debug, Default)]
pub(crate) struct Outbox {
    actions: Vec<Action>,
    /// Warnings that are not issued again.
    once: HashSet<String>,
    /// For each group, the number of warnings issued and the last one.
    groups: HashMap<String, (usize, String)>,
    /// Warnings that were issued, with the number of repetitions not yet reported.
    repeated: BTreeMap<String, u64>,
    /// Reasons why episodes failed in simulations, and whether a stack trace was reported for each.
    failures: HashMap<String, bool>,
}

impl Outbox {
    /// Drains the pending actions.
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

    /// Issues a warning only once, however often its cause recurs.
    pub fn warn_once(&mut self, text: String) {
        if self.once.len() < MOST_REMEMBERED && self.once.insert(text.clone()) {
            self.warn(text);
        }
    }

    /// Warns, only once, that results are accepted without audits.
    pub fn warn_unaudited(&mut self, text: String) {
        let about = "results that count without audits".to_owned();
        if self.once.len() < MOST_REMEMBERED && self.once.insert(about) {
            self.push(Action::Unaudited(text));
        }
    }

    /// Issues only the first warning about `about`.
    pub fn warn_first(&mut self, about: String, text: String) {
        if self.once.len() < MOST_REMEMBERED && self.once.insert(about) {
            self.warn(text);
        }
    }

    /// Issues the first few warnings of a group; further ones are counted as repetitions of the last of them.
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

    /// Returns the number of different warnings issued [once](Self::warn_once).
    pub fn warned_once(&self) -> usize {
        self.once.len()
    }

    /// Issues a warning once and counts its repetitions.
    pub fn warn_counted(&mut self, text: String) {
        if self.is_first(&text) {
            self.warn(text);
        }
    }

    /// Records that an evaluation has failed permanently. The user is told as by [`warn_counted`](Self::warn_counted).
    pub fn evaluation_failed(&mut self, evaluation: FailedEvaluation, text: String) {
        let first = self.is_first(&text);
        self.push(Action::Failed {
            evaluation,
            text,
            first,
        });
    }

    /// Returns whether a warning is issued now; if not, it is counted.
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

    /// Returns the repetitions since the last call, one line per warning.
    pub fn take_repeated(&mut self) -> Vec<String> {
        let counted = self.repeated.iter_mut().filter(|(_, more)| **more > 0);
        counted
            .map(|(text, more)| match std::mem::take(more) {
                1 => format!("1 more warning of the same kind: {text}"),
                count => format!("{count} more warnings of the same kind: {text}"),
            })
            .collect()
    }

    /// Warns once per reason that an episode failed in the simulation's code. Returns the shortened reason and, once
    /// per reason, the shortened stack.
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

    /// Returns the shortened stack if none was reported for this reason before.
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
