//! A batch of episodes on one server, from the optimization tool's side: each agent of each episode has a controller
//! with its own state, and one message per step carries the actuators of all agents.

use swarmwright_controllers::{Controller, ControllerError, SwarmControllers};
use swarmwright_protocol::BatchSensors;

use crate::metrics::needed;
use crate::scheduler::modes::episode::MOST_AGENTS;

/// Size in bytes of an index in a message.
const INDEX: usize = size_of::<u32>();

/// A batch in progress.
pub(crate) struct Batch {
    /// Next step.
    step: u64,
    /// Number of agents of an episode, if the parameters determine it.
    agents: Option<u64>,
    /// Names of the required metrics.
    metrics: Vec<String>,
    /// Controllers of each episode; `None` once the episode has ended.
    episodes: Vec<Option<SwarmControllers>>,
    actuators: usize,
    sensors: usize,
    /// Approximate size in bytes of the server's largest message.
    largest: usize,
}

/// Content of a message from the server.
#[derive(Debug, Default)]
pub(crate) struct Progress {
    /// Fitness and the required metrics, by index of the episode in the batch.
    pub ended: Vec<(usize, f64, Vec<f64>)>,
    /// Reason and stack, by index of the episode in the batch.
    pub failed: Vec<(usize, String, Option<String>)>,
    /// The step and (rows, actuators) of the answer; `None` once all episodes have ended.
    pub answer: Option<(u64, Vec<f32>)>,
}

impl Batch {
    /// Creates a batch; `controllers` has one element per episode.
    pub fn new(controllers: Vec<Controller>, agents: Option<u64>, metrics: Vec<String>) -> Self {
        let (sensors, actuators) = controllers.first().map_or((0, 0), |controller| {
            (controller.sensors(), controller.actuators())
        });
        let episode = |prototype| Some(SwarmControllers::new(prototype));
        Self {
            step: 0,
            agents,
            metrics,
            episodes: controllers.into_iter().map(episode).collect(),
            actuators,
            sensors,
            largest: 0,
        }
    }

    /// Returns whether the controllers steer agents.
    pub fn steers(&self) -> bool {
        self.actuators > 0
    }

    /// Returns the number of answered steps.
    pub fn steps(&self) -> u64 {
        self.step
    }

    /// Returns the approximate size in bytes of the server's next message, 0 if it cannot exceed the earlier ones;
    /// `None` if unknown. `results`: number of values that an episode ends with.
    pub fn due(&self, results: usize) -> Option<usize> {
        let open = self.episodes.iter().flatten().count();
        let ends = open * (INDEX + 8 * results);
        if !self.steers() {
            return Some(ends);
        }
        if self.step > 0 {
            return Some(if ends > self.largest { ends } else { 0 });
        }
        let agents = usize::try_from(self.agents?).ok()?;
        Some(
            open.saturating_mul(agents)
                .saturating_mul(self.row())
                .max(ends),
        )
    }

    /// Returns the size in bytes of one agent in a message.
    fn row(&self) -> usize {
        2 * INDEX + size_of::<f32>() * self.sensors
    }

    /// Processes a message from the server. Returns `None` if it repeats an older one.
    ///
    /// # Errors
    /// Fails if the step, an episode or an agent is invalid, if the arrays do not match, or if no agent acts although
    /// episodes have not ended.
    pub fn step(&mut self, message: BatchSensors) -> Result<Option<Progress>, String> {
        if message.step < self.step {
            return Ok(None);
        }
        if message.step > self.step {
            let (actual, expected) = (message.step, self.step);
            return Err(format!("step {actual} arrived, expected {expected}"));
        }
        let came = message.episodes.0.len() * self.row() + message.ended.0.len() * INDEX;
        self.largest = self.largest.max(came);
        let mut progress = Progress::default();
        for (column, (&episode, &fitness)) in
            message.ended.0.iter().zip(&message.fitness.0).enumerate()
        {
            let episode = self.end(episode.into())?;
            let value = |name: &str| message.metrics.get(name)?.0.get(column).copied();
            match needed(&self.metrics, value) {
                Ok(metrics) => progress.ended.push((episode, fitness, metrics)),
                Err(reason) => progress.failed.push((episode, reason, None)),
            }
        }
        for failure in message.failed {
            let episode = self.end(failure.episode)?;
            progress
                .failed
                .push((episode, failure.reason, failure.stack));
        }
        let rows = message.episodes.0.len();
        if rows > 0 && self.actuators == 0 {
            return Err(ControllerError::SteersNoAgents.to_string());
        }
        if message.sensors.0.len() != rows * self.sensors {
            return Err(format!(
                "{} sensors for {rows} agents, expected {} each",
                message.sensors.0.len(),
                self.sensors
            ));
        }
        if rows == 0 {
            return match self.episodes.iter().position(Option::is_some) {
                Some(open) => Err(format!("no agent acts, but episode {open} has not ended")),
                None => Ok(Some(progress)),
            };
        }
        let mut actuators = vec![0.0; rows * self.actuators];
        let agents = message.episodes.0.iter().zip(&message.agents.0);
        let sensors = message.sensors.0.chunks_exact(self.sensors);
        let room = actuators.chunks_exact_mut(self.actuators);
        for (((&episode, &agent), sensors), room) in agents.zip(sensors).zip(room) {
            self.controller(episode, agent)?
                .step(sensors, room)
                .map_err(|error| format!("agent {agent} of episode {episode}: {error}"))?;
        }
        progress.answer = Some((self.step, actuators));
        self.step += 1;
        Ok(Some(progress))
    }

    fn end(&mut self, episode: u64) -> Result<usize, String> {
        let index = usize::try_from(episode).unwrap_or(usize::MAX);
        let slot = self.episodes.get_mut(index);
        match slot.and_then(Option::take) {
            Some(_) => Ok(index),
            None => Err(format!("episode {episode} ended but was not running")),
        }
    }

    fn controller(&mut self, episode: u32, agent: u32) -> Result<&mut Controller, String> {
        let limit = self.agents.unwrap_or(MOST_AGENTS);
        if u64::from(agent) >= limit {
            let last = limit - 1;
            return Err(format!(
                "agent {agent} is unknown; the agents are 0 to {last}"
            ));
        }
        let Some(Some(controllers)) = self.episodes.get_mut(episode as usize) else {
            return Err(format!("episode {episode} acts but is not running"));
        };
        controllers.of(agent).map_err(|error| error.to_string())
    }
}
