//! The decisions of a server: messages and time as input, actions as output, no I/O (docs/reference/protocol.md).
//!
//! A server is free, configured (it has parameters and waits for control), running an episode, stepping a batch,
//! working on requests for offloaded evaluation, or held: between two episodes of a tool that gave its name, it stays
//! reserved for that tool for a moment. It answers discovery if it is free, or if it is held and its holder asks.

mod batched;
mod complaints;
mod early;
mod offer;
mod offloaded;
mod presence;
mod rival;
mod stepwise;
mod timers;
mod turns;

use std::collections::VecDeque;
use std::sync::Arc;
use std::time::{Duration, Instant};

use swarmwright_protocol::{
    Control, Discovery, Message, ParametersMessage, Refusal, RefusalKind, ServerMessage,
    State as PresenceState, ToServer, Topic, Topics,
};
use swarmwright_worlds::{Parameters, Simulation};

pub use crate::notice::{Action, Notice};

use crate::Identity;
use crate::batch::Batch;
use crate::job::Setup;
use crate::run::Run;
use complaints::Complaints;
use early::Early;
use offer::Offer;
use offloaded::Work;
use rival::{Leaving, Listening};
use turns::{Tool, Turns};

/// How long parameters without control, or a holder without a new episode, reserve the server.
const PATIENCE: Duration = Duration::from_secs(5);
/// How long a change of presence must last before it is published; runs of a few milliseconds are not.
const SETTLE: Duration = Duration::from_millis(150);
/// Largest number of parameters messages kept for their control; few of the tools on a broker ask at the same time.
const KEPT: usize = 8;
/// Number of recent runs whose hashes are remembered, so that none is started twice.
const BEGUN: usize = 64;

/// Largest number of episodes of a batch, if the simulation can be duplicated.
pub(crate) const MAX_BATCH: usize = 256;

enum State {
    Free,
    Configured { until: Instant },
    Running(Box<Run>),
    Stepping(Box<Batch>),
    Working(Work),
    Held { tool: Tool, until: Instant },
}

/// The state machine of one server.
pub struct Machine {
    identity: Identity,
    offers: Vec<Offer>,
    /// Topic of requests to this server.
    inbox: String,
    /// Setup of the last valid request for offloaded evaluation.
    setup: Option<Arc<Setup>>,
    topics: Topics,
    step_timeout: Duration,
    state: State,
    /// Start of the turn in which it entered this state.
    entered_at: Option<Instant>,
    /// Recent parameters by hash, the newest last.
    parameters: VecDeque<(String, Parameters)>,
    /// Control messages that wait for their parameters, the oldest first.
    early: VecDeque<Early>,
    /// Titles by the hash of the discovery that named them.
    discovered: VecDeque<(String, String)>,
    /// Hashes of recent runs of tools with a reply topic; such tools give every run its own hash.
    begun: VecDeque<String>,
    /// Hash and tool of the previous run, which a control{run: false} may still name.
    last: Option<(String, Option<String>)>,
    complaints: Complaints,
    /// Warnings about other servers with this id, counted separately so that other warnings do not suppress them.
    rivals: Complaints,
    /// Time of the current turn.
    clock: Option<Instant>,
    published: Option<(PresenceState, Option<String>)>,
    /// The last published presence, whether or not it is still known, and since when it has applied.
    since: Option<((PresenceState, Option<String>), String)>,
    changed_at: Option<Instant>,
    /// Whether the connection is broken, so that nothing can be published.
    offline: bool,
    /// Set after a reconnection, while another server may have this id.
    listening: Option<Listening>,
    /// Set if another server has this id, so that this one must leave.
    leaving: Option<Leaving>,
    /// Whether no other server can have this id.
    alone: bool,
    turns: Turns,
    /// Number of episodes and batches stepped to their end since the last call of `take_stepped`.
    stepped: usize,
    actions: Vec<Action>,
}

impl Machine {
    /// Creates a free server. `step_timeout`: how long a step may wait for actuators before the run is given up.
    #[must_use]
    pub fn new(
        identity: Identity,
        simulations: Vec<Box<dyn Simulation>>,
        topics: Topics,
        step_timeout: Duration,
    ) -> Self {
        Self {
            offers: simulations.into_iter().map(Offer::new).collect(),
            inbox: topics.to_server(identity.id),
            identity,
            setup: None,
            topics,
            step_timeout,
            state: State::Free,
            entered_at: None,
            parameters: VecDeque::new(),
            early: VecDeque::new(),
            discovered: VecDeque::new(),
            begun: VecDeque::new(),
            last: None,
            complaints: Complaints::default(),
            rivals: Complaints::default(),
            clock: None,
            published: None,
            since: None,
            changed_at: None,
            offline: false,
            listening: None,
            leaving: None,
            alone: false,
            turns: Turns::default(),
            stepped: 0,
            actions: Vec::new(),
        }
    }

    /// Drains the actions to take now.
    pub fn actions(&mut self) -> std::vec::Drain<'_, Action> {
        self.actions.drain(..)
    }

    /// Handles a message. Retained messages are outdated, except presence.
    pub fn receive(&mut self, topic: &str, payload: &[u8], retained: bool, now: Instant) {
        self.clock = Some(now);
        let name = topic;
        let Some(topic) = self.topics.parse(name) else {
            return;
        };
        if topic == Topic::ToServer && name != self.inbox {
            return;
        }
        if self.hears_later(topic, name, payload, retained) {
            return;
        }
        if topic == Topic::Presence && payload.is_empty() {
            // The presence of this server was cleared by a server that had its id, or by an operator.
            if name == self.topics.presence(self.identity.id) {
                self.published = None;
                self.changed_at.get_or_insert(now);
            }
            return;
        }
        if retained && topic != Topic::Presence {
            self.complain(format!(
                "ignoring a retained message on {}: no message to a server may be retained",
                topic.name()
            ));
            return;
        }
        if topic == Topic::Actuator && self.is_foreign(payload) {
            return;
        }
        match Message::decode(topic, payload) {
            Ok(Message::Discovery(discovery)) => self.discovery(discovery, now),
            Ok(Message::Parameters(message)) if message.server == self.identity.id => {
                self.configure(message, now)
            }
            Ok(Message::Parameters(message)) => {
                self.other_configured(&message.simulation_hash, now)
            }
            Ok(Message::Control(control)) if control.server == self.identity.id => {
                if self.is_meant(control.instance.as_ref()) {
                    self.control(control, now);
                } else {
                    self.turn_away_from_another(&control, now);
                }
            }
            Ok(Message::Actuator(actuator)) => self.actuate(&actuator, now),
            Ok(Message::ToServer(ToServer::Evaluate(message))) => self.evaluate(message, now),
            Ok(Message::ToServer(ToServer::Start(message))) => self.start_batch(message, now),
            Ok(Message::ToServer(ToServer::Actuators(message))) => self.step_batch(&message, now),
            Ok(Message::Presence(presence)) => self.other_presence(&presence, retained, now),
            Ok(_) => {}
            Err(error) => {
                if topic == Topic::ToServer {
                    self.refuse_unread(payload, &error);
                }
                self.complain(format!("refusing a message on {}: {error}", topic.name()));
            }
        }
    }

    fn discovery(&mut self, discovery: Discovery, now: Instant) {
        let offered = self
            .offers
            .iter()
            .find(|offer| offer.description.title == discovery.simulation);
        let Some(offer) = offered else {
            return;
        };
        let capabilities = self.capabilities(offer);
        if !capabilities.fulfil(&discovery.requirements) || !self.is_free_for(&discovery, now) {
            return;
        }
        if discovery.tool.is_none() {
            self.turns.has_asked_enough(&None);
        }
        self.answer(discovery);
    }

    fn answer(&mut self, discovery: Discovery) {
        let Discovery {
            simulation,
            simulation_hash,
            ..
        } = discovery;
        let offers = &self.offers;
        let Some(offer) = offers.iter().find(|o| o.description.title == simulation) else {
            return;
        };
        let answer = ServerMessage {
            server: self.identity.id,
            simulation_hash: simulation_hash.clone(),
            simulations: self.titles(),
            capabilities: self.capabilities(offer),
        };
        self.actions
            .push(Action::Publish(Topic::Server, answer.encode()));
        remember(&mut self.discovered, simulation_hash, simulation);
    }

    /// Returns whether a tool may have the server. If not, the tool is remembered and gets its turn later.
    fn is_free_for(&mut self, discovery: &Discovery, now: Instant) -> bool {
        match &self.state {
            State::Free => return true,
            State::Held { tool, .. } if discovery.tool == *tool => return true,
            _ => {}
        }
        if self.occupant().as_ref() != Some(&discovery.tool) {
            self.turns.ask(discovery, now);
        }
        false
    }

    fn configure(&mut self, message: ParametersMessage, now: Instant) {
        let hash = message.simulation_hash;
        remember(&mut self.parameters, hash.clone(), message.parameters);
        let patience = now + PATIENCE;
        match &mut self.state {
            State::Free | State::Configured { .. } => {
                self.enter(State::Configured { until: patience }, now);
            }
            // Parameters do not name their tool; presumably they come from the awaited tool.
            State::Held { tool: None, until } => *until = patience,
            _ => {}
        }
        self.start_early(&hash, now);
    }

    fn has_parameters(&self, hash: &str) -> bool {
        self.parameters.iter().any(|(other, _)| other == hash)
    }

    fn end(&mut self, control: &Control, now: Instant) {
        self.forget_early(&control.simulation_hash, &control.tool);
        let last = self
            .last
            .as_ref()
            .is_some_and(|(hash, tool)| (hash, tool) == (&control.simulation_hash, &control.tool));
        let ours = match &self.state {
            State::Running(run) => {
                (&run.hash, &run.tool) == (&control.simulation_hash, &control.tool)
            }
            State::Configured { .. } => self
                .parameters
                .back()
                .is_some_and(|(hash, _)| *hash == control.simulation_hash),
            State::Held { tool: None, .. } => {
                let configured = self.has_parameters(&control.simulation_hash);
                control.tool.is_none() && (last || configured)
            }
            State::Held { tool, .. } => control.tool == *tool,
            State::Stepping(batch) => control.tool.as_ref() == Some(&batch.tool),
            State::Working(work) => control.tool == work.holder(),
            State::Free => return,
        };
        if ours {
            let was_held = matches!(self.state, State::Held { .. });
            self.free(now);
            if was_held {
                self.tell_at_once(now);
            }
        } else {
            self.complain(format!(
                "ignoring the end of a run that is not under way, from {}",
                asker(control)
            ));
        }
    }

    /// Handles a broken connection: messages of the current run are lost, so the run is given up.
    pub fn disconnected(&mut self, reason: &str, now: Instant) {
        if let State::Running(_) | State::Stepping(_) | State::Working(_) = self.state {
            self.warn("the run under way is given up with the connection".to_owned());
        }
        self.actions
            .push(Action::Notice(Notice::Lost(reason.to_owned())));
        self.early.clear();
        self.free(now);
        self.published = None;
        self.offline = true;
        self.listening = None;
        self.leaving = None;
    }

    /// Gives up all current work; a computation is stopped as soon as possible.
    pub fn free(&mut self, now: Instant) {
        if let State::Working(work) = &mut self.state {
            work.release();
        } else {
            self.enter(State::Free, now);
        }
    }

    fn enter(&mut self, state: State, now: Instant) {
        let free = matches!(state, State::Free);
        self.entered_at = Some(now);
        match std::mem::replace(&mut self.state, state) {
            State::Running(run) => self.last = Some((run.hash, run.tool)),
            State::Stepping(batch) => self.take_back(*batch),
            _ => {}
        }
        if free {
            self.offers
                .iter_mut()
                .for_each(|offer| offer.spares.clear());
        }
        let active = !matches!(self.state, State::Held { .. } | State::Free);
        self.turns.held_by(self.occupant(), active, now);
        // If the change is reversed before it is published, no message is needed; both are compared when it is due.
        self.changed_at.get_or_insert(now);
    }

    /// Publishes a change of presence without waiting until it settles.
    fn tell_at_once(&mut self, now: Instant) {
        self.changed_at = Some(now.checked_sub(SETTLE).unwrap_or(now));
    }

    /// Returns why a request of a tool cannot be served now, if the server is taken.
    fn taken(&self, tool: &str) -> Option<Refusal> {
        let reason = match &self.state {
            State::Free | State::Configured { .. } => return None,
            State::Held { tool: holder, .. } if holder.as_deref() == Some(tool) => return None,
            State::Working(work) => return work.taken(tool),
            State::Stepping(batch) if batch.tool == tool => {
                format!("batch {} of this tool is under way", batch.request)
            }
            State::Running(_) | State::Stepping(_) | State::Held { .. } => {
                let holder = self.holder();
                let holder = holder.as_deref().unwrap_or("another optimization tool");
                format!("taken by {holder}")
            }
        };
        Some(Refusal {
            kind: RefusalKind::Taken,
            reason,
        })
    }

    /// Returns whether answers may be sent to a topic. Only topics of tools are allowed, so that no client can make a
    /// server publish elsewhere.
    fn can_reply(&mut self, reply: &str) -> bool {
        let fits = reply_fits(reply);
        if !fits {
            self.complain(format!(
                "cannot answer a request: its \"reply\" is {reply:?}, expected {}/ and then letters, digits, - or _",
                Topic::ToTool.name()
            ));
        }
        fits
    }

    fn warn(&mut self, text: String) {
        self.actions.push(Action::Notice(Notice::Warning(text)));
    }

    /// Issues a warning only once, however often its cause recurs.
    fn complain(&mut self, text: String) {
        let now = self.clock.unwrap_or_else(Instant::now);
        if self.complaints.make(&text, now) {
            self.warn(text);
        }
    }
}

/// Returns whether a topic is that of a tool.
fn reply_fits(reply: &str) -> bool {
    let token = reply
        .strip_prefix(Topic::ToTool.name())
        .and_then(|rest| rest.strip_prefix('/'));
    token.is_some_and(|token| {
        let plain = |byte: u8| byte.is_ascii_alphanumeric() || matches!(byte, b'-' | b'_');
        !token.is_empty() && token.len() <= 200 && token.bytes().all(plain)
    })
}

fn asker(control: &Control) -> &str {
    name(control.tool.as_deref())
}

/// Returns the name of a tool for users.
fn name(tool: Option<&str>) -> &str {
    tool.unwrap_or("an optimization tool without a name")
}

fn remember<T>(queue: &mut VecDeque<(String, T)>, key: String, value: T) {
    queue.retain(|(other, _)| *other != key);
    queue.push_back((key, value));
    if queue.len() > KEPT {
        queue.pop_front();
    }
}
