//! Stepwise runs: the acting agents, and the actuators that have arrived.

use std::borrow::Cow;
use std::collections::BTreeMap;
use std::time::{Duration, Instant};

use memchr::memmem::Finder;
use swarmwright_protocol::{
    Actuator, Control, Fitness, MAX_SENSOR, ReadingWriter, SceneMessage, ToTool,
};
use swarmwright_worlds::{Failure, Group, MetricInfo, ParameterError, Parameters, Simulation};

use crate::guard::{finite, guarded};
use crate::scenes::{sending, to_message};

/// An episode that is being stepped.
pub(crate) struct Run {
    pub hash: String,
    /// Finder of the hash in a message that has not been parsed.
    finder: Finder<'static>,
    writer: ReadingWriter,
    pub title: String,
    pub tool: Option<String>,
    /// Topic, without prefix, on which the tool receives failures of the episode.
    pub reply: Option<String>,
    pub visual: bool,
    /// Parts of the scene that the tool wants with every step besides the bodies; `None` for no scenes.
    pub scenes: Option<Vec<String>>,
    /// Index of the simulation among those that the server offers.
    pub simulation: usize,
    /// Number of completed steps.
    pub steps: u64,
    /// When the current step began to wait for actuators.
    pub waiting_since: Instant,
    /// Whether a warning about the wait has been issued.
    pub told: bool,
    /// When the run continues, if it does not wait for actuators: it is being shown, or the simulation steers itself.
    pub resume_at: Option<Instant>,
    acting: Vec<u32>,
    arrived: Vec<bool>,
    missing: usize,
    actuators: Vec<f32>,
    per_agent: usize,
    sensors: Vec<f32>,
    /// Kinds of agents with their own sensors and actuators; empty if all agents have the same.
    groups: Vec<Group>,
    metrics: Cow<'static, [MetricInfo]>,
}

/// Result of an event in a run.
#[derive(Debug, PartialEq)]
pub(crate) enum Outcome {
    /// Other actuators are still missing.
    Wait,
    /// The simulation has been stepped and waits for new actuators.
    Stepped,
    /// The simulation has been stepped without actuators and will be again.
    WentOn,
    /// The episode has ended; with the reason why its metrics are missing, if they are.
    Finished(Fitness, Option<Failure>),
    /// The simulation failed.
    Failed(Failure),
    /// The sensors of an agent do not fit into a message.
    TooLarge { agent: u32, bytes: usize },
}

/// Why an episode did not start.
pub(crate) enum NoStart {
    /// The simulation refuses a parameter.
    Refused(ParameterError),
    /// The simulation failed.
    Failed(Failure),
}

impl From<Failure> for NoStart {
    fn from(failure: Failure) -> Self {
        Self::Failed(failure)
    }
}

impl Run {
    /// Resets the simulation.
    pub fn start(
        simulation: &mut dyn Simulation,
        parameters: &Parameters,
        template: Self,
    ) -> Result<Self, NoStart> {
        guarded(|| simulation.reset(parameters))?.map_err(NoStart::Refused)?;
        let description = guarded(|| simulation.description())?;
        Ok(Self {
            groups: guarded(|| simulation.groups())?,
            per_agent: description.actuators,
            sensors: vec![0.0; description.sensors],
            metrics: description.metrics,
            ..template
        })
    }

    pub fn template(
        hash: String,
        title: String,
        simulation: usize,
        control: Control,
        now: Instant,
    ) -> Self {
        let Control {
            tool,
            reply,
            visual,
            scenes,
            ..
        } = control;
        // Scenes cannot be sent without a reply topic.
        let scenes = scenes.filter(|_| reply.is_some());
        Self {
            finder: Finder::new(&hash).into_owned(),
            writer: ReadingWriter::sensor(&title, &hash),
            hash,
            title,
            tool,
            reply,
            visual,
            scenes,
            simulation,
            steps: 0,
            waiting_since: now,
            told: false,
            resume_at: None,
            acting: Vec::new(),
            arrived: Vec::new(),
            missing: 0,
            actuators: Vec::new(),
            per_agent: 0,
            sensors: Vec::new(),
            groups: Vec::new(),
            metrics: Cow::default(),
        }
    }

    /// Returns the group of an agent, if there are groups.
    fn group_of(&self, agent: u32) -> Option<&Group> {
        let mut first = 0_u32;
        self.groups.iter().find(|group| {
            first = first.saturating_add(group.agents);
            agent < first
        })
    }

    /// Returns the length of the sensor message of an agent.
    fn sensors_of(&self, agent: u32) -> usize {
        let own = self.group_of(agent).filter(|group| !group.padded);
        own.map_or(self.sensors.len(), |group| {
            group.sensors.min(self.sensors.len())
        })
    }

    /// Checks the number of actuators for an agent; returns the expected number if it is wrong.
    fn check_actuators(&self, agent: u32, count: usize) -> Result<(), usize> {
        let Some(group) = self.group_of(agent) else {
            return (count == self.per_agent)
                .then_some(())
                .ok_or(self.per_agent);
        };
        let padded = group.padded && count == self.per_agent;
        (padded || count == group.actuators)
            .then_some(())
            .ok_or(group.actuators)
    }

    /// Sends the sensors of all acting agents, or ends the episode if it is done. A simulation that needs no actuators
    /// is stepped once, and again whenever the run is resumed; in between the server reads its messages.
    pub fn sense(
        &mut self,
        simulation: &mut dyn Simulation,
        now: Instant,
        mut send: impl FnMut(Vec<u8>),
    ) -> Outcome {
        self.waiting_since = now;
        self.told = false;
        self.acting.clear();
        if let Err(reason) = guarded(|| self.acting.extend_from_slice(simulation.acting())) {
            return Outcome::Failed(reason);
        }
        if self.acting.is_empty() {
            match guarded(|| simulation.done()) {
                Ok(true) => {}
                Ok(false) => return self.step_by_itself(simulation, now),
                Err(reason) => return Outcome::Failed(reason),
            }
            return match self.outcome(simulation) {
                Ok((fitness, unmeasured)) => Outcome::Finished(fitness, unmeasured),
                Err(reason) => Outcome::Failed(reason),
            };
        }
        self.missing = self.acting.len();
        self.arrived.clear();
        self.arrived.resize(self.missing, false);
        self.actuators.clear();
        self.actuators.resize(self.missing * self.per_agent, 0.0);
        for &agent in &self.acting {
            if let Err(reason) = guarded(|| simulation.sense(agent, &mut self.sensors)) {
                return Outcome::Failed(reason);
            }
            if let Some(index) = self.sensors.iter().position(|value| !value.is_finite()) {
                let value = self.sensors[index];
                let reason =
                    format!("sensor {index} of agent {agent} is {value}, not a finite number");
                return Outcome::Failed(reason.into());
            }
            let payload = self
                .writer
                .encode(u64::from(agent), &self.sensors[..self.sensors_of(agent)]);
            let bytes = payload.len();
            if bytes > MAX_SENSOR {
                return Outcome::TooLarge { agent, bytes };
            }
            send(payload);
        }
        Outcome::Stepped
    }

    /// Returns the fitness message. A failure of the metrics is an error only if the tool receives failures; another
    /// tool would wait for the fitness in vain.
    fn outcome(&self, simulation: &dyn Simulation) -> Result<(Fitness, Option<Failure>), Failure> {
        let fitness = guarded(|| simulation.fitness()).and_then(finite)?;
        let (metrics, unmeasured) = match self.measured(simulation) {
            Ok(metrics) => (metrics, None),
            Err(failure) if self.reply.is_none() => (BTreeMap::new(), Some(failure)),
            Err(failure) => return Err(failure),
        };
        let message = Fitness {
            simulation: Some(self.title.clone()),
            simulation_hash: self.hash.clone(),
            fitness,
            metrics,
        };
        Ok((message, unmeasured))
    }

    /// Returns the current scene as a message, if the simulation has one. Metrics that cannot be measured yet are
    /// omitted.
    pub fn scene(
        &self,
        simulation: &dyn Simulation,
        server: u64,
    ) -> Result<Option<Vec<u8>>, Failure> {
        let Some(parts) = &self.scenes else {
            return Ok(None);
        };
        let Some(scene) = sending(|| guarded(|| simulation.scene()))? else {
            return Ok(None);
        };
        let fitness = guarded(|| simulation.fitness()).and_then(finite).ok();
        let message = SceneMessage {
            server,
            simulation_hash: self.hash.clone(),
            fitness,
            metrics: self.measured(simulation).unwrap_or_default(),
            seconds: Some(Duration::from_millis(simulation.step_size()).as_secs_f64()),
            ..to_message(&scene, parts)
        };
        Ok(Some(ToTool::Scene(Box::new(message)).encode()))
    }

    /// Returns all metrics by name, except values that are not finite, which the tool may not need.
    fn measured(&self, simulation: &dyn Simulation) -> Result<BTreeMap<String, f64>, Failure> {
        if self.metrics.is_empty() {
            return Ok(BTreeMap::new());
        }
        let values = guarded(|| simulation.metrics())?;
        let names = self.metrics.iter().map(|metric| metric.name.to_string());
        Ok(names
            .zip(values)
            .filter(|(_, value)| value.is_finite())
            .collect())
    }

    fn step_by_itself(&mut self, simulation: &mut dyn Simulation, now: Instant) -> Outcome {
        self.steps += 1;
        self.resume_at = Some(now);
        match guarded(|| simulation.step(&[])) {
            Ok(()) => Outcome::WentOn,
            Err(reason) => Outcome::Failed(reason),
        }
    }

    /// Returns whether a payload contains the run's hash.
    pub fn is_named_in(&self, payload: &[u8]) -> bool {
        self.finder.find(payload).is_some()
    }

    /// Applies the actuators of one agent.
    ///
    /// # Errors
    /// Fails if the agent was not asked or the number of actuators is wrong; the message is refused, and the run
    /// continues to wait.
    pub fn actuate(
        &mut self,
        simulation: &mut dyn Simulation,
        message: &Actuator,
    ) -> Result<Outcome, String> {
        let agent = message.agent;
        let Some(slot) = u32::try_from(agent)
            .ok()
            .and_then(|agent| self.acting.binary_search(&agent).ok())
        else {
            return Err(format!(
                "agent {agent} is not among those asked for actuators"
            ));
        };
        let count = message.actuator.len();
        if let Err(expected) = self.check_actuators(self.acting[slot], count) {
            return Err(format!(
                "{count} actuators for agent {agent}, expected {expected}"
            ));
        }
        if self.resume_at.is_some() || std::mem::replace(&mut self.arrived[slot], true) {
            return Err(format!("the actuators of agent {agent} arrived twice"));
        }
        for (to, from) in self.actuators[slot * self.per_agent..]
            .iter_mut()
            .zip(&message.actuator)
        {
            *to = from.clamp(-1.0, 1.0);
        }
        self.missing -= 1;
        if self.missing > 0 {
            return Ok(Outcome::Wait);
        }
        self.steps += 1;
        Ok(match guarded(|| simulation.step(&self.actuators)) {
            Ok(()) => Outcome::Stepped,
            Err(reason) => Outcome::Failed(reason),
        })
    }

    /// Describes the missing actuators and the duration of the wait.
    pub fn waiting_for(&self, now: Instant) -> String {
        let missing: Vec<u32> = self
            .acting
            .iter()
            .zip(&self.arrived)
            .filter(|(_, arrived)| !**arrived)
            .map(|(&agent, _)| agent)
            .collect();
        let seconds = now
            .saturating_duration_since(self.waiting_since)
            .as_secs_f64();
        let shown = missing
            .iter()
            .take(8)
            .map(u32::to_string)
            .collect::<Vec<_>>()
            .join(", ");
        let more = if missing.len() > 8 {
            format!(" and {} more", missing.len() - 8)
        } else {
            String::new()
        };
        let tool = self
            .tool
            .as_deref()
            .unwrap_or("an optimization tool without a name");
        format!(
            "{tool} has not sent the actuators of agent {shown}{more} in step {} for {seconds:.1} s",
            self.steps
        )
    }

    pub fn waited(&self, now: Instant) -> Duration {
        if self.resume_at.is_some() {
            Duration::ZERO
        } else {
            now.saturating_duration_since(self.waiting_since)
        }
    }
}
