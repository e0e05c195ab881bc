//! Controllers.

use numpy::{IntoPyArray, PyArray1, PyReadonlyArray1};
use pyo3::prelude::*;
use pyo3::types::PyDict;
use swarmwright_controllers::{Controller, Specification};

use crate::errors::input;
use crate::genomes::architecture;
use crate::values::dict;

/// Inference of one controller.
#[pyclass(name = "Controller", module = "swarmwright._engine")]
pub struct PyController(Controller);

#[pymethods]
impl PyController {
    #[new]
    fn new(specification: &str) -> PyResult<Self> {
        Specification::from_json(specification)
            .map(|specification| Self(Controller::new(&specification)))
            .map_err(input)
    }

    #[getter]
    fn sensors(&self) -> usize {
        self.0.sensors()
    }

    #[getter]
    fn actuators(&self) -> usize {
        self.0.actuators()
    }

    /// The controller of an agent of a team; of another controller, one at the start of an episode.
    fn of_agent(&self, agent: u32) -> PyResult<Self> {
        self.0.of_agent(agent).map(Self).map_err(input)
    }

    /// Values of a parameter set by their names.
    #[getter]
    fn parameters<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        dict(py, &self.0.parameters())
    }

    fn reset(&mut self) {
        self.0.reset();
    }

    #[expect(
        clippy::needless_pass_by_value,
        reason = "pyo3 hands arguments over by value"
    )]
    fn step<'py>(
        &mut self,
        py: Python<'py>,
        sensors: PyReadonlyArray1<'py, f32>,
    ) -> PyResult<Bound<'py, PyArray1<f32>>> {
        let mut actuators = vec![0.0; self.0.actuators()];
        let sensors: Vec<f32> = sensors.as_array().iter().copied().collect();
        self.0.step(&sensors, &mut actuators).map_err(input)?;
        Ok(actuators.into_pyarray(py))
    }
}

/// Number of weights that controllers of an architecture need.
#[pyfunction]
pub fn genome_size(architecture: &Bound<'_, PyDict>) -> PyResult<usize> {
    let (architecture, _) = self::architecture(architecture)?;
    Ok(architecture.weight_count())
}
