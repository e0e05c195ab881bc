//! Simulations written in Python: what `swarmwright.simulations.host.Host` says becomes a [`Simulation`].

use std::sync::Arc;
use std::time::{Duration, Instant};

use numpy::{PyArray1, PyArrayMethods, PyReadonlyArray1, PyReadonlyArray2, PyUntypedArrayMethods};
use pyo3::exceptions::PyKeyboardInterrupt;
use pyo3::prelude::*;
use pyo3::types::{PyDict, PyString};
use swarmwright_controllers::Controller;
use swarmwright_pool::check_work;
use swarmwright_worlds::{
    Block, Description, Determinism, Failure, Group, Means, MetricInfo, ParameterError, Parameters,
    RolloutError, Scene, Side, Simulation, Together, fail, measure, rollout,
};
use swarmwright_wrapper::{Progress, guarded};

use crate::errors::{InputError, input};
use crate::genomes::{architecture, rows};
use crate::lanes;
use crate::local::REPORT;
use crate::physics;
use crate::results::{Fitness, Metrics, apart, arrays};
use crate::values::{dict, object, read};
use crate::worlds::create;

/// A simulation from Python: the title of a built-in one, or a host.
pub fn any(simulation: &Bound<'_, PyAny>) -> PyResult<Box<dyn Simulation>> {
    watched(simulation, None)
}

/// As [`any`]; one in Python gives a sign of life with each call of its code.
pub fn watched(
    simulation: &Bound<'_, PyAny>,
    progress: Option<Arc<Progress>>,
) -> PyResult<Box<dyn Simulation>> {
    if simulation.is_instance_of::<PyString>() {
        create(&simulation.extract::<String>()?)
    } else if physics::moves_robots(simulation)? {
        physics::simulation(simulation, progress)
    } else {
        let mut hosted = Hosted::new(simulation.clone())?;
        hosted.progress = progress;
        Ok(Box::new(hosted))
    }
}

/// A simulation whose code is Python's. What that says has been checked by the host.
pub struct Hosted {
    host: Py<PyAny>,
    description: Description,
    copies: bool,
    /// Episodes that can be stepped at once; 1 for most.
    pub lanes: usize,
    /// Whether it has scenes.
    scenes: bool,
    /// Milliseconds between two frames when shown.
    frame: u64,
    agents: usize,
    acting: Vec<u32>,
    done: bool,
    /// (agents, sensors), row-major.
    observations: Vec<f32>,
    /// The episodes of a batch, where these are stepped together.
    pub group: lanes::Group,
    /// Where signs of life go.
    progress: Option<Arc<Progress>>,
    /// Whether it runs controllers itself.
    takes_controller: bool,
    /// Whether there are several kinds of agents.
    has_groups: bool,
    /// Sides of a match.
    sides: Vec<Side>,
    /// The specification of the next episode's, as JSON.
    controller: Option<String>,
}

/// Whether an episode can be repeated; `swarmwright/simulations/host.py` has checked the name.
pub fn determinism(host: &Bound<'_, PyAny>) -> PyResult<Determinism> {
    let name: Option<String> = host.getattr("determinism")?.extract()?;
    Ok(match name.as_deref() {
        Some("bitwise") => Determinism::Bitwise,
        Some("statistical") => Determinism::Statistical(host.getattr("tolerance")?.extract()?),
        Some(_) => Determinism::None,
        None => Determinism::Undeclared,
    })
}

/// Return value of `reset` and `step` of a host: the agents that act next, (agents, sensors), and whether the episode has ended.
type Seen<'py> = (PyReadonlyArray1<'py, u32>, PyReadonlyArray2<'py, f32>, bool);

/// A group of agents: its name, agents, sensors, actuators, and whether rows are padded.
type HostedGroup = (String, u32, usize, usize, bool);

/// A side of a match: its name, groups, and metric that is its fitness.
type HostedSide = (String, Vec<String>, Option<String>);

/// Why a call did not return anything.
pub enum Trouble {
    /// The parameters are refused.
    Refused(String),
    Failed(Failure),
}

/// Runs Python's code, which gives a sign of life; its exceptions become a reason.
pub fn call<T>(
    host: &Py<PyAny>,
    progress: Option<&Progress>,
    call: impl FnOnce(&Bound<'_, PyAny>) -> PyResult<T>,
) -> Result<T, Trouble> {
    if let Some(progress) = progress {
        progress.beat();
    }
    Python::attach(|py| {
        call(host.bind(py)).map_err(|error| {
            if error.is_instance_of::<PyKeyboardInterrupt>(py) {
                // It is raised again in the thread that waits for the episode.
                let raised = py
                    .import("_thread")
                    .and_then(|m| m.call_method0("interrupt_main"));
                let reason = raised.map_or_else(|e| e.to_string(), |_| "interrupted".to_owned());
                return Trouble::Failed(reason.into());
            }
            let reason = error.value(py).to_string();
            if error.is_instance_of::<InputError>(py) {
                Trouble::Refused(reason)
            } else {
                let stack = error.value(py).getattr("stack");
                let stack = stack.and_then(|stack| stack.extract::<Option<String>>());
                Trouble::Failed(Failure {
                    reason,
                    stack: stack.unwrap_or_default(),
                })
            }
        })
    })
}

impl Hosted {
    fn new(host: Bound<'_, PyAny>) -> PyResult<Self> {
        let sides: Vec<HostedSide> = host.getattr("sides")?.extract()?;
        let metrics: Vec<(String, String)> = host.getattr("metrics")?.extract()?;
        Ok(Self {
            description: Description {
                title: host.getattr("title")?.extract()?,
                dimensions: host.getattr("dimensions")?.extract()?,
                max_agents: host.getattr("max_agents")?.extract()?,
                sensors: host.getattr("sensors")?.extract()?,
                actuators: host.getattr("actuators")?.extract()?,
                metrics: metrics.into_iter().map(metric).collect(),
                determinism: determinism(&host)?,
            },
            copies: host.getattr("copies")?.extract()?,
            lanes: host.getattr("lanes")?.extract()?,
            scenes: host.getattr("has_scenes")?.extract()?,
            frame: Duration::try_from_secs_f64(host.getattr("frame_seconds")?.extract()?)
                .map_or(u64::MAX, |frame| {
                    u64::try_from(frame.as_millis()).unwrap_or(u64::MAX)
                }),
            agents: 0,
            acting: Vec::new(),
            done: true,
            observations: Vec::new(),
            group: lanes::Group::default(),
            progress: None,
            takes_controller: host.getattr("takes_controller")?.extract()?,
            has_groups: host.getattr("has_groups")?.extract()?,
            sides: sides.into_iter().map(side).collect(),
            controller: None,
            host: host.unbind(),
        })
    }

    /// Numbers that an agent senses.
    pub fn sensors(&self) -> usize {
        self.description.sensors
    }

    /// Numbers that an agent is steered by.
    pub fn actuators(&self) -> usize {
        self.description.actuators
    }

    /// Runs Python's code; its exceptions become a reason.
    pub fn call<T>(
        &self,
        call: impl FnOnce(&Bound<'_, PyAny>) -> PyResult<T>,
    ) -> Result<T, Trouble> {
        self::call(&self.host, self.progress.as_deref(), call)
    }

    /// A call after which agents act.
    fn proceed(
        &mut self,
        call: impl for<'py> FnOnce(&Bound<'py, PyAny>) -> PyResult<Bound<'py, PyAny>>,
    ) -> Result<(), Trouble> {
        let (mut acting, mut observations) = (
            std::mem::take(&mut self.acting),
            std::mem::take(&mut self.observations),
        );
        acting.clear();
        observations.clear();
        // An episode whose code failed has ended.
        self.done = true;
        (self.agents, self.done) = self.call(|host| {
            let returned = call(host)?;
            let (agents, rows, done): Seen<'_> = returned.extract()?;
            acting.extend(agents.as_array());
            observations.extend(rows.as_array());
            Ok((rows.shape()[0], done))
        })?;
        (self.acting, self.observations) = (acting, observations);
        Ok(())
    }
}

/// A metric by its name and description.
fn metric((name, description): (String, String)) -> MetricInfo {
    MetricInfo {
        name: name.into(),
        unit: "".into(),
        description: description.into(),
    }
}

/// A side of a match.
fn side((name, groups, fitness): HostedSide) -> Side {
    Side {
        name: name.into(),
        groups: groups.into_iter().map(Into::into).collect(),
        fitness: fitness.map(Into::into),
    }
}

/// Formats a refusal of parameters: "name: reason".
pub fn refused(text: &str) -> ParameterError {
    let (name, reason) = text.split_once(": ").unwrap_or(("", text));
    ParameterError {
        name: name.to_owned(),
        reason: reason.to_owned(),
    }
}

/// Ends the episode with the reason.
pub fn or_fail<T>(result: Result<T, Trouble>) -> T {
    match result {
        Ok(value) => value,
        Err(Trouble::Refused(reason)) => fail(reason),
        Err(Trouble::Failed(failure)) => fail(failure),
    }
}

impl Simulation for Hosted {
    fn description(&self) -> Description {
        self.description.clone()
    }

    fn groups(&self) -> Vec<Group> {
        if !self.has_groups {
            return Vec::new();
        }
        let groups: Vec<HostedGroup> =
            or_fail(self.call(|host| host.call_method0("groups")?.extract()));
        let group = |(name, agents, sensors, actuators, padded): HostedGroup| Group {
            name: name.into(),
            agents,
            sensors,
            actuators,
            padded,
            sensor_names: Vec::new(),
            actuator_names: Vec::new(),
            own_sensor_names: Vec::new(),
            own_actuator_names: Vec::new(),
        };
        groups.into_iter().map(group).collect()
    }

    fn sides(&self) -> Vec<Side> {
        self.sides.clone()
    }

    fn take_controller(&mut self, controller: &Controller) {
        if self.takes_controller && controller.steers() {
            let text = serde_json::to_string(&controller.specification());
            self.controller = Some(text.unwrap_or_else(|error| fail(error.to_string())));
        }
    }

    fn reset(&mut self, parameters: &Parameters) -> Result<(), ParameterError> {
        let controller = self.controller.take();
        match self
            .proceed(|host| host.call_method1("reset", (dict(host.py(), parameters)?, controller)))
        {
            Err(Trouble::Refused(text)) => Err(refused(&text)),
            other => {
                or_fail(other);
                Ok(())
            }
        }
    }

    fn acting(&self) -> &[u32] {
        &self.acting
    }

    fn done(&self) -> bool {
        self.done
    }

    fn sense(&self, agent: u32, sensors: &mut [f32]) {
        let first = agent as usize * self.description.sensors;
        if let Some(row) = self.observations.get(first..first + sensors.len()) {
            sensors.copy_from_slice(row);
        }
    }

    fn step(&mut self, actuators: &[f32]) {
        let (agents, width) = (self.agents, self.description.actuators);
        let mut all = vec![0.0; agents * width];
        for (agent, row) in self.acting.iter().zip(actuators.chunks_exact(width)) {
            all[*agent as usize * width..][..width].copy_from_slice(row);
        }
        or_fail(self.proceed(|host| {
            let actions = PyArray1::from_vec(host.py(), all).reshape([agents, width])?;
            host.call_method1("step", (actions,))
        }));
    }

    fn fitness(&self) -> f64 {
        or_fail(self.call(|host| host.call_method0("fitness")?.extract()))
    }

    fn metrics(&self) -> Vec<f64> {
        or_fail(self.call(|host| host.call_method0("measure")?.extract()))
    }

    /// A thread that Python does not know gets a state for each call, which costs ten times the call; and the interpreter's
    /// lock would change hands at each step.
    fn scope(&self) -> fn(&mut dyn FnMut()) {
        |calls| Python::attach(|_| calls())
    }

    fn lanes(&self) -> usize {
        self.lanes
    }

    fn together(&mut self) -> Option<&mut dyn Together> {
        (self.lanes > 1).then_some(self)
    }

    fn evaluate(
        &mut self,
        block: &Block<'_>,
        _means: Means,
    ) -> Option<Result<Vec<f64>, RolloutError>> {
        let controller = block.architecture;
        // What does not fit is complained about one by one. A parameter set has other parameters in each candidate.
        let fits = controller.steers()
            && (controller.sensors(), controller.actuators()) == (self.sensors(), self.actuators());
        (self.lanes > 1 && fits).then(|| lanes::evaluate(self, block))
    }

    fn has_scenes(&self) -> bool {
        self.scenes
    }

    fn scene(&self) -> Option<Scene> {
        or_fail(self.call(|host| {
            let scene = host.call_method0("scene")?;
            (!scene.is_none())
                .then(|| read(&format!("{}: scene", self.description.title), &scene))
                .transpose()
        }))
    }

    fn step_size(&self) -> u64 {
        self.frame
    }

    fn duplicate(&self) -> Option<Box<dyn Simulation>> {
        if !self.copies {
            return None;
        }
        let another = self.call(|host| Self::new(host.call_method0("another")?));
        let mut another = or_fail(another);
        another.progress.clone_from(&self.progress);
        Some(Box::new(another))
    }
}

/// Candidate, episode, reason, stack.
type EpisodeFailure = (usize, usize, String, Option<String>);

/// Evaluates controllers on a host in this process.
#[pyfunction]
#[pyo3(signature = (simulation, parameters, architecture, genomes, seeds, on_progress=None, *, metrics=None))]
#[expect(
    clippy::needless_pass_by_value,
    clippy::too_many_arguments,
    reason = "pyo3 hands arguments over by value, keywords in Python"
)]
pub fn evaluate_host<'py>(
    py: Python<'py>,
    simulation: Bound<'py, PyAny>,
    parameters: &Bound<'py, PyDict>,
    architecture: &Bound<'py, PyDict>,
    genomes: PyReadonlyArray2<'py, f32>,
    seeds: Vec<u64>,
    on_progress: Option<Py<PyAny>>,
    metrics: Option<Vec<String>>,
) -> PyResult<(Fitness<'py>, Metrics<'py>, Vec<EpisodeFailure>)> {
    // Nothing is detached: the simulation's code needs the interpreter all the time.
    let mut simulation = any(&simulation)?;
    let parameters = object("parameters", parameters)?;
    let metrics = simulation
        .described(&parameters)
        .map_err(input)?
        .metrics_named(&metrics.unwrap_or_default())
        .map_err(input)?;
    let (architecture, _) = self::architecture(architecture)?;
    let rows = rows(&architecture, &genomes)?;
    check_work(&architecture, &rows, &seeds).map_err(input)?;
    let block = Block {
        architecture: &architecture,
        genomes: &rows,
        parameters: &parameters,
        seeds: &seeds,
        metrics: &metrics,
        stop: None,
    };
    let shared = Arc::new(architecture.clone());
    let episodes: Vec<Parameters> = (0..seeds.len()).map(|e| block.parameters_of(e)).collect();
    let numbers = block.numbers();
    let mut results = Vec::with_capacity(block.len() * numbers);
    let mut failures = Vec::new();
    let mut reported = Instant::now();
    let mut report = |py: Python<'_>, done: usize| {
        py.check_signals()?;
        if reported.elapsed() >= REPORT || done == block.len() {
            reported = Instant::now();
            if let Some(call) = &on_progress {
                call.call1(py, (done, block.len(), ""))?;
            }
        }
        Ok::<(), PyErr>(())
    };
    // As many at once as can be; where that is not possible, or something fails, one by one.
    let together = simulation.lanes().div_ceil(seeds.len()).max(1);
    while results.len() < block.len() * numbers {
        let first = results.len() / numbers / seeds.len();
        let count = together.min(block.candidates() - first);
        let length = architecture.weight_count();
        let part = Block {
            genomes: &block.genomes[first * length..][..count * length],
            ..block
        };
        match guarded(|| simulation.evaluate(&part, Means::default())) {
            Ok(Some(Ok(values))) if values.iter().all(|value| value.is_finite()) => {
                results.extend(values);
                report(py, results.len() / numbers)?;
            }
            _ => break,
        }
    }
    for candidate in results.len() / numbers / seeds.len()..block.candidates() {
        let controller =
            Controller::with_weights(&shared, block.genome(candidate).into()).map_err(input)?;
        for (episode, parameters) in episodes.iter().enumerate() {
            let first = results.len();
            results.resize(first + numbers, f64::NAN);
            let row = &mut results[first..];
            let failure = evaluated(&mut *simulation, parameters, &controller, &metrics, row)
                .map_err(input)?;
            if let Some(Failure { reason, stack }) = failure {
                results[first..].fill(f64::NAN);
                failures.push((candidate, episode, reason, stack));
            }
            report(py, results.len() / numbers)?;
        }
    }
    let shape = [block.candidates(), seeds.len(), metrics.len()];
    let (fitness, values) = apart(results, numbers);
    let (fitness, values) = arrays(py, fitness, values, shape)?;
    Ok((fitness, values, failures))
}

/// Writes the fitness of an episode and its metrics; returns why it failed.
///
/// # Errors
/// Parameters or a controller with which no episode could go well.
fn evaluated(
    simulation: &mut dyn Simulation,
    parameters: &Parameters,
    controller: &Controller,
    metrics: &[usize],
    results: &mut [f64],
) -> Result<Option<Failure>, RolloutError> {
    let run = || {
        results[0] = rollout(simulation, parameters, controller)?;
        measure(simulation, metrics, &mut results[1..]);
        Ok(())
    };
    match guarded(run) {
        Ok(Ok(())) => Ok(None),
        Ok(Err(error @ RolloutError::Controller { .. })) => Ok(Some(error.to_string().into())),
        Ok(Err(error)) => Err(error),
        Err(failure) => Ok(Some(failure)),
    }
}
