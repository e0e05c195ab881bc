//! One episode on one server, seen from the optimization tool: a controller with its own state for every agent.

use std::time::{Duration, Instant};

use swarmwright_controllers::{Controller, SwarmControllers};
use swarmwright_protocol::{Missing, PieceKind, ReadingWriter, SensorReading, Waiting};

use crate::config::Config;
use crate::scheduler::modes::REPORT_TIMEOUT;
use crate::scheduler::queue::piece::Piece;

/// How long a server that sent a message that was refused may take to send a better one.
const AFTER_REFUSAL: Duration = Duration::from_secs(2);

/// An episode under way.
pub(crate) struct Episode {
    /// The one evaluation that it is.
    pub piece: Piece,
    pub server: u64,
    /// The last round of discovery before it.
    round: u64,
    pub started: Instant,
    /// When the server last said something of use.
    heard: Instant,
    /// When and why a message of this run was refused; the server gets little time to send a valid one.
    refused: Option<(Instant, String)>,
    /// Its server said that it is free, though it had not begun: until when it may still begin.
    vacant: Option<Instant>,
    /// Its server is busy and does not say for whom, though it had not begun: until when it may still begin.
    unnamed: Option<Instant>,
    /// The last round of discovery before its first sensors came.
    begun_in: Option<u64>,
    /// Its server, which is to be at it, answered a later round: until when messages of before may still come, and which
    /// round it was.
    deserted: Option<(Instant, u64)>,
    /// Whether it takes so long that another server has it, too.
    backed_up: bool,
    /// Whether the supervisor of the server was asked what became of it.
    overdue: bool,
    /// Number of agents, if the parameters tell.
    agents: Option<u64>,
    controllers: SwarmControllers,
    writer: ReadingWriter,
    actuator: Vec<f32>,
    /// Sensor messages answered, by agent.
    answered: Vec<u64>,
    last_agent: u64,
}

/// Number of agents above which the server is at fault, if the parameters do not set their number.
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

    /// Answers one agent's sensors: the payload of the actuator message.
    ///
    /// # Errors
    /// An agent that there is not, or the wrong number of sensors.
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
        // Who is sent as many numbers for all agents gets as many from all.
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

    /// When the server last said something of use.
    pub fn heard(&self) -> Instant {
        self.heard
    }

    /// Sensors came; `round`: the last round of discovery before.
    pub fn sensors_came(&mut self, round: u64) {
        self.begun_in.get_or_insert(round);
    }

    /// A message of this episode was refused.
    pub fn refuse(&mut self, reason: String, now: Instant) {
        self.refused = Some((now, reason));
    }

    /// Why a message was refused, if no better one came since.
    pub fn refusal(&self) -> Option<&str> {
        self.refused.as_ref().map(|(_, reason)| &**reason)
    }

    /// Its server answered a round of discovery; until then it may still begin, or messages of before may come.
    pub fn server_answered(&mut self, round: u64, until: Instant) {
        if !self.begun() && self.round < round {
            self.vacant.get_or_insert(until);
        } else if self.begun_in.is_some_and(|begun| begun < round) {
            // It is at that episode, or it was: the one that goes on with it is another server.
            self.deserted.get_or_insert((until, round));
        }
    }

    /// The round that its server answered, though it was to be at it, and messages of before can come no more.
    pub fn deserted_in(&self, now: Instant) -> Option<u64> {
        let deserted = self.deserted.filter(|(until, _)| *until < now);
        deserted.map(|(_, round)| round)
    }

    /// Whether it takes so long that another server has it, too.
    pub fn has_backup(&self) -> bool {
        self.backed_up
    }

    /// Another server gets it, too.
    pub fn back_up(&mut self) {
        self.backed_up = true;
    }

    /// Its time is over: whether the server's supervisor is to be asked first, once.
    pub fn asks_supervisor(&mut self) -> bool {
        self.refused.is_none() && !std::mem::replace(&mut self.overdue, true)
    }

    /// Steps that have been answered.
    pub fn steps(&self) -> u64 {
        self.answered.iter().copied().max().unwrap_or(0)
    }

    /// Whether the controller steers agents; else nothing is heard of the episode before its fitness.
    pub fn steers(&self) -> bool {
        self.controllers.prototype().steers()
    }

    /// Whether the server has begun.
    pub fn begun(&self) -> bool {
        self.steps() > 0
    }

    /// Its server is busy: for this tool, or until then it may show that it is.
    pub fn server_is_busy(&mut self, until: Option<Instant>) {
        match until {
            Some(until) if !self.begun() => {
                self.unnamed.get_or_insert(until);
            }
            Some(_) => (),
            None => self.unnamed = None,
        }
    }

    /// Time until which its server, which is busy for an unknown tool, may still begin.
    pub fn unnamed_until(&self) -> Option<Instant> {
        self.unnamed.filter(|_| !self.begun())
    }

    /// Until when its server, which said that it is free, may still begin.
    pub fn vacant_until(&self) -> Option<Instant> {
        self.vacant.filter(|_| !self.begun())
    }

    /// When its time is over.
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

    /// What is waited for.
    pub fn waiting_for(&self, now: Instant) -> Waiting {
        let missing = if !self.steers() {
            Missing::Result
        } else if self.begun() {
            Missing::Sensors
        } else {
            Missing::Start
        };
        let begun = missing == Missing::Sensors;
        // An agent that was answered less often than others still owes its sensors of the step before.
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
