//! Episodes that are stepped side by side, with controllers in Python.

use numpy::{IntoPyArray, PyArray1, PyArray2, PyArrayMethods, PyReadonlyArray2};
use pyo3::prelude::*;
use pyo3::types::{PyDict, PyString};
use rayon::prelude::*;
use serde_json::Value;
use swarmwright_worlds::{self as worlds, Parameters, Simulation};
use swarmwright_wrapper::guarded;

use crate::errors::{engine, input};
use crate::simulation::any;
use crate::values::object;
use crate::worlds::{catch_panic, scene, scene_arrays, text};

/// The agents that act next, and their sensors.
type Acting<'py> = (
    Bound<'py, PyArray1<u32>>,
    Bound<'py, PyArray1<u32>>,
    Bound<'py, PyArray2<f32>>,
);

/// Several episodes of one simulation.
#[pyclass(name = "Episodes", module = "swarmwright._engine", unsendable)]
pub struct PyEpisodes {
    simulations: Vec<Box<dyn Simulation>>,
    sensors: usize,
    actuators: usize,
    /// Whether threads of the engine may step them: code in Python waits for the interpreter.
    threads: bool,
}

#[pymethods]
impl PyEpisodes {
    #[new]
    #[pyo3(signature = (simulation, parameters, seeds))]
    #[expect(
        clippy::needless_pass_by_value,
        reason = "pyo3 hands arguments over by value"
    )]
    fn new(
        simulation: &Bound<'_, PyAny>,
        parameters: &Bound<'_, PyDict>,
        seeds: Vec<u64>,
    ) -> PyResult<Self> {
        let parameters = object("parameters", parameters)?;
        let mut simulations: Vec<Box<dyn Simulation>> = Vec::with_capacity(seeds.len());
        let (mut sensors, mut actuators) = (0, 0);
        for seed in &seeds {
            let mut episode = match simulations.first() {
                // A host has one simulation object, so another episode needs another host.
                Some(first) if !simulation.is_instance_of::<PyString>() => {
                    catch_panic(|| first.duplicate())?.ok_or_else(|| {
                        input("seeds: this simulation runs one episode at a time in a process; pass a single seed")
                    })?
                }
                _ => any(simulation)?,
            };
            let mut parameters: Parameters = parameters.clone();
            parameters.insert("seed".to_owned(), Value::from(*seed));
            catch_panic(|| episode.reset(&parameters))?.map_err(input)?;
            let description = episode.described(&parameters).map_err(input)?;
            (sensors, actuators) = (description.sensors, description.actuators);
            simulations.push(episode);
        }
        Ok(Self {
            simulations,
            sensors,
            actuators,
            threads: simulation.is_instance_of::<PyString>(),
        })
    }

    #[getter]
    fn done(&self) -> bool {
        self.simulations.iter().all(|simulation| simulation.done())
    }

    /// Of the first episode: whether agents act in turn, and others have yet to.
    #[getter]
    fn mid_step(&self) -> bool {
        self.simulations
            .first()
            .is_some_and(|simulation| !simulation.done() && simulation.mid_step())
    }

    fn acting<'py>(&self, py: Python<'py>) -> PyResult<Acting<'py>> {
        let (mut episodes, mut agents) = (Vec::new(), Vec::new());
        for (episode, simulation) in (0..).zip(&self.simulations) {
            if !simulation.done() {
                let acting = simulation.acting();
                episodes.resize(episodes.len() + acting.len(), episode);
                agents.extend_from_slice(acting);
            }
        }
        let mut sensors = vec![0.0; agents.len() * self.sensors];
        let rows = sensors.chunks_exact_mut(self.sensors.max(1));
        for ((episode, agent), row) in episodes.iter().zip(&agents).zip(rows) {
            let simulation = &self.simulations[*episode as usize];
            catch_panic(|| simulation.sense(*agent, row))?;
        }
        let shape = [agents.len(), self.sensors];
        Ok((
            episodes.into_pyarray(py),
            agents.into_pyarray(py),
            sensors.into_pyarray(py).reshape(shape)?,
        ))
    }

    #[expect(
        clippy::needless_pass_by_value,
        reason = "pyo3 hands arguments over by value"
    )]
    fn step(&mut self, py: Python<'_>, actuators: PyReadonlyArray2<'_, f32>) -> PyResult<()> {
        let all: Vec<f32> = actuators.as_array().iter().copied().collect();
        let mut parts = Vec::with_capacity(self.simulations.len());
        let mut rest = all.as_slice();
        for simulation in &mut self.simulations {
            if simulation.done() {
                continue;
            }
            let numbers = simulation.acting().len() * self.actuators;
            let (part, others) = rest
                .split_at_checked(numbers)
                .ok_or_else(|| input("actuators: expected one row for each acting agent"))?;
            rest = others;
            parts.push((simulation, part));
        }
        if !rest.is_empty() {
            return Err(input("actuators: expected one row for each acting agent"));
        }
        let stepped = |(simulation, part): (&mut Box<dyn Simulation>, &[f32])| {
            guarded(|| simulation.step(part))
        };
        let result = match parts.len() {
            // Handing one episode to another thread takes longer than many a step.
            _ if !self.threads => parts.into_iter().try_for_each(stepped),
            0 | 1 => py.detach(|| parts.into_iter().try_for_each(stepped)),
            _ => py.detach(|| parts.into_par_iter().try_for_each(stepped)),
        };
        result.map_err(|failure| engine(failure.reason))
    }

    fn fitness<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray1<f64>>> {
        let fitness: PyResult<Vec<f64>> = self
            .simulations
            .iter()
            .map(|simulation| catch_panic(|| simulation.fitness()))
            .collect();
        Ok(fitness?.into_pyarray(py))
    }

    #[expect(
        clippy::needless_pass_by_value,
        reason = "pyo3 hands arguments over by value"
    )]
    fn metrics<'py>(
        &self,
        py: Python<'py>,
        names: Vec<String>,
    ) -> PyResult<Bound<'py, PyArray2<f64>>> {
        let mut values = vec![f64::NAN; self.simulations.len() * names.len()];
        if !names.is_empty() {
            for (simulation, row) in self
                .simulations
                .iter()
                .zip(values.chunks_exact_mut(names.len()))
            {
                let indices = simulation
                    .description()
                    .metrics_named(&names)
                    .map_err(input)?;
                catch_panic(|| worlds::measure(simulation.as_ref(), &indices, row))?;
            }
        }
        values
            .into_pyarray(py)
            .reshape([self.simulations.len(), names.len()])
    }

    #[getter]
    fn metric_names(&self) -> PyResult<Vec<String>> {
        let metrics = self.first()?.description().metrics;
        Ok(metrics
            .iter()
            .map(|metric| metric.name.to_string())
            .collect())
    }

    #[getter]
    fn step_size(&self) -> PyResult<f64> {
        Ok(std::time::Duration::from_millis(self.first()?.step_size()).as_secs_f64())
    }

    fn scene<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        scene(py, self.first()?)
    }

    fn scene_arrays<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        scene_arrays(py, self.first()?)
    }

    #[pyo3(signature = (columns, color, rows=24, unicode=true))]
    fn text(&self, columns: usize, color: bool, rows: usize, unicode: bool) -> PyResult<String> {
        text(self.first()?, columns, color, rows, unicode)
    }
}

impl PyEpisodes {
    /// The episode that is shown.
    fn first(&self) -> PyResult<&dyn Simulation> {
        let first = self
            .simulations
            .first()
            .ok_or_else(|| input("seeds: expected at least one"))?;
        Ok(first.as_ref())
    }
}
