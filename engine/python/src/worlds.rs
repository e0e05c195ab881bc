//! Built-in simulations in this process.

use numpy::{PyArray1, PyArray2, PyArrayMethods};
use pyo3::prelude::*;
use serde_json::json;
use swarmwright_controllers::{Controller, Specification};
use swarmwright_worlds::{self as worlds, Parameters, Simulation};

use crate::errors::{engine, input, object};

/// Titles of the built-in simulations.
#[pyfunction]
pub fn simulations() -> Vec<&'static str> {
    worlds::titles()
}

/// A built-in simulation by its title.
pub fn create(title: &str) -> PyResult<Box<dyn Simulation>> {
    worlds::create(title).ok_or_else(|| unknown(title))
}

fn unknown(title: &str) -> PyErr {
    input(format!(
        "simulation: unknown simulation '{title}'; built in: {}",
        worlds::titles().join(", ")
    ))
}

/// What a built-in simulation says of itself, as JSON.
#[pyfunction]
pub fn describe(title: &str) -> PyResult<String> {
    worlds::describe(title)
        .map(|description| description.to_string())
        .ok_or_else(|| unknown(title))
}

/// Checks parameters against a built-in simulation.
#[pyfunction]
pub fn check_parameters(title: &str, parameters: &str) -> PyResult<()> {
    create(title)?
        .reset(&object("parameters", parameters)?)
        .map_err(input)
}

fn controller(text: &str) -> PyResult<Controller> {
    Specification::from_json(text)
        .map(|specification| Controller::new(&specification))
        .map_err(input)
}

/// One episode, step by step.
#[pyclass(name = "Episode", module = "swarmwright._engine", unsendable)]
pub struct PyEpisode(worlds::Episode);

#[pymethods]
impl PyEpisode {
    #[new]
    #[pyo3(signature = (title, parameters, controller))]
    fn new(title: &str, parameters: &str, controller: &str) -> PyResult<Self> {
        let simulation = create(title)?;
        let controller = self::controller(controller)?;
        worlds::Episode::new(simulation, &object("parameters", parameters)?, &controller)
            .map(Self)
            .map_err(input)
    }

    #[getter]
    fn done(&self) -> bool {
        self.0.done()
    }

    #[getter]
    fn fitness(&self) -> f64 {
        self.0.simulation().fitness()
    }

    #[getter]
    fn step_size(&self) -> f64 {
        std::time::Duration::from_millis(self.0.simulation().step_size()).as_secs_f64()
    }

    fn step(&mut self) -> PyResult<()> {
        self.0.step().map_err(engine)
    }

    fn scene(&self) -> PyResult<String> {
        self.shown().map(|scene| json!(scene).to_string())
    }

    #[pyo3(signature = (columns, color, rows=24, unicode=true))]
    fn text(&self, columns: usize, color: bool, rows: usize, unicode: bool) -> PyResult<String> {
        let style = worlds::TextStyle {
            columns,
            rows,
            color,
            unicode,
        };
        self.shown()
            .map(|scene| worlds::render(&scene, style).join("\n"))
    }
}

impl PyEpisode {
    fn shown(&self) -> PyResult<worlds::Scene> {
        self.0
            .simulation()
            .scene()
            .ok_or_else(|| engine("this simulation has nothing to show"))
    }
}

/// Evaluates controllers in this process.
#[pyfunction]
#[expect(
    clippy::needless_pass_by_value,
    reason = "pyo3 hands arguments over by value"
)]
pub fn rollout<'py>(
    py: Python<'py>,
    title: &str,
    parameters: &str,
    controllers: Vec<String>,
    seeds: Vec<u64>,
) -> PyResult<Bound<'py, PyArray2<f64>>> {
    let mut simulation = create(title)?;
    let parameters = object("parameters", parameters)?;
    let crews = controllers
        .iter()
        .map(|text| controller(text))
        .collect::<PyResult<Vec<_>>>()?;
    let fitness = py
        .detach(|| evaluate(&mut *simulation, &parameters, &crews, &seeds))
        .map_err(input)?;
    PyArray1::from_vec(py, fitness).reshape([controllers.len(), seeds.len()])
}

fn evaluate(
    simulation: &mut dyn Simulation,
    parameters: &Parameters,
    controllers: &[Controller],
    seeds: &[u64],
) -> Result<Vec<f64>, worlds::RolloutError> {
    let mut parameters = parameters.clone();
    let mut fitness = Vec::with_capacity(controllers.len() * seeds.len());
    for controller in controllers {
        for &seed in seeds {
            parameters.insert("seed".to_owned(), seed.into());
            fitness.push(worlds::rollout(simulation, &parameters, controller)?);
        }
    }
    Ok(fitness)
}
