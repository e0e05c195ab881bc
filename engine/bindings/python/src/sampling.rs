//! Functions of numbers, and what fitness is worth among others.
#![expect(
    clippy::needless_pass_by_value,
    reason = "pyo3 hands arguments over by value"
)]

use numpy::{IntoPyArray, PyArray1, PyReadonlyArray1};
use pyo3::prelude::*;
use swarmwright_evolution as evolution;

#[pyfunction]
pub fn exp<'py>(
    py: Python<'py>,
    values: PyReadonlyArray1<'py, f64>,
) -> PyResult<Bound<'py, PyArray1<f64>>> {
    of_each(py, &values, evolution::exp)
}

#[pyfunction]
pub fn log<'py>(
    py: Python<'py>,
    values: PyReadonlyArray1<'py, f64>,
) -> PyResult<Bound<'py, PyArray1<f64>>> {
    of_each(py, &values, evolution::log)
}

#[pyfunction]
pub fn centered_ranks<'py>(
    py: Python<'py>,
    fitness: PyReadonlyArray1<'py, f64>,
) -> PyResult<Bound<'py, PyArray1<f64>>> {
    Ok(evolution::centered_ranks(fitness.as_slice()?).into_pyarray(py))
}

#[pyfunction]
pub fn utilities<'py>(
    py: Python<'py>,
    fitness: PyReadonlyArray1<'py, f64>,
) -> PyResult<Bound<'py, PyArray1<f64>>> {
    Ok(evolution::utilities(fitness.as_slice()?).into_pyarray(py))
}

fn of_each<'py>(
    py: Python<'py>,
    values: &PyReadonlyArray1<'py, f64>,
    function: fn(f64) -> f64,
) -> PyResult<Bound<'py, PyArray1<f64>>> {
    let results: Vec<f64> = values.as_slice()?.iter().copied().map(function).collect();
    Ok(results.into_pyarray(py))
}
