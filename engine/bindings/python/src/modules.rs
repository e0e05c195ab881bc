//! Machines with behaviours and conditions in Python on a simulation server: what
//! `swarmwright.servers.evaluation.served_modules.ServedModules` computes.

use std::sync::Arc;
use std::sync::atomic::Ordering;

use numpy::{PyArray1, PyArrayMethods, PyReadonlyArray2};
use pyo3::prelude::*;
use swarmwright_controllers::Controller;
use swarmwright_protocol::ModuleCode;
use swarmwright_worlds::{
    Block, Describer, Description, Group, Means, ParameterError, ParameterInfo, Parameters,
    RolloutError, Scene, Side, Simulation, Together, fail,
};
use swarmwright_wrapper::Progress;

use crate::simulation::{Trouble, call, or_fail, refused};
use crate::values::{dict, read, to_python};

/// A simulation whose server computes machines with modules in Python, many episodes together; everything else is as without.
pub struct WithModules {
    inner: Box<dyn Simulation>,
    modules: Py<PyAny>,
    /// Episodes that Python computes in about the time of one.
    together: usize,
    progress: Option<Arc<Progress>>,
    /// The machine of the next episode, if it is one of these: its specification as JSON.
    machine: Option<String>,
    /// The episode of such a machine, which steers the agents.
    episode: Option<Played>,
}

struct Played {
    episode: Py<PyAny>,
    done: bool,
}

/// What a server with these modules announces.
pub fn announced(modules: &Bound<'_, PyAny>) -> PyResult<Vec<ModuleCode>> {
    read("modules", &modules.getattr("announced")?)
}

impl WithModules {
    pub fn new(
        inner: Box<dyn Simulation>,
        modules: &Bound<'_, PyAny>,
        progress: Option<Arc<Progress>>,
    ) -> PyResult<Self> {
        Ok(Self {
            inner,
            modules: modules.clone().unbind(),
            together: modules.getattr("together")?.extract()?,
            progress,
            machine: None,
            episode: None,
        })
    }

    fn call<T>(
        &self,
        object: &Py<PyAny>,
        action: impl FnOnce(&Bound<'_, PyAny>) -> PyResult<T>,
    ) -> Result<T, Trouble> {
        call(object, self.progress.as_deref(), action)
    }

    /// The results of a block of such machines; NaN for an episode that has to be computed alone, so that it says what failed.
    fn machines(&self, block: &Block<'_>) -> Result<Vec<f64>, RolloutError> {
        let description = self.inner.described(block.parameters)?;
        let metrics = block.metrics.iter();
        let metrics: Vec<&str> = metrics
            .map(|index| &*description.metrics[*index].name)
            .collect();
        let begun = self.call(&self.modules, |modules| {
            let py = modules.py();
            let shape = [block.candidates(), block.architecture.weight_count()];
            let genomes = PyArray1::from_slice(py, block.genomes).reshape(shape)?;
            let arguments = (
                to_python(py, block.architecture)?,
                genomes,
                block.seeds,
                dict(py, block.parameters)?,
                metrics,
            );
            Ok(modules.call_method1("begin", arguments)?.unbind())
        });
        let work = match begun {
            Err(Trouble::Refused(text)) => return Err(refused(&text).into()),
            other => or_fail(other),
        };
        let stopped = || block.stop.is_some_and(|stop| stop.load(Ordering::Relaxed));
        while !stopped() && or_fail(self.call(&work, |work| work.call_method0("step")?.extract())) {
        }
        Ok(or_fail(self.call(&work, |work| {
            let results: PyReadonlyArray2<'_, f64> = work.call_method0("results")?.extract()?;
            Ok(results.as_array().iter().copied().collect())
        })))
    }

    fn played<T>(
        &self,
        action: impl FnOnce(&Bound<'_, PyAny>) -> PyResult<T>,
    ) -> Option<Result<T, Trouble>> {
        let played = self.episode.as_ref()?;
        Some(self.call(&played.episode, action))
    }
}

impl Simulation for WithModules {
    fn description(&self) -> Description {
        self.inner.description()
    }

    fn describer(&self) -> Option<Describer> {
        self.inner.describer()
    }

    fn parameters(&self) -> Vec<ParameterInfo> {
        self.inner.parameters()
    }

    fn sensor_names(&self) -> Vec<String> {
        self.inner.sensor_names()
    }

    fn actuator_names(&self) -> Vec<String> {
        self.inner.actuator_names()
    }

    fn groups(&self) -> Vec<Group> {
        if self.episode.is_some() {
            return Vec::new();
        }
        self.inner.groups()
    }

    fn sides(&self) -> Vec<Side> {
        self.inner.sides()
    }

    fn take_controller(&mut self, controller: &Controller) {
        let specification = controller.specification();
        if specification.architecture().in_python().is_none() {
            self.inner.take_controller(controller);
            return;
        }
        let text = serde_json::to_string(&specification);
        self.machine = Some(text.unwrap_or_else(|error| fail(error.to_string())));
    }

    fn sensor_units(&self) -> Vec<String> {
        self.inner.sensor_units()
    }

    fn actuator_units(&self) -> Vec<String> {
        self.inner.actuator_units()
    }

    fn reset(&mut self, parameters: &Parameters) -> Result<(), ParameterError> {
        self.episode = None;
        // Its description follows from the parameters, also where agents steer themselves.
        self.inner.reset(parameters)?;
        let Some(machine) = self.machine.take() else {
            return Ok(());
        };
        let begun = self.call(&self.modules, |modules| {
            let parameters = dict(modules.py(), parameters)?;
            let episode = modules.call_method1("play", (machine, parameters))?;
            Ok(Played {
                done: episode.getattr("done")?.extract()?,
                episode: episode.unbind(),
            })
        });
        match begun {
            Err(Trouble::Refused(text)) => Err(refused(&text)),
            other => {
                self.episode = Some(or_fail(other));
                Ok(())
            }
        }
    }

    fn acting(&self) -> &[u32] {
        match self.episode {
            Some(_) => &[],
            None => self.inner.acting(),
        }
    }

    fn done(&self) -> bool {
        match &self.episode {
            Some(played) => played.done,
            None => self.inner.done(),
        }
    }

    fn sense(&self, agent: u32, sensors: &mut [f32]) {
        self.inner.sense(agent, sensors);
    }

    fn step(&mut self, actuators: &[f32]) {
        let stepped = self.played(|episode| {
            episode.call_method0("step")?;
            episode.getattr("done")?.extract()
        });
        match (stepped, &mut self.episode) {
            (Some(done), Some(played)) => played.done = or_fail(done),
            _ => self.inner.step(actuators),
        }
    }

    fn mid_step(&self) -> bool {
        self.episode.is_none() && self.inner.mid_step()
    }

    fn fitness(&self) -> f64 {
        match self.played(|episode| episode.getattr("fitness")?.extract()) {
            Some(fitness) => or_fail(fitness),
            None => self.inner.fitness(),
        }
    }

    fn metrics(&self) -> Vec<f64> {
        let metrics = self.played(|episode| {
            let names = episode.getattr("metric_names")?;
            episode.call_method1("metrics", (names,))?.extract()
        });
        match metrics {
            Some(metrics) => or_fail(metrics),
            None => self.inner.metrics(),
        }
    }

    /// For batches, whose controllers are in the tool.
    fn duplicate(&self) -> Option<Box<dyn Simulation>> {
        self.inner.duplicate()
    }

    fn scope(&self) -> fn(&mut dyn FnMut()) {
        self.inner.scope()
    }

    fn evaluate(
        &mut self,
        block: &Block<'_>,
        means: Means,
    ) -> Option<Result<Vec<f64>, RolloutError>> {
        if block.architecture.in_python().is_none() {
            return self.inner.evaluate(block, means);
        }
        // Python knows the thread all the time, and not for each step anew.
        Some(Python::attach(|_| self.machines(block)))
    }

    fn together(&mut self) -> Option<&mut dyn Together> {
        self.inner.together()
    }

    fn lanes(&self) -> usize {
        self.inner.lanes().max(self.together)
    }

    fn has_scenes(&self) -> bool {
        self.inner.has_scenes()
    }

    fn scene(&self) -> Option<Scene> {
        self.inner.scene()
    }

    fn step_size(&self) -> u64 {
        self.inner.step_size()
    }
}
