//! What comes out of evaluations, as numpy arrays.

use numpy::{PyArray1, PyArray2, PyArray3, PyArrayMethods};
use pyo3::prelude::*;

/// (candidates, episodes)
pub type Fitness<'py> = Bound<'py, PyArray2<f64>>;
/// (candidates, episodes, metrics)
pub type Metrics<'py> = Bound<'py, PyArray3<f64>>;

/// Fitness and metrics, row-major, as arrays.
pub fn arrays(
    py: Python<'_>,
    fitness: Vec<f64>,
    metrics: Vec<f64>,
    [candidates, episodes, count]: [usize; 3],
) -> PyResult<(Fitness<'_>, Metrics<'_>)> {
    Ok((
        PyArray1::from_vec(py, fitness).reshape([candidates, episodes])?,
        PyArray1::from_vec(py, metrics).reshape([candidates, episodes, count])?,
    ))
}

/// Fitness and metrics of results in which each fitness is followed by its metrics, `numbers` in all.
pub fn apart(results: Vec<f64>, numbers: usize) -> (Vec<f64>, Vec<f64>) {
    if numbers == 1 {
        return (results, Vec::new());
    }
    let rows = || results.chunks_exact(numbers);
    (
        rows().map(|row| row[0]).collect(),
        rows().flat_map(|row| &row[1..]).copied().collect(),
    )
}
