//! Samples of evolution strategies, and the matrices that they are learnt with.
#![expect(
    clippy::needless_pass_by_value,
    reason = "pyo3 hands arguments over by value"
)]

use numpy::{
    IntoPyArray, PyArray1, PyArray2, PyArrayMethods, PyReadonlyArray1, PyReadonlyArray2,
    PyUntypedArrayMethods,
};
use pyo3::prelude::*;
use rayon::prelude::*;
use swarmwright_evolution::{self as evolution, Scale};

use crate::errors::input;

/// Numbers of samples that are made in less time than another thread takes to begin.
const FEW: usize = 16384;

#[pyfunction]
#[pyo3(signature = (directions, center, deviation, *, middle, reach, lower, upper, mirrored))]
#[expect(
    clippy::too_many_arguments,
    reason = "pyo3 hands arguments over one by one"
)]
pub fn samples<'py>(
    py: Python<'py>,
    directions: PyReadonlyArray2<'py, f64>,
    center: PyReadonlyArray1<'py, f64>,
    deviation: PyReadonlyArray1<'py, f64>,
    middle: PyReadonlyArray1<'py, f64>,
    reach: PyReadonlyArray1<'py, f64>,
    lower: PyReadonlyArray1<'py, f64>,
    upper: PyReadonlyArray1<'py, f64>,
    mirrored: bool,
) -> PyResult<Bound<'py, PyArray2<f32>>> {
    let [count, genes] = shape(&directions);
    let rows = [&center, &deviation, &middle, &reach, &lower, &upper];
    if rows.iter().any(|row| row.len() != genes) {
        return Err(input(format!(
            "expected {genes} values for each of center, deviation, middle, reach, lower and upper"
        )));
    }
    let count = if mirrored { 2 * count } else { count };
    let mut genomes = vec![0.0; count * genes];
    let scale = Scale {
        middle: middle.as_slice()?,
        reach: reach.as_slice()?,
        lower: lower.as_slice()?,
        upper: upper.as_slice()?,
    };
    let (directions, center) = (directions.as_slice()?, center.as_slice()?);
    let deviation = deviation.as_slice()?;
    py.detach(|| {
        if genomes.is_empty() {
            return;
        }
        let rows = FEW.div_ceil(genes) * genes;
        let each = if mirrored { 2 } else { 1 };
        directions
            .par_chunks(rows)
            .zip(genomes.par_chunks_mut(each * rows))
            .for_each(|(directions, genomes)| {
                evolution::samples(directions, center, deviation, scale, mirrored, genomes);
            });
    });
    PyArray1::from_vec(py, genomes).reshape([count, genes])
}

#[pyfunction]
pub fn weighted_sum<'py>(
    py: Python<'py>,
    rows: PyReadonlyArray2<'py, f64>,
    weights: PyReadonlyArray1<'py, f64>,
) -> PyResult<Bound<'py, PyArray1<f64>>> {
    let [count, genes] = shape(&rows);
    one_each(&weights, count)?;
    let mut sum = vec![0.0; genes];
    let (rows, weights) = (rows.as_slice()?, weights.as_slice()?);
    py.detach(|| evolution::add_weighted(rows, weights, &mut sum));
    Ok(sum.into_pyarray(py))
}

#[pyfunction]
pub fn weighted_products<'py>(
    py: Python<'py>,
    rows: PyReadonlyArray2<'py, f64>,
    weights: PyReadonlyArray1<'py, f64>,
) -> PyResult<Bound<'py, PyArray2<f64>>> {
    let [count, genes] = shape(&rows);
    one_each(&weights, count)?;
    let mut sum = vec![0.0; genes * genes];
    let (rows, weights) = (rows.as_slice()?, weights.as_slice()?);
    py.detach(|| evolution::add_weighted_products(rows, weights, &mut sum));
    PyArray1::from_vec(py, sum).reshape([genes, genes])
}

#[pyfunction]
pub fn matrix_product<'py>(
    py: Python<'py>,
    left: PyReadonlyArray2<'py, f64>,
    right: PyReadonlyArray2<'py, f64>,
) -> PyResult<Bound<'py, PyArray2<f64>>> {
    let [rows, inner] = shape(&left);
    let [size, columns] = shape(&right);
    if size != columns || inner != size {
        return Err(input(format!(
            "expected rows of n numbers and a matrix of n rows and columns; found ({rows}, {inner}) and ({size}, {columns})"
        )));
    }
    let (left, right) = (left.as_slice()?, right.as_slice()?);
    let result = py.detach(|| evolution::product(left, right, size));
    PyArray1::from_vec(py, result).reshape([rows, size])
}

#[pyfunction]
pub fn matrix_exponential<'py>(
    py: Python<'py>,
    matrix: PyReadonlyArray2<'py, f64>,
) -> PyResult<Option<Bound<'py, PyArray2<f64>>>> {
    let [size, columns] = shape(&matrix);
    if size != columns {
        return Err(input(format!(
            "expected as many rows as columns, found ({size}, {columns})"
        )));
    }
    let values = matrix.as_slice()?;
    py.detach(|| evolution::exponential(values, size))
        .map(|result| PyArray1::from_vec(py, result).reshape([size, size]))
        .transpose()
}

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

/// Rows and columns.
fn shape(array: &PyReadonlyArray2<'_, f64>) -> [usize; 2] {
    [array.shape()[0], array.shape()[1]]
}

fn one_each(weights: &PyReadonlyArray1<'_, f64>, rows: usize) -> PyResult<()> {
    if weights.len() == rows {
        return Ok(());
    }
    Err(input(format!(
        "weights: {} values for {rows} rows",
        weights.len()
    )))
}
