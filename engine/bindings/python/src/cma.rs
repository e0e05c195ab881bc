//! Searches by covariance matrix adaptation.
#![expect(
    clippy::needless_pass_by_value,
    reason = "pyo3 hands arguments over by value"
)]

use numpy::{
    IntoPyArray, PyArray1, PyArray2, PyArrayMethods, PyReadonlyArray1, PyUntypedArrayMethods,
};
use pyo3::prelude::*;
use swarmwright_evolution::{Cma, Start, Stop};

use crate::errors::input;
use crate::streams::PyStreams;

/// A search: what it knows, and whether its last sample is to be told.
#[pyclass(name = "Cma", module = "swarmwright._engine")]
pub struct PyCma {
    search: Cma,
    genes: usize,
    asked: bool,
}

#[pymethods]
impl PyCma {
    #[new]
    #[pyo3(signature = (center, *, reach, lower, upper, step, population, separable))]
    fn new(
        center: PyReadonlyArray1<'_, f64>,
        reach: PyReadonlyArray1<'_, f64>,
        lower: PyReadonlyArray1<'_, f64>,
        upper: PyReadonlyArray1<'_, f64>,
        step: f64,
        population: usize,
        separable: bool,
    ) -> PyResult<Self> {
        let genes = center.len();
        if genes == 0 || population < 3 {
            return Err(input(format!(
                "expected at least one gene and a population of 3, found {genes} and {population}"
            )));
        }
        if [&reach, &lower, &upper]
            .iter()
            .any(|row| row.len() != genes)
        {
            return Err(input(format!(
                "expected {genes} values for each of center, reach, lower and upper"
            )));
        }
        let search = Cma::new(Start {
            center: center.as_slice()?,
            reach: reach.as_slice()?,
            lower: lower.as_slice()?,
            upper: upper.as_slice()?,
            step,
            population,
            separable,
        });
        Ok(Self {
            search,
            genes,
            asked: false,
        })
    }

    fn ask<'py>(
        &mut self,
        py: Python<'py>,
        mut streams: PyRefMut<'py, PyStreams>,
    ) -> PyResult<Bound<'py, PyArray2<f32>>> {
        let population = self.search.population();
        if streams.0.len() != population {
            let count = streams.0.len();
            return Err(input(format!(
                "streams: {count} found, expected {population}, one for each genome"
            )));
        }
        let mut genomes = vec![0.0; population * self.genes];
        let streams = &mut streams.0;
        py.detach(|| self.search.ask(streams, &mut genomes));
        self.asked = true;
        PyArray1::from_vec(py, genomes).reshape([population, self.genes])
    }

    fn tell(
        &mut self,
        py: Python<'_>,
        fitness: PyReadonlyArray1<'_, f64>,
    ) -> PyResult<Option<&'static str>> {
        let population = self.search.population();
        if !self.asked || fitness.len() != population {
            return Err(input(format!(
                "fitness: expected {population} values, one for each genome of the last ask"
            )));
        }
        self.asked = false;
        let fitness = fitness.as_slice()?;
        Ok(py.detach(|| self.search.tell(fitness)).map(Stop::name))
    }

    #[getter]
    fn sigma(&self) -> f64 {
        self.search.sigma()
    }

    #[getter]
    fn mean<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        PyArray1::from_slice(py, self.search.mean())
    }

    #[getter]
    fn units<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        PyArray1::from_slice(py, self.search.units())
    }

    #[getter]
    fn step_path<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        PyArray1::from_slice(py, self.search.step_path())
    }

    #[getter]
    fn covariance_path<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        PyArray1::from_slice(py, self.search.covariance_path())
    }

    #[getter]
    fn covariance<'py>(&self, py: Python<'py>) -> PyResult<Option<Bound<'py, PyArray2<f64>>>> {
        let matrix = self.search.covariance();
        matrix
            .map(|rows| rows.to_vec().into_pyarray(py).reshape([self.genes; 2]))
            .transpose()
    }
}
