//! Work from Python: a controller specification and an array of genomes.

use numpy::{PyReadonlyArray2, PyUntypedArrayMethods};
use pyo3::prelude::*;
use swarmwright_controllers::Architecture;
use swarmwright_pool::Work;

use crate::errors::input;

/// Checked work of an architecture (specification as JSON), genomes (candidates, weights) and the episodes' seeds.
pub fn work(
    architecture: &str,
    genomes: &PyReadonlyArray2<'_, f32>,
    seeds: Vec<u64>,
) -> PyResult<Work> {
    let weights = Architecture::from_json(architecture)
        .map_err(input)?
        .weight_count();
    let columns = genomes.shape()[1];
    if columns != weights {
        return Err(input(format!(
            "genomes: have {columns} weights each, but these controllers have {weights}"
        )));
    }
    let flat = match genomes.as_slice() {
        Ok(rows) => rows.to_vec(),
        Err(_) => genomes.as_array().iter().copied().collect(),
    };
    Work::new(architecture, flat, seeds).map_err(input)
}
