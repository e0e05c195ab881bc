//! One episode on one server, from the optimization tool's side: each agent has a controller with its own state.

use std::time::{Duration, Instant};

use swarmwright_controllers::{Controller, SwarmControllers};
use swarmwright_protocol::{Missing, PieceKind, ReadingWriter, SensorReading, Waiting};

use crate::config::Config;
use crate::scheduler::modes::REPORT_TIMEOUT;
use crate::scheduler::queue::piece::Piece;
use crate::sections::Timeouts;

/// How long a server may take to send a valid message after one was refused.
const AFTER_REFUSAL: Duration = Duration::from_secs(2);

/// An episode in progress.
pub(crate) struct Episode {
    /// The single evaluation of this episode.
    pub piece: Piece,
    pub server: u64,
    /// Last round of discovery before the episode was started.
    round: u64,
    pub started: Instant,
    /// Time of the last usable message from the server.
    heard: Instant,
    /// When and why a message of this run was refused; the server gets little time to send a valid one.
    refused: Option<(Instant, String)>,
    /// Until when the server, which announced that it is free although it had not begun, may still begin.
    vacant: Option<Instant>,
    /// Until when the server, which is busy for an unnamed tool although it had not begun, may still begin.
    unnamed: Option<Instant>,
    /// Last round of discovery before the first sensors arrived.
    begun_in: Option<u64>,
    /// Set if the server answered a later round although it should be running the episode: until when earlier messages
    /// may still arrive, and the number of that round.
    deserted: Option<(Instant, u64)>,
    /// Whether another server has the episode as well because this one is slow.
    backed_up: bool,
    /// Whether the supervisor of the server has been asked about it.
    overdue: bool,
    /// Number of agents, if the parameters determine it.
    agents: Option<u64>,
    controllers: SwarmControllers,
    writer: ReadingWriter,
    actuator: Vec<f32>,
    /// Number of answered sensor messages, by agent.
    answered: Vec<u64>,
    last_agent: u64,
}

/// Number of agents above which the server is at fault, if the parameters do not determine their number.
pub(crate) const MOST_AGENTS: u64 = 1_000_000;

impl Episode {
    pub fn new(
        piece: Piece,
        server: u64,
        prototype: Controller,
        agents: Option<u64>,
        writer: ReadingWriter,
        round: u64,
        now: Instant,
    ) -> Self {
        Self {
            actuator: vec![0.0; prototype.actuators()],
            writer,
            piece,
            server,
            round,
            started: now,
            heard: now,
            refused: None,
            vacant: None,
            unnamed: None,
            begun_in: None,
            deserted: None,
            backed_up: false,
            overdue: false,
            agents,
            controllers: SwarmControllers::new(prototype),
            answered: Vec::new(),
            last_agent: 0,
        }
    }

    /// Answers the sensors of one agent. Returns the payload of the actuator message.
    ///
    /// # Errors
    /// Fails if the agent does not exist or the number of sensors is wrong.
    pub fn answer(&mut self, sensor: &SensorReading, now: Instant) -> Result<Vec<u8>, String> {
        let limit = self.agents.unwrap_or(MOST_AGENTS);
        let agent = usize::try_from(sensor.agent).unwrap_or(usize::MAX);
        if sensor.agent >= limit {
            return Err(format!(
                "agent {} is unknown; the agents are 0 to {}",
                sensor.agent,
                limit - 1
            ));
        }
        if agent >= self.answered.len() {
            self.answered.resize(agent + 1, 0);
        }
        let most = self.controllers.prototype().actuators();
        let number = u32::try_from(agent).unwrap_or(u32::MAX);
        let controller = self.controllers.of(number);
        let controller = controller.map_err(|error| error.to_string())?;
        // If the server pads sensor rows, pad the actuator rows.
        let padded = sensor.sensor.len() > controller.sensors();
        let width = if padded { most } else { controller.actuators() };
        self.actuator.resize(width, 0.0);
        controller
            .step(&sensor.sensor, &mut self.actuator)
            .map_err(|error| error.to_string())?;
        self.answered[agent] += 1;
        self.last_agent = sensor.agent;
        self.heard = now;
        self.refused = None;
        Ok(self.writer.encode(sensor.agent, &self.actuator))
    }

    /// Returns the time of the last usable message from the server.
    pub fn heard(&self) -> Instant {
        self.heard
    }

    /// Records that sensors arrived; `round`: the last round of discovery before.
    pub fn sensors_came(&mut self, round: u64) {
        self.begun_in.get_or_insert(round);
    }

    /// Records that a message of this episode was refused.
    pub fn refuse(&mut self, reason: String, now: Instant) {
        self.refused = Some((now, reason));
    }

    /// Returns why a message was refused, if no valid one has arrived since.
    pub fn refusal(&self) -> Option<&str> {
        self.refused.as_ref().map(|(_, reason)| &**reason)
    }

    /// Records that the server answered a round of discovery; until `until` it may still begin, or earlier messages may
    /// arrive.
    pub fn server_answered(&mut self, round: u64, until: Instant) {
        if !self.begun() && self.round < round {
            self.vacant.get_or_insert(until);
        } else if self.begun_in.is_some_and(|begun| begun < round) {
            // A server does not answer while it runs an episode, so another server with the same id must be running
            // this one.
            self.deserted.get_or_insert((until, round));
        }
    }

    /// Returns the round that the server answered although it should be running the episode, once no earlier messages
    /// can arrive any more.
    pub fn deserted_in(&self, now: Instant) -> Option<u64> {
        let deserted = self.deserted.filter(|(until, _)| *until < now);
        deserted.map(|(_, round)| round)
    }

    /// Returns whether another server has the episode as well because this one is slow.
    pub fn has_backup(&self) -> bool {
        self.backed_up
    }

    /// Records that another server gets the episode as well.
    pub fn back_up(&mut self) {
        self.backed_up = true;
    }

    /// Returns whether to ask the server's supervisor before the episode times out; this is done once.
    pub fn asks_supervisor(&mut self) -> bool {
        self.refused.is_none() && !std::mem::replace(&mut self.overdue, true)
    }

    /// Returns the number of answered steps.
    pub fn steps(&self) -> u64 {
        self.answered.iter().copied().max().unwrap_or(0)
    }

    /// Returns whether the controller steers agents; if not, the fitness is the first message of the episode.
    pub fn steers(&self) -> bool {
        self.controllers.prototype().steers()
    }

    /// Returns whether the server has begun the episode.
    pub fn begun(&self) -> bool {
        self.steps() > 0
    }

    /// Records that the server is busy: for this tool (`None`), or perhaps for another one, in which case it may begin
    /// until `until`.
    pub fn server_is_busy(&mut self, until: Option<Instant>) {
        match until {
            Some(until) if !self.begun() => {
                self.unnamed.get_or_insert(until);
            }
            Some(_) => (),
            None => self.unnamed = None,
        }
    }

    /// Returns until when the server, which is busy for an unnamed tool, may still begin.
    pub fn unnamed_until(&self) -> Option<Instant> {
        self.unnamed.filter(|_| !self.begun())
    }

    /// Returns until when the server, which announced that it is free, may still begin.
    pub fn vacant_until(&self) -> Option<Instant> {
        self.vacant.filter(|_| !self.begun())
    }

    /// Returns when the episode times out.
    pub fn deadline(&self, config: &Config) -> Instant {
        let silent = self.heard + config.timeouts.step;
        let silent = silent.min(self.started + config.timeouts.episode);
        let silent = if self.overdue {
            silent + REPORT_TIMEOUT
        } else {
            silent
        };
        let refused = self.refused.as_ref().map(|(at, _)| *at + AFTER_REFUSAL);
        let earlier = [refused, self.vacant_until(), self.unnamed_until()];
        earlier.into_iter().flatten().fold(silent, Instant::min)
    }

    /// Describes why the episode is ended after its deadline.
    pub fn overdue(&self, timeouts: &Timeouts, now: Instant) -> String {
        if let Some(reason) = self.refusal() {
            return format!("server {}: {reason}", self.server);
        }
        let hint = if now.saturating_duration_since(self.started) < timeouts.episode {
            timeouts.step_hint()
        } else {
            timeouts.episode_hint()
        };
        format!("{}; {hint}", self.waiting_for(now))
    }

    /// Describes the message that the episode waits for.
    pub fn waiting_for(&self, now: Instant) -> Waiting {
        let missing = if !self.steers() {
            Missing::Result
        } else if self.begun() {
            Missing::Sensors
        } else {
            Missing::Start
        };
        let begun = missing == Missing::Sensors;
        // An agent with fewer answers than others has not sent its sensors of the previous step.
        let steps = self.steps();
        let behind = self
            .answered
            .iter()
            .position(|&count| count > 0 && count < steps);
        let agent = behind.map_or(self.last_agent, |agent| agent as u64);
        Waiting {
            server: self.server,
            kind: PieceKind::Episode,
            missing,
            evaluations: 1,
            agent: begun.then_some(agent),
            step: begun.then(|| steps - 1),
            silent: now.saturating_duration_since(self.heard).as_secs_f64(),
        }
    }
}
