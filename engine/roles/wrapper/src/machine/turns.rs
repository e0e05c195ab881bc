//! Turns: optimization tools that want the same server get it one after another.
//!
//! A tool that asks for a server while another one has it is remembered. Between two episodes, batches or requests of a
//! tool whose turn is over, the server goes to the tool that has waited longest. Tools that implement only D6.1 have no
//! name and count as one tool, which gets its turn like the others. Since such a tool may ask only once, its discovery
//! stays valid for longer, and is answered when its turn comes.

use std::collections::VecDeque;
use std::time::{Duration, Instant};

use swarmwright_protocol::{Discovery, Refusal, RefusalKind};

use super::{Machine, PATIENCE, State, name};

/// How long a tool has a server before another one gets it.
const TURN: Duration = Duration::from_secs(5);
/// How long a discovery stays valid; tools with a name repeat it every two seconds.
const ASKED: Duration = Duration::from_secs(3);
/// How long the discovery of a tool without a name stays valid.
const ASKED_ONCE: Duration = Duration::from_secs(30);
/// How long a server waits for the tool whose turn it is.
const RESERVED: Duration = Duration::from_secs(3);
/// How long it waits for a tool without a name, at first and between two of its episodes.
const RESERVED_NAMELESS: Duration = Duration::from_secs(1);
/// Largest number of remembered tools.
const MOST: usize = 256;

/// Name of a tool; tools without one cannot be told apart.
pub(super) type Tool = Option<String>;

/// An unanswered discovery of a tool.
#[derive(Debug)]
pub(super) struct Question {
    /// When the tool last asked.
    asked: Instant,
    discovery: Discovery,
}

impl Question {
    fn is_good(&self, now: Instant) -> bool {
        let age = now.saturating_duration_since(self.asked);
        let nameless = self.discovery.tool.is_none();
        age < if nameless { ASKED_ONCE } else { ASKED }
    }
}

/// The tool whose turn it is, and the waiting tools.
#[derive(Debug, Default)]
pub(super) struct Turns {
    holder: Option<Tool>,
    since: Option<Instant>,
    /// Whether the holder has not begun yet; waiting for it does not count as its turn.
    reserved: bool,
    /// Waiting tools, the one that has waited longest first.
    waiting: VecDeque<Question>,
    /// Hash of the discovery of a tool without a name that was answered when its turn came.
    invited: Option<String>,
}

impl Turns {
    /// Remembers a tool that asked in vain.
    pub fn ask(&mut self, discovery: &Discovery, now: Instant) {
        let question = Question {
            asked: now,
            discovery: discovery.clone(),
        };
        let mut waiting = self.waiting.iter_mut();
        if let Some(earlier) = waiting.find(|earlier| earlier.discovery.tool == discovery.tool) {
            *earlier = question;
        } else if self.waiting.len() < MOST {
            self.waiting.push_back(question);
        }
    }

    /// Sets the holder of the server, if any, and whether it is computing.
    pub fn held_by(&mut self, holder: Option<Tool>, active: bool, now: Instant) {
        if self.holder != holder || (active && self.reserved) {
            self.since = Some(now);
            self.reserved = !active;
            if let Some(tool) = &holder {
                self.has_asked_enough(tool);
            }
            if holder != Some(None) {
                self.invited = None;
            }
            self.holder = holder;
        }
    }

    /// Removes a tool that has been answered.
    pub fn has_asked_enough(&mut self, tool: &Tool) {
        self.waiting
            .retain(|question| question.discovery.tool != *tool);
    }

    fn is_over(&self, now: Instant) -> bool {
        self.since
            .is_some_and(|since| now.saturating_duration_since(since) >= TURN)
    }

    /// Takes the tool that gets the server next, once the turn is over.
    fn next(&mut self, now: Instant) -> Option<Discovery> {
        self.waiting.retain(|question| question.is_good(now));
        if !self.is_over(now) {
            return None;
        }
        self.waiting.pop_front().map(|question| question.discovery)
    }
}

impl Machine {
    /// Returns the holder of the server; `None` if there is none, or it is not known yet.
    pub(super) fn occupant(&self) -> Option<Tool> {
        match &self.state {
            State::Free | State::Configured { .. } => None,
            State::Held { tool, .. } => Some(tool.clone()),
            State::Running(_) | State::Stepping(_) | State::Working(_) => Some(self.holder()),
        }
    }

    /// Ends a run. A tool that gave its name keeps the server for its next run, unless it is another tool's turn. A
    /// tool without a name keeps it until the end of its turn, provided it had to wait for that turn.
    pub(super) fn leave(&mut self, now: Instant) {
        self.stepped += usize::from(self.is_stepping());
        if let Some(next) = self.turns.next(now) {
            return self.hand_over(next, now);
        }
        let patience = match self.holder() {
            Some(_) => PATIENCE,
            None if self.turns.invited.is_some() && !self.turns.is_over(now) => RESERVED_NAMELESS,
            None => return self.enter(State::Free, now),
        };
        let (tool, until) = (self.holder(), now + patience);
        self.enter(State::Held { tool, until }, now);
    }

    /// Reserves the server for a tool and tells it at once: a tool with a name by presence, one without a name by an
    /// answer to its discovery.
    pub(super) fn hand_over(&mut self, next: Discovery, now: Instant) {
        let tool = next.tool.clone();
        let patience = match tool {
            Some(_) => RESERVED,
            None => RESERVED_NAMELESS,
        };
        let (nameless, until) = (tool.is_none(), now + patience);
        self.enter(State::Held { tool, until }, now);
        if nameless {
            self.turns.invited = Some(next.simulation_hash.clone());
            self.answer(next);
        }
        self.tell_at_once(now);
    }

    /// Handles a tool that configured another server. If this server is reserved for that tool without a name, it
    /// becomes free.
    pub(super) fn other_configured(&mut self, hash: &str, now: Instant) {
        let is_answered = |question: &Question| {
            question.discovery.tool.is_none() && question.discovery.simulation_hash == hash
        };
        self.turns.waiting.retain(|question| !is_answered(question));
        let waits = matches!(self.state, State::Held { tool: None, .. }) && self.turns.reserved;
        if waits && self.turns.invited.as_deref() == Some(hash) {
            self.enter(State::Free, now);
            self.tell_at_once(now);
        }
    }

    /// Refuses the waiting requests if it is another tool's turn. Returns whether it is.
    pub(super) fn turn_ends(&mut self, now: Instant) -> bool {
        let Some(next) = self.turns.next(now) else {
            return false;
        };
        if let State::Working(work) = &mut self.state {
            let name = name(next.tool.as_deref());
            for request in work.drain() {
                let refusal = Refusal {
                    kind: RefusalKind::Taken,
                    reason: format!("it is the turn of {name}"),
                };
                self.send_result(request.number, request.reply, &[], Err(refusal), 0.0);
            }
        }
        self.hand_over(next, now);
        true
    }
}
