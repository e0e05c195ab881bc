//! What a server decides: messages and time in, actions out, no I/O (DESIGN.md section 3).
//!
//! A server is free, configured (parameters came, it waits for control), running, or held: between two episodes of one
//! tool that gave its name it stays reserved for that tool for a moment. It answers discovery when it is free, or held
//! and asked by its holder.

use std::collections::{HashSet, VecDeque};
use std::fmt;
use std::time::{Duration, Instant};

use swarmwright_protocol::{
    Control, Discovery, MAX_PAYLOAD, Message, ParametersMessage, Presence, ServerMessage,
    State as PresenceState, Topic, Topics,
};
use swarmwright_worlds::{Description, Parameters, Scene, Simulation};

use crate::Identity;
use crate::run::{Outcome, Run};

/// How long parameters without control, or a holder without a new episode, keep the server taken.
const PATIENCE: Duration = Duration::from_secs(5);
/// After how long a missing actuator is worth a word.
const TELL_AFTER: Duration = Duration::from_secs(5);
/// A change of presence is published when it has lasted this long: runs of a few milliseconds are no news.
const SETTLE: Duration = Duration::from_millis(150);
/// Parameters messages kept for a control to come: of the tools that share the broker, few ask at once.
const KEPT: usize = 8;
/// Different complaints that are remembered, so that each is made once.
const COMPLAINTS: usize = 1000;

/// What the machine wants done.
#[derive(Debug, Clone, PartialEq)]
pub enum Action {
    /// Publish with QoS 0; or, for presence, QoS 1 and retained.
    Publish(Topic, Vec<u8>),
    /// Tell the operator.
    Notice(Notice),
    /// Show the run.
    Frame(Scene),
}

/// Something that the operator of a server wants to know.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Notice {
    /// The server is free.
    Ready,
    /// The server is taken, by the named tool if it gave a name.
    Busy(Option<String>),
    /// Something is not as it should be.
    Warning(String),
    /// The broker is gone; trying again.
    Lost(String),
}

impl fmt::Display for Notice {
    fn fmt(&self, formatter: &mut fmt::Formatter) -> fmt::Result {
        match self {
            Self::Ready => formatter.write_str("ready"),
            Self::Busy(Some(tool)) => write!(formatter, "busy for {tool}"),
            Self::Busy(None) => formatter.write_str("busy"),
            Self::Warning(text) => write!(formatter, "warning: {text}"),
            Self::Lost(reason) => write!(formatter, "lost the broker: {reason}"),
        }
    }
}

enum State {
    Free,
    Configured { until: Instant },
    Running(Box<Run>),
    Held { tool: String, until: Instant },
}

/// The decisions of one server.
pub struct Machine {
    identity: Identity,
    simulations: Vec<(Description, Box<dyn Simulation>)>,
    topics: Topics,
    step_timeout: Duration,
    state: State,
    /// The last parameters messages by hash, the newest at the back.
    parameters: VecDeque<(String, Parameters)>,
    /// Titles by the hash of the discovery that named them.
    discovered: VecDeque<(String, String)>,
    /// The run before, whose hash a control{run: false} may still name.
    last: Option<(String, Option<String>)>,
    complaints: HashSet<String>,
    published: Option<(PresenceState, Option<String>)>,
    changed_at: Option<Instant>,
    actions: Vec<Action>,
}

impl Machine {
    /// A free server. `step_timeout`: how long a step may wait for actuators before the run is given up.
    #[must_use]
    pub fn new(
        identity: Identity,
        simulations: Vec<Box<dyn Simulation>>,
        topics: Topics,
        step_timeout: Duration,
    ) -> Self {
        Self {
            identity,
            simulations: simulations
                .into_iter()
                .map(|simulation| (simulation.description(), simulation))
                .collect(),
            topics,
            step_timeout,
            state: State::Free,
            parameters: VecDeque::new(),
            discovered: VecDeque::new(),
            last: None,
            complaints: HashSet::new(),
            published: None,
            changed_at: None,
            actions: Vec::new(),
        }
    }

    /// What is to be done now; empties the list.
    pub fn actions(&mut self) -> std::vec::Drain<'_, Action> {
        self.actions.drain(..)
    }

    /// Titles of the simulations offered.
    #[must_use]
    pub fn titles(&self) -> Vec<String> {
        self.simulations
            .iter()
            .map(|(description, _)| description.title.clone())
            .collect()
    }

    /// The presence message for a state.
    #[must_use]
    pub fn presence(&self, state: PresenceState, since: String) -> Presence {
        Presence {
            server: self.identity.id,
            state,
            simulations: self.titles(),
            capabilities: self.identity.capabilities(&self.simulations[0].0),
            tool: self.holder(),
            since,
        }
    }

    fn holder(&self) -> Option<String> {
        match &self.state {
            State::Running(run) => run.tool.clone(),
            State::Held { tool, .. } => Some(tool.clone()),
            State::Free | State::Configured { .. } => None,
        }
    }

    /// A message came in. Retained messages are leftovers of somebody's past, except presence.
    pub fn receive(&mut self, topic: &str, payload: &[u8], retained: bool, now: Instant) {
        let Some(topic) = self.topics.parse(topic) else {
            return;
        };
        if topic == Topic::Presence && payload.is_empty() {
            return;
        }
        if retained && topic != Topic::Presence {
            self.complain(format!(
                "ignoring a retained message on {}: nothing in this protocol is to be retained",
                topic.name()
            ));
            return;
        }
        if topic == Topic::Actuator && self.is_foreign(payload) {
            return;
        }
        match Message::decode(topic, payload) {
            Ok(Message::Discovery(discovery)) => self.discovery(discovery),
            Ok(Message::Parameters(message)) if message.server == self.identity.id => {
                self.configure(message, now)
            }
            Ok(Message::Control(control)) if control.server == self.identity.id => {
                self.control(control, now)
            }
            Ok(Message::Actuator(actuator)) => {
                let State::Running(run) = &mut self.state else {
                    return;
                };
                if run.hash != actuator.simulation_hash {
                    return;
                }
                let simulation = &mut *self.simulations[run.simulation].1;
                match run.actuate(simulation, &actuator) {
                    Ok(outcome) => self.proceed(outcome, now),
                    Err(reason) => self.complain(format!("refusing an actuator message: {reason}")),
                }
            }
            Ok(Message::Presence(presence)) => self.other_presence(&presence),
            Ok(_) => {}
            Err(error) => self.complain(format!("refusing a message on {}: {error}", topic.name())),
        }
    }

    /// Whether an actuator message belongs to another server's run, seen without reading it as JSON: all servers get
    /// all actuator messages, so with many servers nearly every one is foreign.
    fn is_foreign(&self, payload: &[u8]) -> bool {
        let State::Running(run) = &self.state else {
            return false;
        };
        let object = payload.first() == Some(&b'{') && payload.last() == Some(&b'}');
        // A hash may be spelt with escapes.
        object
            && payload.len() <= MAX_PAYLOAD
            && !run.is_named_in(payload)
            && memchr::memchr(b'\\', payload).is_none()
    }

    fn discovery(&mut self, discovery: Discovery) {
        let free = match &self.state {
            State::Free => true,
            State::Held { tool, .. } => discovery.tool.as_ref() == Some(tool),
            State::Configured { .. } | State::Running(_) => false,
        };
        let offered = self
            .simulations
            .iter()
            .find(|(description, _)| description.title == discovery.simulation);
        let Some((description, _)) = offered.filter(|_| free) else {
            return;
        };
        let capabilities = self.identity.capabilities(description);
        if !capabilities.fulfil(&discovery.requirements) {
            return;
        }
        let answer = ServerMessage {
            server: self.identity.id,
            simulation_hash: discovery.simulation_hash.clone(),
            simulations: self.titles(),
            capabilities,
        };
        self.actions
            .push(Action::Publish(Topic::Server, answer.encode()));
        remember(
            &mut self.discovered,
            discovery.simulation_hash,
            discovery.simulation,
        );
    }

    fn configure(&mut self, message: ParametersMessage, now: Instant) {
        remember(
            &mut self.parameters,
            message.simulation_hash,
            message.parameters,
        );
        if let State::Free | State::Configured { .. } = self.state {
            self.enter(
                State::Configured {
                    until: now + PATIENCE,
                },
                now,
            );
        }
    }

    fn control(&mut self, control: Control, now: Instant) {
        if !control.run {
            return self.end(&control, now);
        }
        match &self.state {
            State::Running(run) if run.hash == control.simulation_hash => {
                return self.complain(
                    "ignoring a control message that starts a run that is under way".to_owned(),
                );
            }
            State::Running(run) => {
                let holder = run
                    .tool
                    .clone()
                    .unwrap_or_else(|| "another optimization tool".to_owned());
                return self.complain(format!(
                    "refusing to start a run for {}: taken by {holder}",
                    asker(&control)
                ));
            }
            State::Held { tool, .. } if control.tool.as_ref() != Some(tool) => {
                let holder = tool.clone();
                return self.complain(format!(
                    "refusing to start a run for {}: held by {holder}",
                    asker(&control)
                ));
            }
            _ => {}
        }
        let hash = control.simulation_hash.clone();
        let Some((_, parameters)) = self.parameters.iter().find(|(known, _)| *known == hash) else {
            return self.complain(format!(
                "refusing to start a run for {}: no parameters came for its hash",
                asker(&control)
            ));
        };
        let parameters = parameters.clone();
        let Some(index) = self.wanted(&control) else {
            return self.complain(format!(
                "refusing to start a run for {}: it does not say of which simulation",
                asker(&control)
            ));
        };
        let (description, simulation) = &mut self.simulations[index];
        let template = Run::template(
            hash,
            description.title.clone(),
            control.tool,
            control.visual,
            index,
            now,
        );
        match Run::start(&mut **simulation, &parameters, template) {
            Ok(run) => {
                self.enter(State::Running(Box::new(run)), now);
                self.show(now);
                if !self.paused() {
                    self.sense(now);
                }
            }
            Err(reason) => {
                self.warn(format!("cannot start the run: {reason}"));
                self.enter(State::Free, now);
            }
        }
    }

    /// Which simulation a control message means: the one it names, the one its discovery named, or the only one.
    fn wanted(&self, control: &Control) -> Option<usize> {
        if self.simulations.len() == 1 {
            return Some(0);
        }
        let discovered = self
            .discovered
            .iter()
            .find(|(hash, _)| *hash == control.simulation_hash)
            .map(|(_, title)| title);
        let title = control.simulation.as_ref().or(discovered)?;
        self.simulations
            .iter()
            .position(|(description, _)| description.title == *title)
    }

    fn end(&mut self, control: &Control, now: Instant) {
        let last = self
            .last
            .as_ref()
            .is_some_and(|(hash, _)| *hash == control.simulation_hash);
        let ours = match &self.state {
            State::Running(run) => run.hash == control.simulation_hash,
            State::Configured { .. } => self
                .parameters
                .back()
                .is_some_and(|(hash, _)| *hash == control.simulation_hash),
            State::Held { tool, .. } => last || control.tool.as_ref() == Some(tool),
            State::Free => return,
        };
        if ours {
            self.enter(State::Free, now);
        } else {
            self.complain(format!(
                "ignoring the end of a run that is not under way, from {}",
                asker(control)
            ));
        }
    }

    fn other_presence(&mut self, presence: &Presence) {
        let other = presence.capabilities.swarmwright.as_ref();
        let instance = other.and_then(|other| other.instance.as_ref());
        if presence.server == self.identity.id
            && presence.state != PresenceState::Lost
            && instance != Some(&self.identity.instance)
        {
            let host = other
                .and_then(|other| other.host.clone())
                .unwrap_or_else(|| "an unknown host".to_owned());
            let pid = other
                .and_then(|other| other.pid)
                .map_or_else(String::new, |pid| format!(", process {pid}"));
            self.complain(format!(
                "another server has the id {} too ({host}{pid}); give one of them another --id",
                self.identity.id
            ));
        }
    }

    /// Sends the sensors of the step that begins, or the fitness.
    fn sense(&mut self, now: Instant) {
        let State::Running(run) = &mut self.state else {
            return;
        };
        let actions = &mut self.actions;
        let outcome = run.sense(&mut *self.simulations[run.simulation].1, now, |payload| {
            actions.push(Action::Publish(Topic::Sensor, payload));
        });
        if outcome != Outcome::Stepped {
            self.proceed(outcome, now);
        }
    }

    fn proceed(&mut self, outcome: Outcome, now: Instant) {
        match outcome {
            Outcome::Wait => {}
            Outcome::Stepped => {
                self.show(now);
                if !self.paused() {
                    self.sense(now);
                }
            }
            Outcome::Finished(fitness) => {
                self.actions
                    .push(Action::Publish(Topic::Fitness, fitness.encode()));
                self.leave(now);
            }
            Outcome::Failed(reason) => {
                self.warn(reason);
                self.leave(now);
            }
        }
    }

    /// A run is over: its tool, if it gave its name, keeps the server for the next one.
    fn leave(&mut self, now: Instant) {
        let tool = self.holder();
        self.enter(
            tool.map_or(State::Free, |tool| State::Held {
                tool,
                until: now + PATIENCE,
            }),
            now,
        );
    }

    /// Shows a frame and slows the run down to the pace at which people watch.
    fn show(&mut self, now: Instant) {
        let State::Running(run) = &mut self.state else {
            return;
        };
        let simulation = &self.simulations[run.simulation].1;
        // Where agents act in turn there is a frame a step, not one for every agent.
        if run.visual
            && !simulation.mid_step()
            && let Some(scene) = simulation.scene()
        {
            run.resume_at = Some(now + Duration::from_millis(simulation.step_size()));
            self.actions.push(Action::Frame(scene));
        }
    }

    fn paused(&self) -> bool {
        matches!(&self.state, State::Running(run) if run.resume_at.is_some())
    }

    /// The next time at which `tick` is needed, if no message comes first.
    #[must_use]
    pub fn next_tick(&self) -> Option<Instant> {
        let own = match &self.state {
            State::Free => None,
            State::Configured { until } | State::Held { until, .. } => Some(*until),
            State::Running(run) => run.resume_at.or(Some(
                run.waiting_since
                    + if run.told {
                        self.step_timeout
                    } else {
                        self.step_timeout.min(TELL_AFTER)
                    },
            )),
        };
        let settle = self.changed_at.map(|at| at + SETTLE);
        [own, settle].into_iter().flatten().min()
    }

    /// Time has passed. `stamp` is now in RFC 3339, for presence.
    pub fn tick(&mut self, now: Instant, stamp: impl FnOnce() -> String) {
        match &mut self.state {
            State::Configured { until } if *until <= now => {
                self.warn(
                    "parameters came, but no control message to start the run; free again"
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
                self.warn(format!(
                    "{words}; the run is given up, the server is free again"
                ));
                self.enter(State::Free, now);
            }
            State::Running(run) if !run.told && run.waited(now) >= TELL_AFTER => {
                run.told = true;
                let words = run.waiting_for(now);
                self.warn(words);
            }
            _ => {}
        }
        if self.changed_at.is_some_and(|at| at + SETTLE <= now) {
            self.publish_presence(stamp());
        }
    }

    /// Publishes what the server does now, unless that is known.
    pub fn publish_presence(&mut self, since: String) {
        self.changed_at = None;
        let state = if matches!(self.state, State::Free) {
            PresenceState::Ready
        } else {
            PresenceState::Busy
        };
        let current = (state, self.holder());
        if self.published.as_ref() == Some(&current) {
            return;
        }
        self.actions.push(Action::Publish(
            Topic::Presence,
            self.presence(state, since).encode(),
        ));
        self.actions.push(Action::Notice(match state {
            PresenceState::Busy => Notice::Busy(current.1.clone()),
            _ => Notice::Ready,
        }));
        self.published = Some(current);
    }

    /// The connection broke: messages of the run are lost, so the run is.
    pub fn disconnected(&mut self, reason: &str, now: Instant) {
        if let State::Running(_) = self.state {
            self.warn("the run under way is given up with the connection".to_owned());
        }
        self.actions
            .push(Action::Notice(Notice::Lost(reason.to_owned())));
        self.enter(State::Free, now);
        self.published = None;
    }

    fn enter(&mut self, state: State, now: Instant) {
        if let State::Running(run) = &self.state {
            self.last = Some((run.hash.clone(), run.tool.clone()));
        }
        self.state = state;
        // A change back before anybody was told is none; the comparison is made when it is to be published.
        self.changed_at.get_or_insert(now);
    }

    fn warn(&mut self, text: String) {
        self.actions.push(Action::Notice(Notice::Warning(text)));
    }

    /// A warning that is made only once, however often its cause comes back.
    fn complain(&mut self, text: String) {
        if self.complaints.len() < COMPLAINTS && self.complaints.insert(text.clone()) {
            self.warn(text);
        }
    }
}

fn asker(control: &Control) -> &str {
    control
        .tool
        .as_deref()
        .unwrap_or("an optimization tool without a name")
}

fn remember<T>(queue: &mut VecDeque<(String, T)>, key: String, value: T) {
    queue.retain(|(known, _)| *known != key);
    queue.push_back((key, value));
    if queue.len() > KEPT {
        queue.pop_front();
    }
}
