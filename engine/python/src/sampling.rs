//! Samples of evolution strategies.

use numpy::{
    IntoPyArray, PyArray1, PyArray2, PyArrayMethods, PyReadonlyArray1, PyReadonlyArray2,
    PyUntypedArrayMethods,
};
use pyo3::prelude::*;
use swarmwright_evolution::{self as evolution, Scale};

use crate::errors::input;

#[pyfunction]
#[pyo3(signature = (directions, center, noise, *, middle, reach, lower, upper))]
#[expect(
    clippy::needless_pass_by_value,
    clippy::too_many_arguments,
    reason = "pyo3 hands arguments over by value, one by one"
)]
pub fn mirrored<'py>(
    py: Python<'py>,
    directions: PyReadonlyArray2<'py, f64>,
    center: PyReadonlyArray1<'py, f64>,
    noise: f64,
    middle: PyReadonlyArray1<'py, f64>,
    reach: PyReadonlyArray1<'py, f64>,
    lower: PyReadonlyArray1<'py, f64>,
    upper: PyReadonlyArray1<'py, f64>,
) -> PyResult<Bound<'py, PyArray2<f32>>> {
    let [pairs, genes] = *directions.shape() else {
        return Err(input("directions: expected two dimensions"));
    };
    let rows = [&center, &middle, &reach, &lower, &upper];
    if rows.iter().any(|row| row.len() != genes) {
        return Err(input(format!(
            "expected {genes} values for each of center, middle, reach, lower and upper"
        )));
    }
    let mut genomes = vec![0.0; 2 * pairs * genes];
    let scale = Scale {
        middle: middle.as_slice()?,
        reach: reach.as_slice()?,
        lower: lower.as_slice()?,
        upper: upper.as_slice()?,
    };
    let (directions, center) = (directions.as_slice()?, center.as_slice()?);
    py.detach(|| evolution::mirrored(directions, center, noise, scale, &mut genomes));
    PyArray1::from_vec(py, genomes).reshape([2 * pairs, genes])
}

#[pyfunction]
#[expect(
    clippy::needless_pass_by_value,
    reason = "pyo3 hands arguments over by value"
)]
pub fn weighted_sum<'py>(
    py: Python<'py>,
    rows: PyReadonlyArray2<'py, f64>,
    weights: PyReadonlyArray1<'py, f64>,
) -> PyResult<Bound<'py, PyArray1<f64>>> {
    let [count, genes] = *rows.shape() else {
        return Err(input("rows: expected two dimensions"));
    };
    if weights.len() != count {
        return Err(input(format!(
            "weights: {} values for {count} rows",
            weights.len()
        )));
    }
    let mut sum = vec![0.0; genes];
    let (rows, weights) = (rows.as_slice()?, weights.as_slice()?);
    py.detach(|| evolution::add_weighted(rows, weights, &mut sum));
    Ok(sum.into_pyarray(py))
}
