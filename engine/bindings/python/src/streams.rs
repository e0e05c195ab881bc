//! Random numbers by counter.

use std::ops::Range;

use numpy::{
    IntoPyArray, PyArray1, PyArray2, PyArrayMethods, PyReadonlyArray1, PyUntypedArrayMethods,
};
use pyo3::exceptions::{PyIndexError, PyOverflowError};
use pyo3::prelude::*;
use pyo3::types::{PyIterator, PyList, PyRange, PyRangeMethods};
use swarmwright_evolution as evolution;

use crate::errors::input;

/// Random numbers with an address of their own.
#[pyclass(name = "Stream", module = "swarmwright._engine")]
pub struct PyStream(pub evolution::Stream);

#[pymethods]
impl PyStream {
    #[new]
    #[pyo3(signature = (seed, purpose, generation=0, candidate=0))]
    fn new(seed: u64, purpose: &str, generation: u64, candidate: u64) -> Self {
        let key = evolution::purpose_key(purpose);
        Self(evolution::Stream::new(seed, key, generation, candidate))
    }

    fn raw<'py>(&mut self, py: Python<'py>, count: usize) -> Bound<'py, PyArray1<u64>> {
        let mut words = vec![0; count];
        self.0.fill(&mut words);
        words.into_pyarray(py)
    }

    fn unit<'py>(&mut self, py: Python<'py>, count: usize) -> Bound<'py, PyArray1<f64>> {
        let units: Vec<f64> = (0..count).map(|_| self.0.unit()).collect();
        units.into_pyarray(py)
    }

    #[expect(
        clippy::needless_pass_by_value,
        reason = "pyo3 hands arguments over by value"
    )]
    fn uniform<'py>(
        &mut self,
        py: Python<'py>,
        border: PyReadonlyArray1<'py, f64>,
    ) -> Bound<'py, PyArray1<f64>> {
        let numbers: Vec<f64> = border
            .as_array()
            .iter()
            .map(|border| self.0.uniform(*border))
            .collect();
        numbers.into_pyarray(py)
    }

    fn normals<'py>(&mut self, py: Python<'py>, count: usize) -> Bound<'py, PyArray1<f64>> {
        let mut numbers: Vec<f64> = vec![0.0; count];
        self.0.normals(&mut numbers);
        numbers.into_pyarray(py)
    }

    fn integer(&mut self, below: u128) -> PyResult<u64> {
        Ok(self.0.integer(limit(below)?))
    }

    fn integers(&mut self, below: u128, count: usize) -> PyResult<Vec<u64>> {
        let below = limit(below)?;
        let mut drawn = vec![0; count];
        self.0.integers(below, &mut drawn);
        Ok(drawn)
    }
}

/// The number of integers to draw from, 1 to 2^64; 0 encodes 2^64.
fn limit(below: u128) -> PyResult<u64> {
    if !(1..=1 << 64).contains(&below) {
        return Err(input(format!(
            "below: {below} found, expected 1 to 2**64: an integer is drawn from 0 to below - 1"
        )));
    }
    Ok(u64::try_from(below).unwrap_or(0))
}

/// Streams that differ in the candidate alone.
#[pyclass(name = "Streams", module = "swarmwright._engine")]
pub struct PyStreams(pub Vec<evolution::Stream>);

#[pymethods]
impl PyStreams {
    #[new]
    fn new(
        seed: u64,
        purpose: &str,
        generation: u64,
        candidates: &Bound<'_, PyAny>,
    ) -> PyResult<Self> {
        let key = evolution::purpose_key(purpose);
        let stream = |candidate| evolution::Stream::new(seed, key, generation, candidate);
        Ok(Self(numbers(candidates)?.into_iter().map(stream).collect()))
    }

    fn __len__(&self) -> usize {
        self.0.len()
    }

    fn __getitem__(&self, index: usize) -> PyResult<PyStream> {
        let stream = self.0.get(index).cloned().map(PyStream);
        stream.ok_or_else(|| {
            PyIndexError::new_err(format!(
                "stream {index} does not exist; there are {} streams",
                self.0.len()
            ))
        })
    }

    fn __iter__<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyIterator>> {
        PyList::new(
            py,
            self.0
                .iter()
                .cloned()
                .map(PyStream)
                .map(|stream| Py::new(py, stream))
                .collect::<PyResult<Vec<_>>>()?,
        )?
        .try_iter()
    }

    fn units<'py>(&mut self, py: Python<'py>, count: usize) -> PyResult<Bound<'py, PyArray2<f64>>> {
        self.drawn(py, count, evolution::Stream::units)
    }

    fn normals<'py>(
        &mut self,
        py: Python<'py>,
        count: usize,
    ) -> PyResult<Bound<'py, PyArray2<f64>>> {
        self.drawn(py, count, evolution::Stream::normals)
    }

    fn integers<'py>(
        &mut self,
        py: Python<'py>,
        below: Below<'_>,
        count: usize,
    ) -> PyResult<Bound<'py, PyArray2<i64>>> {
        let streams = self.0.len();
        let limits = below.each(streams)?;
        let mut drawn = vec![0; streams * count];
        let rows = drawn.chunks_exact_mut(count.max(1));
        for ((stream, below), row) in self.0.iter_mut().zip(limits).zip(rows) {
            stream.integers(below.cast_unsigned(), row);
        }
        let drawn: Vec<i64> = drawn.into_iter().map(u64::cast_signed).collect();
        PyArray1::from_vec(py, drawn).reshape([streams, count])
    }
}

impl PyStreams {
    /// (streams, count) numbers, rows made by `draw`; many of them on all processors.
    fn drawn<'py>(
        &mut self,
        py: Python<'py>,
        count: usize,
        draw: impl Fn(&mut evolution::Stream, &mut [f64]) + Sync,
    ) -> PyResult<Bound<'py, PyArray2<f64>>> {
        let streams = self.0.len();
        let mut drawn = vec![0.0; streams * count];
        py.detach(|| {
            evolution::rows(&mut self.0, &mut drawn, count, |_, stream, row| {
                draw(stream, row);
            });
        });
        PyArray1::from_vec(py, drawn).reshape([streams, count])
    }
}

/// The numbers of a sequence; ranges and arrays of int64 without making objects of them.
fn numbers(sequence: &Bound<'_, PyAny>) -> PyResult<Vec<u64>> {
    if let Some(range) = sequence.cast::<PyRange>().ok().and_then(ascending) {
        return Ok(range.collect());
    }
    if let Ok(array) = sequence.extract::<PyReadonlyArray1<'_, i64>>() {
        let mut numbers = Vec::with_capacity(array.len());
        for number in array.as_array() {
            let number = u64::try_from(*number);
            numbers.push(number.map_err(|error| PyOverflowError::new_err(error.to_string()))?);
        }
        return Ok(numbers);
    }
    sequence.extract()
}

/// The numbers of a range in steps of 1; None for another one, and for one whose ends an i64 does not hold.
fn ascending(range: &Bound<'_, PyRange>) -> Option<Range<u64>> {
    let (start, stop) = (range.start().ok()?, range.stop().ok()?.max(0));
    if range.step().ok()? != 1 {
        return None;
    }
    Some(u64::try_from(start).ok()?..u64::try_from(stop).ok()?)
}

/// How many integers to draw from, for all streams or for each.
#[derive(FromPyObject)]
pub enum Below<'py> {
    All(i64),
    Array(PyReadonlyArray1<'py, i64>),
    Each(Vec<i64>),
}

impl Below<'_> {
    /// The number for each stream.
    fn each(self, streams: usize) -> PyResult<Vec<i64>> {
        let limits = match self {
            Self::All(below) => vec![below; streams],
            Self::Array(limits) => limits.as_array().to_vec(),
            Self::Each(limits) => limits,
        };
        if limits.len() != streams {
            let count = limits.len();
            return Err(input(format!(
                "below: {count} numbers for {streams} streams"
            )));
        }
        match limits.iter().find(|below| **below < 1) {
            Some(wrong) => Err(input(format!(
                "below: {wrong} found, expected 1 to 2**63 - 1"
            ))),
            None => Ok(limits),
        }
    }
}
