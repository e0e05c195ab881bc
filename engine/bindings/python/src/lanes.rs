//! Evaluations on a simulation in Python that steps many episodes at once.

use std::sync::Arc;

use numpy::{PyArray1, PyArrayMethods, PyReadonlyArray1, PyReadonlyArray2, PyReadonlyArray3};
use pyo3::prelude::*;
use swarmwright_controllers::{Controller, SwarmControllers};
use swarmwright_worlds::{Block, ParameterError, Parameters, RolloutError, Together};

use crate::simulation::{Hosted, Trouble, or_fail, refused};
use crate::values::dict;

/// What `start` and `go` of a host return: who acts next, (episodes, agents), (episodes, agents, sensors), which episodes
/// have ended.
type Many<'py> = (
    PyReadonlyArray2<'py, bool>,
    PyReadonlyArray3<'py, f32>,
    PyReadonlyArray1<'py, bool>,
);

/// The state of all episodes between two steps.
#[derive(Default)]
struct BatchState {
    agents: usize,
    /// (episodes, agents), row-major.
    acting: Vec<bool>,
    /// (episodes, agents, sensors), row-major.
    observations: Vec<f32>,
    over: Vec<bool>,
}

impl BatchState {
    fn take(&mut self, returned: &Bound<'_, PyAny>) -> PyResult<()> {
        let (acting, observations, over): Many<'_> = returned.extract()?;
        let (acting, observations) = (acting.as_array(), observations.as_array());
        self.agents = acting.shape()[1];
        self.acting.clear();
        self.acting.extend(acting);
        self.observations.clear();
        self.observations.extend(observations);
        self.over.clear();
        self.over.extend(over.as_array());
        Ok(())
    }
}

/// The episodes of a batch, which are stepped together.
#[derive(Default)]
pub struct Group {
    state: BatchState,
    /// By episode.
    acting: Vec<Vec<u32>>,
    /// By episode; those that have ended have theirs.
    results: Vec<Vec<f64>>,
    metrics: Vec<usize>,
}

impl Group {
    /// Looks at what a call has returned; asks for the results of the episodes that have ended with it.
    fn look(&mut self, host: &Hosted, ended: &[bool]) {
        let agents = self.state.agents.max(1);
        self.acting = self
            .state
            .acting
            .chunks(agents)
            .map(|acts| {
                (0..)
                    .zip(acts)
                    .filter(|(_, a)| **a)
                    .map(|(i, _)| i)
                    .collect()
            })
            .collect();
        if ended == self.state.over {
            return;
        }
        let numbers = 1 + self.metrics.len();
        let mut results = vec![f64::NAN; self.state.over.len() * numbers];
        results_of(host, ended, &self.state.over, &self.metrics, &mut results);
        let rows = results.chunks_exact(numbers);
        for (index, (result, row)) in self.results.iter_mut().zip(rows).enumerate() {
            if self.state.over[index] && !ended[index] {
                *result = row.to_vec();
            }
        }
    }
}

impl Together for Hosted {
    fn start(
        &mut self,
        parameters: &Parameters,
        seeds: &[u64],
        metrics: &[usize],
    ) -> Result<(), ParameterError> {
        let mut group = Group {
            results: vec![Vec::new(); seeds.len()],
            metrics: metrics.to_vec(),
            ..Group::default()
        };
        let started = self.call(|python| {
            let seeds = PyArray1::from_slice(python.py(), seeds);
            let parameters = dict(python.py(), parameters)?;
            let returned = python.call_method1("start", (parameters, seeds))?;
            group.state.take(&returned)
        });
        match started {
            Err(Trouble::Refused(text)) => return Err(refused(&text)),
            other => or_fail(other),
        }
        group.look(self, &vec![false; seeds.len()]);
        self.group = group;
        Ok(())
    }

    fn acting(&self, episode: usize) -> &[u32] {
        self.group.acting.get(episode).map_or(&[], Vec::as_slice)
    }

    fn done(&self, episode: usize) -> bool {
        self.group.state.over.get(episode).copied().unwrap_or(true)
    }

    fn sense(&self, episode: usize, agent: u32, sensors: &mut [f32]) {
        let row = episode * self.group.state.agents + agent as usize;
        let first = row * self.sensors();
        let rows = &self.group.state.observations;
        if let Some(row) = rows.get(first..first + sensors.len()) {
            sensors.copy_from_slice(row);
        }
    }

    fn step(&mut self, actuators: &[f32]) {
        let mut group = std::mem::take(&mut self.group);
        let width = self.actuators();
        let shape = [group.state.over.len(), group.state.agents, width];
        let mut all = vec![0.0; shape.iter().product()];
        let acts = group.state.acting.iter();
        let places = all.chunks_exact_mut(width).zip(acts).filter(|(_, a)| **a);
        for ((slot, _), row) in places.zip(actuators.chunks_exact(width)) {
            slot.copy_from_slice(row);
        }
        let ended = group.state.over.clone();
        or_fail(self.call(|python| {
            let actions = PyArray1::from_vec(python.py(), all).reshape(shape)?;
            group.state.take(&python.call_method1("go", (actions,))?)
        }));
        group.look(self, &ended);
        self.group = group;
    }

    fn results(&self, episode: usize) -> &[f64] {
        self.group.results.get(episode).map_or(&[], Vec::as_slice)
    }
}

/// The fitness of every candidate in every episode, each followed by the metrics that the block asks for.
///
/// # Errors
/// Parameters that are refused, a controller that does not compute. The code's own failures end the call, as those of
/// [`fail`](swarmwright_worlds::fail).
pub fn evaluate(host: &Hosted, block: &Block<'_>) -> Result<Vec<f64>, RolloutError> {
    let architecture = Arc::new(block.architecture.clone());
    let numbers = block.numbers();
    let mut results = vec![f64::NAN; block.len() * numbers];
    for (index, results) in results.chunks_mut(host.lanes * numbers).enumerate() {
        let first = index * host.lanes;
        let mut episodes = Vec::with_capacity(results.len() / numbers);
        let mut seeds = Vec::with_capacity(episodes.capacity());
        for evaluation in first..first + results.len() / numbers {
            let (candidate, episode) = (
                evaluation / block.seeds.len(),
                evaluation % block.seeds.len(),
            );
            let prototype = Controller::with_weights(&architecture, block.genome(candidate).into())
                .map_err(|source| RolloutError::Weights { candidate, source })?;
            episodes.push(SwarmControllers::new(prototype));
            seeds.push(block.seeds[episode]);
        }
        run(host, block, seeds, &mut episodes, results)?;
    }
    Ok(results)
}

/// Runs an episode of each seed, side by side.
fn run(
    host: &Hosted,
    block: &Block<'_>,
    seeds: Vec<u64>,
    episodes: &mut [SwarmControllers],
    results: &mut [f64],
) -> Result<(), RolloutError> {
    let mut state = BatchState::default();
    let mut ended = vec![false; episodes.len()];
    let started = host.call(|python| {
        let seeds = PyArray1::from_vec(python.py(), seeds);
        let parameters = dict(python.py(), block.parameters)?;
        state.take(&python.call_method1("start", (parameters, seeds))?)
    });
    match started {
        Err(Trouble::Refused(text)) => return Err(refused(&text).into()),
        other => or_fail(other),
    }
    loop {
        if ended != state.over {
            results_of(host, &ended, &state.over, block.metrics, results);
            ended.copy_from_slice(&state.over);
        }
        if ended.iter().all(|over| *over) {
            return Ok(());
        }
        let actions = actions(host, episodes, &state)?;
        let shape = [episodes.len(), state.agents, host.actuators()];
        or_fail(host.call(|python| {
            let actions = PyArray1::from_vec(python.py(), actions).reshape(shape)?;
            state.take(&python.call_method1("go", (actions,))?)
        }));
    }
}

/// What all controllers compute, (episodes, agents, actuators); 0 for agents that do not act.
fn actions(
    host: &Hosted,
    episodes: &mut [SwarmControllers],
    state: &BatchState,
) -> Result<Vec<f32>, RolloutError> {
    let (sensors, actuators) = (host.sensors(), host.actuators());
    let mut actions = vec![0.0; state.acting.len() * actuators];
    let rows = state.observations.chunks_exact(sensors);
    let places = actions.chunks_exact_mut(actuators);
    for (index, ((acts, row), action)) in state.acting.iter().zip(rows).zip(places).enumerate() {
        if !acts {
            continue;
        }
        let agent = u32::try_from(index % state.agents).unwrap_or(u32::MAX);
        episodes[index / state.agents]
            .of(agent)
            .and_then(|controller| controller.step(row, action))
            .map_err(|source| RolloutError::Controller { agent, source })?;
    }
    Ok(actions)
}

/// Writes the results of the episodes that have ended with this step.
fn results_of(
    host: &Hosted,
    ended: &[bool],
    over: &[bool],
    metrics: &[usize],
    results: &mut [f64],
) {
    let numbers = 1 + metrics.len();
    or_fail(host.call(|python| {
        let values = python.call_method1("results", (!metrics.is_empty(),))?;
        let values: PyReadonlyArray2<'_, f64> = values.extract()?;
        let values = values.as_array();
        for (episode, results) in results.chunks_exact_mut(numbers).enumerate() {
            if over[episode] && !ended[episode] {
                results[0] = values[[0, episode]];
                for (metric, result) in metrics.iter().zip(&mut results[1..]) {
                    *result = values[[1 + metric, episode]];
                }
            }
        }
        Ok(())
    }));
}
