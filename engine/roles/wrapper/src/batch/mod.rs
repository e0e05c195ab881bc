//! Batched episodes: one message carries all acting agents of all episodes.

mod view;

use std::collections::BTreeMap;
use std::time::Instant;

use swarmwright_protocol::{
    BatchActuators, BatchSensors, BatchStart, EXTENSION_VERSION, F32s, F64s, Failure, MAX_BLOCK,
    Refusal, U32s,
};
use swarmwright_worlds::{Description, Failure as Cause, Parameters, Simulation};

use crate::group::Group;
use crate::guard::guarded;
use crate::job::{add_failure, invalid, metrics_wanted};
use view::View;

struct Episode {
    /// The episode's own simulation; `None` if it has ended, or is stepped by a group.
    simulation: Option<Box<dyn Simulation>>,
    /// Number of rows for its agents; `None` once it has ended.
    rows: Option<usize>,
}

/// A batch that is being stepped.
pub(crate) struct Batch {
    pub tool: String,
    pub request: u64,
    pub reply: String,
    /// Index of the simulation among those that the server offers.
    pub simulation: usize,
    /// When the current step began to wait for actuators.
    pub waiting_since: Instant,
    /// Whether a warning about the wait has been issued.
    pub told: bool,
    /// Whether an episode steers itself, so that the batch does not wait for actuators.
    pub goes_on: bool,
    step: u64,
    sensors: usize,
    actuators: usize,
    /// Names of the requested metrics, and their indices in the simulation's description.
    metrics: Vec<String>,
    wanted: Vec<usize>,
    episodes: Vec<Episode>,
    /// Group that steps the episodes, if one simulation steps all of them.
    group: Option<Group>,
    /// Simulations that this batch does not need any more.
    spare: Vec<Box<dyn Simulation>>,
    rows: usize,
    /// Episodes that have failed since the last message.
    failed: Vec<Failure>,
}

/// Records a failure, with one stack trace per reason in a message.
fn note(failed: &mut Vec<Failure>, episode: usize, cause: Cause) {
    add_failure(failed, 0, episode as u64, cause);
}

impl Batch {
    /// Resets one simulation per seed, or a single one for all seeds. Returns the simulations in case of an error.
    pub fn start(
        message: BatchStart,
        simulation: usize,
        description: &Description,
        simulations: Vec<Box<dyn Simulation>>,
        now: Instant,
    ) -> Result<Self, (Refusal, Vec<Box<dyn Simulation>>)> {
        let metrics = match metrics_wanted(description, &message.metrics) {
            Ok(metrics) => metrics,
            Err(refusal) => return Err((refusal, simulations)),
        };
        let mut batch = Self {
            tool: message.tool,
            request: message.request,
            reply: message.reply,
            simulation,
            waiting_since: now,
            told: false,
            goes_on: false,
            step: 0,
            sensors: description.sensors,
            actuators: description.actuators,
            metrics: message.metrics,
            wanted: metrics,
            episodes: Vec::new(),
            group: None,
            spare: Vec::new(),
            rows: 0,
            failed: Vec::new(),
        };
        let (mut parameters, seeds) = (message.parameters, message.seeds.0);
        if seeds.len() > simulations.len() {
            return batch.start_together(simulations, parameters, seeds);
        }
        batch
            .episodes
            .extend(simulations.into_iter().map(|own| Episode {
                simulation: Some(own),
                rows: Some(0),
            }));
        for (index, (seed, episode)) in seeds.into_iter().zip(&mut batch.episodes).enumerate() {
            parameters.insert("seed".to_owned(), seed.into());
            let Some(simulation) = &mut episode.simulation else {
                continue;
            };
            match guarded(|| simulation.reset(&parameters)) {
                Ok(Ok(())) => {}
                Ok(Err(error)) => {
                    return Err((invalid(error.to_string()), batch.into_simulations()));
                }
                Err(cause) => {
                    episode.rows = None;
                    note(&mut batch.failed, index, cause);
                }
            }
        }
        Ok(batch)
    }

    /// Starts one simulation for all seeds.
    fn start_together(
        mut self,
        mut simulations: Vec<Box<dyn Simulation>>,
        parameters: Parameters,
        seeds: Vec<u64>,
    ) -> Result<Self, (Refusal, Vec<Box<dyn Simulation>>)> {
        let Some(simulation) = simulations.pop() else {
            return Err((
                invalid("seeds: there is no simulation".to_owned()),
                simulations,
            ));
        };
        self.spare = simulations;
        self.episodes.extend(seeds.iter().map(|_| Episode {
            simulation: None,
            rows: Some(0),
        }));
        let mut group = Group::new(simulation, parameters, seeds, self.actuators);
        let started = group.start(&self.wanted);
        self.group = Some(group);
        match started {
            Ok(Ok(())) => {}
            Ok(Err(error)) => return Err((invalid(error.to_string()), self.into_simulations())),
            Err(_) => self.apart(),
        }
        Ok(self)
    }

    /// Returns which episodes have not ended.
    fn running(&self) -> Vec<bool> {
        self.episodes.iter().map(|e| e.rows.is_some()).collect()
    }

    /// Continues each episode separately after the group's code has failed, except those that fail again.
    fn apart(&mut self) {
        let Some(group) = self.group.take() else {
            return;
        };
        let (simulation, alone) = group.apart(&self.running());
        self.spare.push(simulation);
        for (index, (episode, alone)) in self.episodes.iter_mut().zip(alone).enumerate() {
            match alone {
                None => {}
                Some(Ok(simulation)) => episode.simulation = Some(simulation),
                Some(Err(cause)) => {
                    episode.rows = None;
                    note(&mut self.failed, index, cause);
                }
            }
        }
    }

    /// Returns the simulations, for the next batch.
    pub fn into_simulations(self) -> Vec<Box<dyn Simulation>> {
        let own = self.episodes.into_iter().filter_map(|e| e.simulation);
        let group = self.group.map(Group::into_simulation);
        group.into_iter().chain(self.spare).chain(own).collect()
    }

    /// Returns whether all episodes have ended or failed.
    pub fn is_over(&self) -> bool {
        self.episodes.iter().all(|episode| episode.rows.is_none())
    }

    /// Steps all episodes that need no actuators now. Returns whether there were any.
    pub fn go_on(&mut self, now: Instant) -> bool {
        self.waiting_since = now;
        self.goes_on = false;
        let running = self.running();
        if let Some(group) = &mut self.group {
            self.goes_on = group.goes_on(&running);
            if self.goes_on && group.step(&[], &running).is_err() {
                self.apart();
            }
            return self.goes_on;
        }
        for (index, episode) in self.episodes.iter_mut().enumerate() {
            if episode.rows.is_none() {
                continue;
            }
            match guarded(|| episode.step_by_itself()) {
                Ok(stepped) => self.goes_on |= stepped,
                Err(cause) => {
                    episode.rows = None;
                    note(&mut self.failed, index, cause);
                }
            }
        }
        self.goes_on
    }

    /// Builds the message for the step that begins.
    ///
    /// # Errors
    /// Fails if there are more agents than one message can hold.
    pub fn sense(&mut self, server: u64, now: Instant) -> Result<BatchSensors, Refusal> {
        self.waiting_since = now;
        self.told = false;
        let mut message = BatchSensors {
            failed: std::mem::take(&mut self.failed),
            ..answer(self.request, server, self.step)
        };
        self.rows = 0;
        for (index, episode) in self.episodes.iter_mut().enumerate() {
            if episode.rows.is_none() {
                continue;
            }
            let before = (message.agents.0.len(), message.sensors.0.len());
            let Some(view) = View::of(episode.simulation.as_deref(), self.group.as_mut(), index)
            else {
                continue;
            };
            match guarded(|| view.sense(self.sensors, &mut message)).and_then(|result| result) {
                Ok(None) => {
                    episode.rows = None;
                    match view.end(&self.wanted, &self.metrics) {
                        Ok(results) => {
                            message.ended.0.push(number(index));
                            message.fitness.0.push(results[0]);
                            for (name, value) in self.metrics.iter().zip(&results[1..]) {
                                let values = message.metrics.entry(name.clone()).or_default();
                                values.0.push(*value);
                            }
                        }
                        Err(cause) => note(&mut message.failed, index, cause),
                    }
                }
                Ok(Some(rows)) => {
                    episode.rows = Some(rows);
                    self.rows += rows;
                    let all = message.episodes.0.len() + rows;
                    message.episodes.0.resize(all, number(index));
                }
                Err(cause) => {
                    message.agents.0.truncate(before.0);
                    message.sensors.0.truncate(before.1);
                    episode.rows = None;
                    note(&mut message.failed, index, cause);
                }
            }
            if self.rows.saturating_mul(4 * self.sensors + 8) > MAX_BLOCK / 2 {
                return Err(invalid(format!(
                    "seeds: the agents of {} episodes are too many for one message; start fewer at once",
                    self.episodes.len()
                )));
            }
        }
        Ok(message)
    }

    /// Applies the actuators of a step.
    ///
    /// # Errors
    /// Fails if the step or the number of actuators is wrong; the message is refused, and the batch continues to wait.
    pub fn actuate(&mut self, message: &BatchActuators) -> Result<(), String> {
        if self.goes_on {
            return Err("no actuators are expected now".to_owned());
        }
        if message.step != self.step {
            return Err(format!(
                "they answer step {}, but step {} waits for actuators",
                message.step, self.step
            ));
        }
        let (actual, expected) = (message.actuators.0.len(), self.rows * self.actuators);
        if actual != expected {
            return Err(format!(
                "{actual} actuators, expected {expected} ({} rows of {})",
                self.rows, self.actuators
            ));
        }
        let actuators: Vec<f32> = message
            .actuators
            .0
            .iter()
            .map(|value| value.clamp(-1.0, 1.0))
            .collect();
        self.step += 1;
        let running = self.running();
        if let Some(group) = &mut self.group {
            if group.step(&actuators, &running).is_err() {
                self.apart();
            }
            return Ok(());
        }
        let mut rest = &actuators[..];
        for (index, episode) in self.episodes.iter_mut().enumerate() {
            let Some(rows) = episode.rows else { continue };
            let own;
            (own, rest) = rest.split_at(rows * self.actuators);
            let Some(simulation) = &mut episode.simulation else {
                continue;
            };
            if let Err(cause) = guarded(|| simulation.step(own)) {
                episode.rows = None;
                note(&mut self.failed, index, cause);
            }
        }
        Ok(())
    }

    /// Describes the wait for actuators.
    pub fn waiting_for(&self, now: Instant) -> String {
        let seconds = now
            .saturating_duration_since(self.waiting_since)
            .as_secs_f64();
        format!(
            "{} has not sent the actuators of step {} of its batch for {seconds:.1} s",
            self.tool, self.step
        )
    }

    /// Builds the message with the reason for ending the batch.
    pub fn refusal(&self, server: u64, refusal: Refusal) -> BatchSensors {
        BatchSensors {
            error: Some(refusal),
            ..answer(self.request, server, self.step)
        }
    }
}

impl Episode {
    /// Steps a simulation that needs no actuators and has not ended. Returns whether it did.
    fn step_by_itself(&mut self) -> bool {
        let Some(simulation) = &mut self.simulation else {
            return false;
        };
        let alone = simulation.acting().is_empty() && !simulation.done();
        if alone {
            simulation.step(&[]);
        }
        alone
    }
}

/// Builds a message without rows.
pub(crate) fn answer(request: u64, server: u64, step: u64) -> BatchSensors {
    BatchSensors {
        version: EXTENSION_VERSION,
        request,
        server,
        step,
        episodes: U32s::default(),
        agents: U32s::default(),
        sensors: F32s::default(),
        ended: U32s::default(),
        fitness: F64s::default(),
        metrics: BTreeMap::new(),
        failed: Vec::new(),
        error: None,
    }
}

/// Converts the index of an episode, which is always below [`MAX_BATCH`](crate::machine::MAX_BATCH).
fn number(index: usize) -> u32 {
    u32::try_from(index).unwrap_or(u32::MAX)
}
