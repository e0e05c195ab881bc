//! Episodes on simulation servers, as they are shown.

use std::time::Duration;

use numpy::{IntoPyArray, PyArray1};
use pyo3::prelude::*;
use pyo3::types::PyDict;
use swarmwright_controllers::{Controller, Specification};
use swarmwright_pool::{SceneEpisode, SceneError, SceneOptions};
use swarmwright_protocol::Requirements;
use swarmwright_worlds::{self as worlds, Scene};
use swarmwright_wrapper::scenes::from_message;

use crate::account::settings;
use crate::errors::{LostError, engine, input, unconnected};
use crate::values::{object, to_python};
use crate::worlds::{Observed, arrays_of, observed};

/// Seconds for which a scene is seen where its server does not say.
const STEP_SECONDS: f64 = 0.25;

/// One episode on a server, step by step.
#[pyclass(name = "RemoteEpisode", module = "swarmwright._engine", unsendable)]
pub struct PyRemoteEpisode {
    /// None once it is closed.
    episode: Option<SceneEpisode>,
    widths: [usize; 2],
}

fn error(error: &SceneError) -> PyErr {
    match error {
        SceneError::Connect(error) => unconnected(error),
        SceneError::Topic(error) => input(error),
        SceneError::Lost(reason) => LostError::new_err(reason.clone()),
        SceneError::Impossible(reason) => engine(reason),
        SceneError::Interrupted => engine("interrupted"),
    }
}

/// Does what waits for messages; Ctrl-C ends it.
fn interruptible<T: Send>(
    py: Python<'_>,
    work: impl FnOnce(&mut dyn FnMut() -> bool) -> Result<T, SceneError> + Send,
) -> PyResult<T> {
    let mut raised = None;
    let done = py.detach(|| {
        work(&mut || {
            raised = Python::attach(|py| py.check_signals()).err();
            raised.is_none()
        })
    });
    match (raised, done) {
        (Some(raised), _) => Err(raised),
        (None, done) => done.map_err(|failed| error(&failed)),
    }
}

fn duration(name: &str, seconds: f64) -> PyResult<Duration> {
    Duration::try_from_secs_f64(seconds).map_err(|failed| input(format!("{name}: {failed}")))
}

#[pymethods]
impl PyRemoteEpisode {
    #[new]
    #[pyo3(signature = (broker, *, simulation, parameters, requirements, controller, prefix="", discovery=10.0, step=60.0))]
    #[expect(clippy::too_many_arguments, reason = "keywords in Python")]
    fn new(
        py: Python<'_>,
        broker: &str,
        simulation: String,
        parameters: &Bound<'_, PyDict>,
        requirements: &Bound<'_, PyDict>,
        controller: &str,
        prefix: &str,
        discovery: f64,
        step: f64,
    ) -> PyResult<Self> {
        let controller = Specification::from_json(controller)
            .map(|specification| Controller::new(&specification))
            .map_err(input)?;
        let requirements = Requirements::from_object(object("requirements", requirements)?)
            .map_err(|error| input(format!("requirements: {error}")))?;
        let widths = if controller.steers() {
            [controller.sensors(), controller.actuators()]
        } else {
            [0, 0]
        };
        let options = SceneOptions {
            settings: settings(broker, None)?,
            prefix: prefix.to_owned(),
            simulation,
            requirements,
            parameters: object("parameters", parameters)?,
            controller,
            discovery: duration("discovery", discovery)?,
            step: duration("step", step)?,
        };
        let episode = interruptible(py, |go_on| SceneEpisode::start(options, go_on))?;
        Ok(Self {
            episode: Some(episode),
            widths,
        })
    }

    #[getter]
    fn done(&self) -> PyResult<bool> {
        Ok(self.there()?.done())
    }

    #[getter]
    fn fitness(&self) -> PyResult<f64> {
        Ok(self.there()?.fitness())
    }

    #[getter]
    fn server(&self) -> PyResult<u64> {
        Ok(self.there()?.server())
    }

    #[getter]
    fn missing(&self) -> PyResult<u64> {
        Ok(self.there()?.missing())
    }

    fn metrics(&self, names: Vec<String>) -> PyResult<Vec<f64>> {
        let metrics = self.there()?.metrics();
        Ok((names.iter())
            .map(|name| metrics.get(name).copied().unwrap_or(f64::NAN))
            .collect())
    }

    #[getter]
    fn metric_names(&self) -> PyResult<Vec<String>> {
        Ok(self.there()?.metrics().keys().cloned().collect())
    }

    #[getter]
    fn step_size(&self) -> PyResult<f64> {
        Ok(self.there()?.scene().seconds.unwrap_or(STEP_SECONDS))
    }

    fn step(&mut self, py: Python<'_>) -> PyResult<()> {
        let episode = self.episode.as_mut().ok_or_else(closed)?;
        interruptible(py, |go_on| episode.step(&mut |_, _, _| (), go_on))
    }

    fn step_observed<'py>(&mut self, py: Python<'py>) -> PyResult<Observed<'py>> {
        let episode = self.episode.as_mut().ok_or_else(closed)?;
        let (mut agents, mut sensed, mut done) = (Vec::new(), Vec::new(), Vec::new());
        interruptible(py, |go_on| {
            let mut observe = |agent: u32, sensors: &[f32], actuators: &[f32]| {
                agents.push(agent);
                sensed.extend_from_slice(sensors);
                done.extend_from_slice(actuators);
            };
            episode.step(&mut observe, go_on)
        })?;
        observed(py, self.widths, agents, sensed, done)
    }

    fn scene<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        to_python(py, &self.shown()?)
    }

    fn scene_arrays<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        arrays_of(py, self.shown()?)
    }

    fn machine_states<'py>(&self, py: Python<'py>) -> PyResult<Option<Bound<'py, PyArray1<i32>>>> {
        let states = self.there()?.machine_states();
        Ok(states.map(|states| states.into_pyarray(py)))
    }

    #[pyo3(signature = (columns, color, rows=24, unicode=true))]
    fn text(&self, columns: usize, color: bool, rows: usize, unicode: bool) -> PyResult<String> {
        let style = worlds::TextStyle {
            columns,
            rows,
            color,
            unicode,
        };
        Ok(worlds::render(&self.shown()?, style).join("\n"))
    }

    fn close(&mut self, py: Python<'_>) {
        if let Some(episode) = self.episode.take() {
            py.detach(|| episode.close());
        }
    }
}

fn closed() -> PyErr {
    input("the episode is closed")
}

impl PyRemoteEpisode {
    fn there(&self) -> PyResult<&SceneEpisode> {
        self.episode.as_ref().ok_or_else(closed)
    }

    fn shown(&self) -> PyResult<Scene> {
        Ok(from_message(self.there()?.scene().clone()))
    }
}
