//! Built-in simulations in this process.

use std::borrow::Cow;

use numpy::{IntoPyArray, PyArray1, PyArray2, PyArrayMethods};
use pyo3::prelude::*;
use pyo3::types::PyDict;
use swarmwright_controllers::{Controller, Specification};
use swarmwright_worlds::{self as worlds, Description, Parameters, Simulation};

use swarmwright_wrapper::guarded;

use crate::arrays;
use crate::errors::{engine, input};
use crate::simulation::any;
use crate::values::{object, to_python};

/// Titles of the built-in simulations.
#[pyfunction]
pub fn simulations() -> Vec<&'static str> {
    worlds::titles()
}

/// A built-in simulation by its title.
pub fn create(title: &str) -> PyResult<Box<dyn Simulation>> {
    worlds::create(title).ok_or_else(|| unknown(title))
}

/// What a built-in simulation says of itself with these parameters; refuses other titles.
pub fn known(title: &str, parameters: &Parameters) -> PyResult<Cow<'static, Description>> {
    worlds::described(title, parameters)
        .ok_or_else(|| unknown(title))?
        .map_err(input)
}

fn unknown(title: &str) -> PyErr {
    input(format!(
        "simulation: unknown simulation '{title}'; built in: {}",
        worlds::titles().join(", ")
    ))
}

/// The description of a built-in simulation, with default parameters or these.
#[pyfunction]
#[pyo3(signature = (title, parameters=None))]
pub fn describe<'py>(
    py: Python<'py>,
    title: &str,
    parameters: Option<&Bound<'_, PyDict>>,
) -> PyResult<Bound<'py, PyAny>> {
    let parameters = parameters
        .map(|parameters| object("parameters", parameters))
        .transpose()?;
    let description = worlds::describe(title, parameters.as_ref())
        .ok_or_else(|| unknown(title))?
        .map_err(input)?;
    to_python(py, &description)
}

/// The built-in missions of the arena.
#[pyfunction]
pub fn missions(py: Python<'_>) -> PyResult<Bound<'_, PyAny>> {
    let missions: Vec<serde_json::Value> = worlds::missions()
        .into_iter()
        .map(|mission| {
            serde_json::json!({
                "name": mission.name, "also": mission.also, "title": mission.title,
                "robots": mission.robots, "duration": mission.duration, "text": mission.text,
            })
        })
        .collect();
    to_python(py, &missions)
}

/// The names of the built-in models of robots of the arena.
#[pyfunction]
pub fn robots() -> Vec<&'static str> {
    worlds::robots()
}

/// All that is wrong with parameters of a built-in simulation, each as place and reason.
///
/// Of simulations that name one mistake at a time, its parameter is left out to find the next, and what only that makes wrong
/// is not told.
#[pyfunction]
pub fn parameter_mistakes(
    title: &str,
    parameters: &Bound<'_, PyDict>,
) -> PyResult<Vec<(String, String)>> {
    let mut parameters = object("parameters", parameters)?;
    if let Some(all) = create(title)?.mistakes(&parameters) {
        return Ok(all
            .into_iter()
            .map(|mistake| (mistake.name, mistake.reason))
            .collect());
    }
    let mut mistakes = Vec::new();
    while let Err(mistake) = create(title)?.reset(&parameters) {
        let end = mistake.name.find(['.', '[']);
        let name = &mistake.name[..end.unwrap_or(mistake.name.len())];
        let value = parameters.remove_entry(name);
        let missing = value.is_none();
        let alone = value.map(|entry| Parameters::from_iter([entry]));
        let is_wrong_alone = match &alone {
            Some(alone) => create(title)?.reset(alone) == Err(mistake.clone()),
            None => false,
        };
        if mistakes.is_empty() || is_wrong_alone {
            mistakes.push((mistake.name, mistake.reason));
        }
        if missing {
            break;
        }
    }
    Ok(mistakes)
}

/// Whether a built-in simulation steers its agents itself, with these parameters.
#[pyfunction]
pub fn steers_itself(title: &str, parameters: &Bound<'_, PyDict>) -> PyResult<bool> {
    let mut simulation = create(title)?;
    simulation
        .reset(&object("parameters", parameters)?)
        .map_err(input)?;
    Ok(simulation.acting().is_empty() && !simulation.done())
}

/// Runs the code of a simulation; its failure becomes an error.
pub fn catch_panic<T>(call: impl FnOnce() -> T) -> PyResult<T> {
    guarded(call).map_err(|failure| engine(failure.reason))
}

fn controller(text: &str) -> PyResult<Controller> {
    Specification::from_json(text)
        .map(|specification| Controller::new(&specification))
        .map_err(input)
}

/// Agents, their sensors and their actuators, a row for each time that an agent acted.
pub type Observed<'py> = (
    Bound<'py, PyArray1<u32>>,
    Bound<'py, PyArray2<f32>>,
    Bound<'py, PyArray2<f32>>,
);

/// One episode, step by step.
#[pyclass(name = "Episode", module = "swarmwright._engine", unsendable)]
pub struct PyEpisode(worlds::Episode);

#[pymethods]
impl PyEpisode {
    #[new]
    #[pyo3(signature = (simulation, parameters, controller))]
    fn new(
        simulation: &Bound<'_, PyAny>,
        parameters: &Bound<'_, PyDict>,
        controller: &str,
    ) -> PyResult<Self> {
        let simulation = any(simulation)?;
        let controller = self::controller(controller)?;
        let parameters = object("parameters", parameters)?;
        catch_panic(|| worlds::Episode::new(simulation, &parameters, &controller))?
            .map(Self)
            .map_err(input)
    }

    #[getter]
    fn done(&self) -> bool {
        self.0.done()
    }

    #[getter]
    fn fitness(&self) -> PyResult<f64> {
        catch_panic(|| self.0.simulation().fitness())
    }

    fn metrics(&self, names: Vec<String>) -> PyResult<Vec<f64>> {
        let simulation = self.0.simulation();
        let indices = simulation
            .description()
            .metrics_named(&names)
            .map_err(input)?;
        let mut values = vec![f64::NAN; indices.len()];
        catch_panic(|| worlds::measure(simulation, &indices, &mut values))?;
        Ok(values)
    }

    #[getter]
    fn metric_names(&self) -> Vec<String> {
        let metrics = self.0.simulation().description().metrics;
        metrics
            .iter()
            .map(|metric| metric.name.to_string())
            .collect()
    }

    #[getter]
    fn step_size(&self) -> f64 {
        std::time::Duration::from_millis(self.0.simulation().step_size()).as_secs_f64()
    }

    fn step(&mut self) -> PyResult<()> {
        catch_panic(|| self.0.step())?.map_err(engine)
    }

    fn step_observed<'py>(&mut self, py: Python<'py>) -> PyResult<Observed<'py>> {
        let description = self.0.simulation().description();
        let widths = [description.sensors, description.actuators];
        let (mut agents, mut sensed, mut done) = (Vec::new(), Vec::new(), Vec::new());
        catch_panic(|| {
            self.0.step_observed(|agent, sensors, actuators| {
                agents.push(agent);
                sensed.extend_from_slice(sensors);
                done.extend_from_slice(actuators);
            })
        })?
        .map_err(engine)?;
        observed(py, widths, agents, sensed, done)
    }

    fn scene<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        scene(py, self.0.simulation())
    }

    fn scene_arrays<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        scene_arrays(py, self.0.simulation())
    }

    fn machine_states<'py>(&self, py: Python<'py>) -> Option<Bound<'py, PyArray1<i32>>> {
        Some(self.0.machine_states()?.into_pyarray(py))
    }

    #[pyo3(signature = (columns, color, rows=24, unicode=true))]
    fn text(&self, columns: usize, color: bool, rows: usize, unicode: bool) -> PyResult<String> {
        text(self.0.simulation(), columns, color, rows, unicode)
    }
}

fn shown(simulation: &dyn Simulation) -> PyResult<worlds::Scene> {
    catch_panic(|| simulation.scene())?.ok_or_else(|| engine("this simulation has nothing to show"))
}

/// What a simulation looks like, as plain values.
pub fn scene<'py>(py: Python<'py>, simulation: &dyn Simulation) -> PyResult<Bound<'py, PyAny>> {
    to_python(py, &shown(simulation)?)
}

/// The same with arrays.
pub fn scene_arrays<'py>(
    py: Python<'py>,
    simulation: &dyn Simulation,
) -> PyResult<Bound<'py, PyDict>> {
    arrays_of(py, shown(simulation)?)
}

/// The same as text.
pub fn text(
    simulation: &dyn Simulation,
    columns: usize,
    color: bool,
    rows: usize,
    unicode: bool,
) -> PyResult<String> {
    let style = worlds::TextStyle {
        columns,
        rows,
        color,
        unicode,
    };
    shown(simulation).map(|scene| worlds::render(&scene, style).join("\n"))
}

/// What agents sensed and did, as arrays; widths: sensors and actuators of each.
pub fn observed<'py>(
    py: Python<'py>,
    widths: [usize; 2],
    agents: Vec<u32>,
    sensed: Vec<f32>,
    done: Vec<f32>,
) -> PyResult<Observed<'py>> {
    let rows = agents.len();
    Ok((
        agents.into_pyarray(py),
        sensed.into_pyarray(py).reshape([rows, widths[0]])?,
        done.into_pyarray(py).reshape([rows, widths[1]])?,
    ))
}

/// A scene with what it has many of as arrays.
pub fn arrays_of<'py>(py: Python<'py>, mut scene: worlds::Scene) -> PyResult<Bound<'py, PyDict>> {
    let bodies = arrays::bodies(py, &std::mem::take(&mut scene.bodies))?;
    let rays = arrays::rays(py, &std::mem::take(&mut scene.rays))?;
    let links = arrays::links(py, &std::mem::take(&mut scene.links))?;
    let fields = PyDict::new(py);
    fields.set_item("scene", to_python(py, &scene)?)?;
    fields.set_item("bodies", bodies)?;
    fields.set_item("rays", rays)?;
    fields.set_item("links", links)?;
    Ok(fields)
}
