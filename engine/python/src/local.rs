//! Evaluation in this process.

use std::time::{Duration, Instant};

use numpy::PyReadonlyArray2;
use pyo3::prelude::*;
use pyo3::types::PyDict;
use swarmwright_lanes::Level;
use swarmwright_pool::{check_work, rectangle};
use swarmwright_worlds::{self as worlds, Block, Means, RolloutError};

use crate::errors::input;
use crate::genomes::{architecture, rows};
use crate::results::{Fitness, Metrics, apart, arrays};
use crate::values::object;
use crate::worlds::known;

/// Work between two looks at Ctrl-C.
const PART: Duration = Duration::from_millis(30);
/// Evaluations of the first part, which tells how long they take.
const FIRST: usize = 64;
/// Pause between two reports.
pub const REPORT: Duration = Duration::from_millis(100);

/// Instruction sets that this processor has.
#[pyfunction]
pub fn levels() -> Vec<&'static str> {
    let available = Level::available();
    std::iter::once("scalar")
        .chain(available.into_iter().map(Level::name))
        .collect()
}

fn means(level: &str, threads: usize) -> PyResult<Means> {
    let level = match level {
        "auto" => Some(Level::best()),
        "scalar" => None,
        name => match Level::available()
            .into_iter()
            .find(|one| one.name() == name)
        {
            Some(level) => Some(level),
            None => {
                return Err(input(format!(
                    "level: {name:?} is not available on this processor; expected one of auto, {}",
                    levels().join(", ")
                )));
            }
        },
    };
    Ok(Means { level, threads })
}

/// Evaluates controllers in this process.
#[pyfunction]
#[pyo3(signature = (title, parameters, architecture, genomes, seeds, on_progress=None, *, metrics=None, level="auto", threads=0))]
#[expect(
    clippy::needless_pass_by_value,
    clippy::too_many_arguments,
    reason = "pyo3 hands arguments over by value, keywords in Python"
)]
pub fn evaluate<'py>(
    py: Python<'py>,
    title: &str,
    parameters: &Bound<'py, PyDict>,
    architecture: &Bound<'py, PyDict>,
    genomes: PyReadonlyArray2<'py, f32>,
    seeds: Vec<u64>,
    on_progress: Option<Py<PyAny>>,
    metrics: Option<Vec<String>>,
    level: &str,
    threads: usize,
) -> PyResult<(Fitness<'py>, Metrics<'py>)> {
    let metrics = known(title)?
        .metrics_named(&metrics.unwrap_or_default())
        .map_err(input)?;
    let means = means(level, threads)?;
    let parameters = object("parameters", parameters)?;
    let (architecture, _) = self::architecture(architecture)?;
    let rows = rows(&architecture, &genomes)?;
    check_work(&architecture, &rows, &seeds).map_err(input)?;
    let block = Block {
        architecture: &architecture,
        genomes: &rows,
        parameters: &parameters,
        seeds: &seeds,
        metrics: &metrics,
        stop: None,
    };
    let total = block.len();
    let mut raised: Option<PyErr> = None;
    let results = py
        .detach(|| {
            in_parts(title, &block, means, |done, report| {
                let called = Python::attach(|py| {
                    py.check_signals()?;
                    match on_progress.as_ref().filter(|_| report) {
                        Some(call) => call.call1(py, (done, total, "")).map(|_| ()),
                        None => Ok(()),
                    }
                });
                called.map_err(|error| raised = Some(error)).is_ok()
            })
        })
        .map_err(input)?;
    raised.map_or(Ok(()), Err)?;
    let shape = [block.candidates(), seeds.len(), metrics.len()];
    let (fitness, values) = apart(results, block.numbers());
    arrays(py, fitness, values, shape)
}

/// Evaluates in parts of some 10 ms; `go_on(done, whether to report)` is asked after each.
fn in_parts(
    title: &str,
    whole: &Block<'_>,
    means: Means,
    mut go_on: impl FnMut(usize, bool) -> bool,
) -> Result<Vec<f64>, RolloutError> {
    let (total, episodes) = (whole.len(), whole.seeds.len());
    let weights = whole.architecture.weight_count();
    let numbers = whole.numbers();
    let mut results = Vec::with_capacity(total * numbers);
    let mut most = FIRST;
    let mut reported = Instant::now();
    while results.len() < total * numbers {
        let first = results.len() / numbers;
        let count = rectangle(&(first..total), episodes, most);
        let (candidate, episode) = (first / episodes, first % episodes);
        let candidates = candidate..candidate + count.div_ceil(episodes);
        let block = Block {
            genomes: &whole.genomes[candidates.start * weights..candidates.end * weights],
            seeds: &whole.seeds[episode..episode + count.min(episodes)],
            ..*whole
        };
        let began = Instant::now();
        let Some(part) = worlds::evaluate(title, &block, means) else {
            break;
        };
        results.extend(part?);
        let done = results.len() / numbers;
        let factor = PART.as_secs_f64() / began.elapsed().as_secs_f64().max(1e-6);
        most = scaled(count, factor);
        let report = done == total || reported.elapsed() >= REPORT;
        if report {
            reported = Instant::now();
        }
        if !go_on(done, report) {
            break;
        }
    }
    Ok(results)
}

#[expect(
    clippy::cast_possible_truncation,
    clippy::cast_precision_loss,
    clippy::cast_sign_loss,
    reason = "limited to what an index can be"
)]
fn scaled(count: usize, factor: f64) -> usize {
    (count as f64 * factor.clamp(0.1, 1000.0)).clamp(1.0, 1e9) as usize
}
