//! What candidates' episodes come to, and what a population looks like.
#![expect(
    clippy::needless_pass_by_value,
    reason = "pyo3 hands arguments over by value"
)]

use numpy::{PyArray1, PyReadonlyArray1, PyReadonlyArray2, PyUntypedArrayMethods};
use pyo3::prelude::*;
use swarmwright_evolution::{Aggregate, Figures, Outcome};

use crate::errors::input;

/// One number for each row of results.
#[pyfunction]
pub fn aggregates<'py>(
    py: Python<'py>,
    results: PyReadonlyArray2<'py, f64>,
    aggregate: &str,
    level: f64,
) -> PyResult<Bound<'py, PyArray1<f64>>> {
    let aggregate = self::aggregate(aggregate, level)?;
    if results.shape()[1] == 0 {
        return Err(input("results: expected at least one for each candidate"));
    }
    let rows = results.as_slice()?.to_vec();
    Ok(PyArray1::from_vec(
        py,
        aggregate.of_rows(rows, results.shape()[1]),
    ))
}

/// Best, mean, lower quartile, median and upper quartile.
#[pyfunction]
pub fn figures(fitness: PyReadonlyArray1<'_, f64>) -> PyResult<(f64, f64, f64, f64, f64)> {
    let figures = Figures::of(fitness.as_slice()?);
    Ok((
        figures.best,
        figures.mean,
        figures.lower_quartile,
        figures.median,
        figures.upper_quartile,
    ))
}

/// Returns the best candidate and the number of failures.
#[pyfunction]
pub fn outcome(fitness: PyReadonlyArray1<'_, f64>) -> PyResult<(usize, usize)> {
    let outcome = Outcome::of(fitness.as_slice()?);
    Ok((outcome.leader, outcome.failed))
}

/// By its name in experiments.
pub fn aggregate(name: &str, level: f64) -> PyResult<Aggregate> {
    Ok(match name {
        "mean" => Aggregate::Mean,
        "sum" => Aggregate::Sum,
        "median" => Aggregate::Median,
        "worst" => Aggregate::Worst,
        "quantile" => Aggregate::Quantile(level),
        "cvar" => Aggregate::WorstShare(level),
        other => return Err(input(format!("aggregate: unknown: {other}"))),
    })
}
