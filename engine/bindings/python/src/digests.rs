//! SHA-256 of the columns of a generation, computed by another thread.

use std::sync::Mutex;
use std::sync::mpsc::{Receiver, channel};

use numpy::{PyReadonlyArray1, PyReadonlyArray2, PyReadonlyArray3};
use pyo3::prelude::*;
use pyo3::types::PyBytes;
use sha2::{Digest, Sha256};
use swarmwright_protocol::Sample;

use crate::errors::engine;
use crate::local::lock;
use crate::methods::StoredGenomes;
use crate::sample;
use crate::threads;

/// Of fitness, episodes, metrics and genomes.
pub type Columns = [[u8; 32]; 4];

/// Digests of columns, perhaps still under way.
#[pyclass(name = "Digests", module = "swarmwright._engine", frozen)]
pub struct PyDigests(Mutex<State>);

enum State {
    Known(Columns),
    Coming(Receiver<Columns>),
}

impl PyDigests {
    /// Digests that are known.
    pub fn known(columns: Columns) -> Self {
        Self(Mutex::new(State::Known(columns)))
    }
}

#[pymethods]
impl PyDigests {
    #[new]
    #[expect(
        clippy::needless_pass_by_value,
        reason = "pyo3 hands arguments over by value"
    )]
    fn new(
        fitness: PyReadonlyArray1<'_, f64>,
        episodes: PyReadonlyArray2<'_, f64>,
        metrics: PyReadonlyArray3<'_, f64>,
        genomes: StoredGenomes<'_>,
    ) -> PyResult<Self> {
        // One representation of each value: NaN has many, and zero has two.
        let canonical = |value: &f64| {
            if value.is_nan() {
                f64::NAN
            } else {
                value + 0.0
            }
        };
        let fitness: Vec<f64> = fitness.as_array().iter().map(canonical).collect();
        let episodes: Vec<f64> = episodes.as_array().iter().copied().collect();
        let metrics: Vec<f64> = metrics.as_array().iter().copied().collect();
        let genomes = match genomes {
            StoredGenomes::Sample(sample) => Genes::Sample(of_sample(&sample.get().0)?),
            StoredGenomes::Genomes(genomes) => {
                Genes::Genomes(genomes.as_array().iter().copied().collect())
            }
        };
        threads::start()?;
        let (send, receive) = channel();
        rayon::spawn(move || {
            // If the run has ended meanwhile, the receiver is dropped and the digest is not needed.
            let genomes = match genomes {
                Genes::Sample(digest) => digest,
                Genes::Genomes(genomes) => of_genomes(&genomes),
            };
            let _ = send.send(columns(&fitness, &episodes, &metrics, genomes));
        });
        Ok(Self(Mutex::new(State::Coming(receive))))
    }

    fn columns<'py>(&self, py: Python<'py>) -> PyResult<[Bound<'py, PyBytes>; 4]> {
        let digests = py.detach(|| {
            let mut state = lock(&self.0);
            let columns = match &*state {
                State::Known(columns) => *columns,
                State::Coming(receiver) => receiver.recv().map_err(engine)?,
            };
            *state = State::Known(columns);
            Ok::<Columns, PyErr>(columns)
        })?;
        Ok(digests.map(|digest| PyBytes::new(py, &digest)))
    }
}

/// Genomes, or the digest of the sample that they are made from.
enum Genes {
    Genomes(Vec<f32>),
    Sample([u8; 32]),
}

/// SHA-256 of the columns, little-endian as in the store, and that of the genomes.
pub fn columns(fitness: &[f64], episodes: &[f64], metrics: &[f64], genomes: [u8; 32]) -> Columns {
    let of_doubles = |numbers| digest(numbers, f64::to_le_bytes);
    [
        of_doubles(fitness),
        of_doubles(episodes),
        of_doubles(metrics),
        genomes,
    ]
}

/// SHA-256 of genomes, little-endian.
pub fn of_genomes(genomes: &[f32]) -> [u8; 32] {
    digest(genomes, f32::to_le_bytes)
}

/// SHA-256 of what genomes are made from, as the store has it.
pub fn of_sample(sample: &Sample) -> PyResult<[u8; 32]> {
    let mut total = Sha256::new();
    total.update(sample::address(sample)?);
    total.update(sample::numbers(sample));
    Ok(total.finalize().into())
}

/// Numbers whose bytes are put in order together.
const AT_A_TIME: usize = 1 << 10;

fn digest<T: Copy, const N: usize>(numbers: &[T], bytes: impl Fn(T) -> [u8; N]) -> [u8; 32] {
    let mut total = Sha256::new();
    let mut part = [[0; N]; AT_A_TIME];
    for numbers in numbers.chunks(AT_A_TIME) {
        // A loop without growth is one that the compiler does in vectors.
        for (slot, number) in part.iter_mut().zip(numbers) {
            *slot = bytes(*number);
        }
        total.update(part[..numbers.len()].as_flattened());
    }
    total.finalize().into()
}
