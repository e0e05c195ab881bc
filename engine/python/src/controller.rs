//! Controllers.

use numpy::{IntoPyArray, PyArray1, PyReadonlyArray1};
use pyo3::prelude::*;
use serde_json::Value;
use swarmwright_controllers::{Architecture, Controller, Specification};

use crate::errors::input;

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

    /// Values of a parameter set, as a JSON object.
    #[getter]
    fn parameters(&self) -> String {
        Value::from(self.0.parameters()).to_string()
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

/// Number of weights that a specification needs.
#[pyfunction]
pub fn genome_size(specification: &str) -> PyResult<usize> {
    Architecture::from_json(specification)
        .map(|architecture| architecture.weight_count())
        .map_err(input)
}
