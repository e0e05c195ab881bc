//! Evaluation in this process.

use std::sync::atomic::AtomicBool;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

use numpy::{PyArray1, PyReadonlyArray2};
use pyo3::prelude::*;
use pyo3::types::PyDict;
use swarmwright_controllers::Architecture;
use swarmwright_lanes::Level;
use swarmwright_pool::{check_shape, check_work, rectangle};
use swarmwright_worlds::{self as worlds, Block, Means, Pace, Parameters};

use crate::errors::input;
use crate::genomes::{architecture, rows};
use crate::results::{Fitness, Metrics, apart, arrays};
use crate::statistics::aggregate;
use crate::threads;
use crate::values::object;
use crate::worlds::known;

/// Amount of work between two checks for Ctrl-C.
const PART: Duration = Duration::from_millis(30);
/// How many times as long as `PART` full vectors may take.
const MOST_PARTS: usize = 16;
/// A share of `PART`, 50 microseconds, in which other threads hardly begin.
const MODEST: usize = 600;
/// A share of `PART`, half a millisecond: less is not worth the time of another thread that has work of its own.
const ALONE: usize = 60;
/// Evaluations of each thread in the very first part, which tells how long they take.
const FIRST: usize = 32;
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

/// Checks the environment variable that limits the instruction set. Raises InputError.
#[pyfunction]
pub fn check_instructions() -> PyResult<()> {
    Level::asked_for().map(|_| ()).map_err(input)
}

fn means(level: &str, threads: usize) -> PyResult<Means> {
    let level = match level {
        "auto" => {
            Level::asked_for().map_err(input)?;
            Some(Level::best())
        }
        "scalar" => None,
        name => match Level::available()
            .into_iter()
            .find(|level| level.name() == name)
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

/// Evaluates controllers of one architecture in this process.
#[pyclass(name = "Evaluator", module = "swarmwright._engine")]
pub struct PyEvaluator(pub Arc<Evaluation>);

/// A simulation, and controllers of one architecture.
pub struct Evaluation {
    title: String,
    parameters: Parameters,
    architecture: Architecture,
    /// Those that are wanted, by their index in the simulation's description.
    metrics: Vec<usize>,
    means: Means,
    pace: Pace,
}

#[pymethods]
impl PyEvaluator {
    #[new]
    #[pyo3(signature = (title, parameters, architecture, *, metrics=None, level="auto", threads=0))]
    fn new(
        title: &str,
        parameters: &Bound<'_, PyDict>,
        architecture: &Bound<'_, PyDict>,
        metrics: Option<Vec<String>>,
        level: &str,
        threads: usize,
    ) -> PyResult<Self> {
        threads::start()?;
        let parameters = object("parameters", parameters)?;
        Ok(Self(Arc::new(Evaluation {
            metrics: known(title, &parameters)?
                .metrics_named(&metrics.unwrap_or_default())
                .map_err(input)?,
            title: title.to_owned(),
            parameters,
            architecture: self::architecture(architecture)?.0,
            means: means(level, threads)?,
            pace: Pace::new(PART, FIRST),
        })))
    }

    #[pyo3(signature = (genomes, seeds, on_progress=None, meanwhile=None))]
    #[expect(
        clippy::needless_pass_by_value,
        reason = "pyo3 hands arguments over by value"
    )]
    fn evaluate<'py>(
        &self,
        py: Python<'py>,
        genomes: PyReadonlyArray2<'py, f32>,
        seeds: Vec<u64>,
        on_progress: Option<Py<PyAny>>,
        meanwhile: Option<Py<PyAny>>,
    ) -> PyResult<(Fitness<'py>, Metrics<'py>)> {
        let evaluation = &self.0;
        let rows = rows(&evaluation.architecture, &genomes)?;
        let block = evaluation.block(&rows, &seeds, None)?;
        let results = self.results(py, &block, on_progress, meanwhile)?;
        let shape = [block.candidates(), seeds.len(), evaluation.metrics()];
        let (fitness, values) = apart(results, block.numbers());
        arrays(py, fitness, values, shape)
    }

    #[pyo3(signature = (genomes, seeds, aggregate, level, on_progress=None))]
    #[expect(
        clippy::needless_pass_by_value,
        reason = "pyo3 hands arguments over by value"
    )]
    fn scores<'py>(
        &self,
        py: Python<'py>,
        genomes: PyReadonlyArray2<'py, f32>,
        seeds: Vec<u64>,
        aggregate: &str,
        level: f64,
        on_progress: Option<Py<PyAny>>,
    ) -> PyResult<Bound<'py, PyArray1<f64>>> {
        let aggregate = self::aggregate(aggregate, level)?;
        let rows = rows(&self.0.architecture, &genomes)?;
        let block = self.0.block(&rows, &seeds, None)?;
        let results = self.results(py, &block, on_progress, None)?;
        let (fitness, _) = apart(results, block.numbers());
        let scores = py.detach(|| aggregate.of_rows(fitness, seeds.len()));
        Ok(PyArray1::from_vec(py, scores))
    }
}

impl PyEvaluator {
    /// Fitness and metrics of all episodes; raises what the callbacks raise, and KeyboardInterrupt.
    fn results(
        &self,
        py: Python<'_>,
        block: &Block<'_>,
        on_progress: Option<Py<PyAny>>,
        meanwhile: Option<Py<PyAny>>,
    ) -> PyResult<Vec<f64>> {
        let total = block.len();
        let raised = Mutex::new(None);
        let ask = |question: &dyn Fn(Python<'_>) -> PyResult<()>| {
            let answer = Python::attach(question);
            answer.map_err(|error| *lock(&raised) = Some(error)).is_ok()
        };
        let results = py.detach(|| {
            self.0.in_parts(
                block,
                false,
                meanwhile.map(|call| move || ask(&|py| call.call0(py).map(|_| ()))),
                |done, report| {
                    ask(&|py| {
                        py.check_signals()?;
                        match on_progress.as_ref().filter(|_| report) {
                            Some(call) => call.call1(py, (done, total, "")).map(|_| ()),
                            None => Ok(()),
                        }
                    })
                },
            )
        })?;
        lock(&raised).take().map_or(Ok(results), Err)
    }
}

impl Evaluation {
    /// How many numbers there are beside the fitness.
    pub fn metrics(&self) -> usize {
        self.metrics.len()
    }

    /// Genes of a controller.
    pub fn genes(&self) -> usize {
        self.architecture.weight_count()
    }

    /// Work for this evaluation, checked but for numbers that are not finite: `in_parts` finds these.
    pub fn block<'a>(
        &'a self,
        genomes: &'a [f32],
        seeds: &'a [u64],
        stop: Option<&'a AtomicBool>,
    ) -> PyResult<Block<'a>> {
        check_shape(&self.architecture, genomes, seeds).map_err(input)?;
        Ok(Block {
            architecture: &self.architecture,
            genomes,
            parameters: &self.parameters,
            seeds,
            metrics: &self.metrics,
            stop,
        })
    }

    fn threads(&self) -> usize {
        match self.means.threads {
            0 => rayon::current_num_threads(),
            threads => threads,
        }
    }

    /// As many evaluations on all threads as fill the vectors that are computed side by side, of so many on each, at least once:
    /// vectors that are not full take as long as full ones. Of slow evaluations fewer vectors, so that Ctrl-C is noticed in time.
    fn in_vectors(&self, evaluations: usize) -> usize {
        let mut lanes = 1;
        if let Some(level) = self.means.level {
            let vectors = worlds::vectors(&self.title).unwrap_or(1);
            lanes = level.width() * vectors;
            while lanes > level.width() && lanes > evaluations.saturating_mul(MOST_PARTS) {
                lanes /= 2;
            }
        }
        (evaluations / lanes)
            .max(1)
            .saturating_mul(lanes * self.threads())
    }

    /// Evaluates in parts of some 10 ms; `go_on(done, whether to report)` is asked after each, and `meanwhile` during the first.
    ///
    /// `busy`: there is no processor for other threads. What takes next to no time is done by this one alone all the same. Raises
    /// InputError.
    pub fn in_parts(
        &self,
        whole: &Block<'_>,
        busy: bool,
        mut meanwhile: Option<impl FnOnce() -> bool>,
        mut go_on: impl FnMut(usize, bool) -> bool,
    ) -> PyResult<Vec<f64>> {
        let (total, episodes) = (whole.len(), whole.seeds.len());
        let weights = whole.architecture.weight_count();
        let numbers = whole.numbers();
        let mut results = Vec::new();
        let mut reported = Instant::now();
        while results.len() < total * numbers {
            let first = results.len() / numbers;
            let most = self.in_vectors(self.pace.each());
            let count = rectangle(&(first..total), episodes, most);
            let (candidate, episode) = (first / episodes, first % episodes);
            let candidates = candidate..candidate + count.div_ceil(episodes);
            let block = Block {
                genomes: &whole.genomes[candidates.start * weights..candidates.end * weights],
                seeds: &whole.seeds[episode..episode + count.min(episodes)],
                ..*whole
            };
            let work = || {
                let began = Instant::now();
                let share = if busy { ALONE } else { MODEST };
                let all = self.threads();
                let alone = self.pace.is_less(share, count, all);
                let means = Means {
                    threads: if alone { 1 } else { self.means.threads },
                    ..self.means
                };
                let part = worlds::evaluate(&self.title, &block, means);
                let threads = if alone { 1 } else { all };
                self.pace.note(count, threads, began.elapsed());
                part
            };
            let (part, proceed) = match meanwhile.take() {
                Some(meanwhile) => beside(work, meanwhile),
                None => (work(), true),
            };
            let Some(part) = part else {
                break;
            };
            let part = part.map_err(|error| {
                // Of weights that are not finite, the first one in all of the genomes.
                check_work(whole.architecture, whole.genomes, whole.seeds)
                    .map_or_else(input, |()| input(error))
            })?;
            if results.is_empty() {
                results = part;
                results.reserve_exact(total * numbers - results.len());
            } else {
                results.extend(part);
            }
            let done = results.len() / numbers;
            let report = done == total || reported.elapsed() >= REPORT;
            if report {
                reported = Instant::now();
            }
            if !proceed || !go_on(done, report) {
                break;
            }
        }
        Ok(results)
    }
}

/// Does one thing in the engine's threads and the other in this one.
fn beside<A: Send, B>(
    task: impl FnOnce() -> Option<A> + Send,
    other: impl FnOnce() -> B,
) -> (Option<A>, B) {
    let mut result = None;
    let answer = rayon::in_place_scope(|scope| {
        scope.spawn(|_| result = task());
        other()
    });
    (result, answer)
}

pub fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

/// Evaluates controllers in this process, once.
#[pyfunction]
#[pyo3(signature = (title, parameters, architecture, genomes, seeds, on_progress=None, *, metrics=None, level="auto", threads=0))]
#[expect(
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
    let evaluator = PyEvaluator::new(title, parameters, architecture, metrics, level, threads)?;
    evaluator.evaluate(py, genomes, seeds, on_progress, None)
}
