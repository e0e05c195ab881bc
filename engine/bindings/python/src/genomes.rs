//! Work from Python: a controller specification and an array of genomes.

use std::borrow::Cow;

use numpy::{PyReadonlyArray2, PyUntypedArrayMethods};
use pyo3::prelude::*;
use pyo3::types::PyDict;
use serde_json::{Map, Value};
use swarmwright_controllers::Architecture;
use swarmwright_pool::Work;

use crate::errors::input;
use crate::evolution::row_major;
use crate::values::object;

/// The numbers of an array (candidates, weights) in row-major order, copied only if its memory has another order.
pub fn rows<'a>(
    architecture: &Architecture,
    genomes: &'a PyReadonlyArray2<'_, f32>,
) -> PyResult<Cow<'a, [f32]>> {
    let weights = architecture.weight_count();
    let columns = genomes.shape()[1];
    if columns != weights {
        return Err(input(format!(
            "genomes: have {columns} weights each, but these controllers have {weights}"
        )));
    }
    Ok(row_major(genomes))
}

/// An architecture from Python, a specification whose weights are ignored; and what was given.
pub fn architecture(
    controller: &Bound<'_, PyDict>,
) -> PyResult<(Architecture, Map<String, Value>)> {
    let specification = object("controller", controller)?;
    let text = serde_json::to_string(&specification).map_err(input)?;
    let read = Architecture::from_json(&text).map_err(input)?;
    Ok((read, specification))
}

/// Checked work of an architecture, genomes (candidates, weights) and the episodes' seeds.
pub fn work(
    architecture: &Bound<'_, PyDict>,
    genomes: &PyReadonlyArray2<'_, f32>,
    seeds: Vec<u64>,
) -> PyResult<Work> {
    let (read, specification) = self::architecture(architecture)?;
    let rows = rows(&read, genomes)?.into_owned();
    Work::of(read, specification, rows, seeds).map_err(input)
}

/// Each row as text: the shortest decimals that read back as the same binary32, with commas between.
#[pyfunction]
#[expect(
    clippy::needless_pass_by_value,
    reason = "pyo3 hands arguments over by value"
)]
pub fn decimals(genomes: PyReadonlyArray2<'_, f32>) -> PyResult<Vec<String>> {
    genomes
        .as_array()
        .rows()
        .into_iter()
        .map(|row| {
            let numbers: Vec<f32> = row.iter().copied().collect();
            if numbers.iter().any(|number| !number.is_finite()) {
                return Err(input(
                    "genomes: every gene must be a finite number, not NaN or infinite",
                ));
            }
            let text = serde_json::to_string(&numbers).map_err(input)?;
            Ok(text.trim_matches(['[', ']']).to_owned())
        })
        .collect()
}
