//! What the candidates of a generation are made from: for servers, and for the store, which keeps it instead of genomes.

use numpy::{PyArray1, PyArray2, PyArrayMethods};
use pyo3::prelude::*;
use pyo3::types::PyBytes;
use serde::{Deserialize, Serialize};
use swarmwright_protocol::{F64s, NORMAL, Sample};
use swarmwright_wrapper::gaussian;

use crate::errors::input;

/// Rows of numbers for each gene.
const ROWS: usize = 6;

/// What the candidates of a generation are made from.
#[pyclass(name = "Sample", module = "swarmwright._engine", frozen)]
pub struct PySample(pub Sample);

/// All fields except the rows of numbers, in the order of the store.
#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct Address {
    distribution: String,
    seed: u64,
    purpose: String,
    generation: u64,
    count: u64,
    mirrored: bool,
}

/// All but the rows of numbers, as JSON.
pub fn address(sample: &Sample) -> PyResult<String> {
    let address = Address {
        distribution: sample.distribution.clone(),
        seed: sample.seed,
        purpose: sample.purpose.clone(),
        generation: sample.generation,
        count: sample.count,
        mirrored: sample.mirrored,
    };
    serde_json::to_string(&address).map_err(input)
}

/// The rows of numbers, little-endian.
pub fn numbers(sample: &Sample) -> Vec<u8> {
    let genes = sample.center.0.len();
    let mut bytes = vec![[0; size_of::<f64>()]; ROWS * genes];
    for (places, (_, row)) in bytes.chunks_exact_mut(genes.max(1)).zip(sample.rows()) {
        for (slot, number) in places.iter_mut().zip(row) {
            *slot = number.to_le_bytes();
        }
    }
    bytes.into_flattened()
}

/// The genomes that are made from it.
pub fn genomes_of(sample: &Sample) -> Vec<f32> {
    let candidates = usize::try_from(sample.count).unwrap_or(usize::MAX);
    let mut genomes = vec![0.0; candidates.saturating_mul(sample.center.0.len())];
    gaussian(sample).genomes_parallel(sample.first, &mut genomes);
    genomes
}

/// Whether it has fewer bytes than the genomes that are made from it.
pub fn is_shorter(sample: &Sample) -> bool {
    sample.count > (ROWS * size_of::<f64>() / size_of::<f32>()) as u64
}

#[pymethods]
impl PySample {
    /// A sample as stored.
    #[staticmethod]
    fn read(address: &str, numbers: &[u8]) -> PyResult<Self> {
        let header: Address = serde_json::from_str(address).map_err(input)?;
        if header.distribution != NORMAL {
            return Err(input(format!(
                "distribution: {:?} is unknown; expected {NORMAL}",
                header.distribution
            )));
        }
        if !numbers.len().is_multiple_of(ROWS * size_of::<f64>()) {
            return Err(input(format!(
                "numbers: {} bytes are not {ROWS} rows of binary64",
                numbers.len()
            )));
        }
        let numbers: Vec<f64> = numbers
            .as_chunks()
            .0
            .iter()
            .map(|bytes| f64::from_le_bytes(*bytes))
            .collect();
        let genes = numbers.len() / ROWS;
        let row = |index: usize| F64s(numbers[index * genes..][..genes].to_vec());
        let sample = Sample {
            distribution: header.distribution,
            seed: header.seed,
            purpose: header.purpose,
            generation: header.generation,
            first: 0,
            count: header.count,
            mirrored: header.mirrored,
            center: row(0),
            deviation: row(1),
            middle: row(2),
            reach: row(3),
            lower: row(4),
            upper: row(5),
        };
        match sample.problem() {
            Some(problem) => Err(input(problem)),
            None => Ok(Self(sample)),
        }
    }

    #[getter]
    fn address(&self) -> PyResult<String> {
        address(&self.0)
    }

    #[getter]
    fn numbers<'py>(&self, py: Python<'py>) -> Bound<'py, PyBytes> {
        PyBytes::new(py, &numbers(&self.0))
    }

    #[getter]
    fn is_shorter(&self) -> bool {
        is_shorter(&self.0)
    }

    #[getter]
    fn genes(&self) -> usize {
        self.0.center.0.len()
    }

    fn __len__(&self) -> PyResult<usize> {
        usize::try_from(self.0.count).map_err(input)
    }

    /// The genomes of `count` candidates from `first` on.
    fn genomes<'py>(
        &self,
        py: Python<'py>,
        first: u64,
        count: u64,
    ) -> PyResult<Bound<'py, PyArray2<f32>>> {
        let genes = self.genes();
        let end = first.checked_add(count).filter(|end| *end <= self.0.count);
        let candidates = end.and_then(|_| usize::try_from(count).ok());
        let numbers = candidates.and_then(|candidates| candidates.checked_mul(genes));
        let (Some(candidates), Some(numbers)) = (candidates, numbers) else {
            let all = self.0.count;
            return Err(input(format!(
                "candidates: {count} from {first} on requested, but there are {all}"
            )));
        };
        let genomes = py.detach(|| {
            let mut genomes = vec![0.0; numbers];
            gaussian(&self.0).genomes_parallel(first, &mut genomes);
            genomes
        });
        PyArray1::from_vec(py, genomes).reshape([candidates, genes])
    }
}
