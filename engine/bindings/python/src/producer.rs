//! Evolution in a thread of its own, some generations ahead of what Python has stored and reported.

mod queue;
mod work;

use std::sync::atomic::Ordering;
use std::sync::{Arc, Mutex};
use std::thread::JoinHandle;

use numpy::{PyArray1, PyArrayMethods};
use pyo3::prelude::*;
use pyo3::types::PyDict;
use swarmwright_mqtt::Waker;
use swarmwright_pool::Pool;

use crate::digests::PyDigests;
use crate::errors::{engine, input};
use crate::genomes::architecture;
use crate::local::{PyEvaluator, REPORT, lock};
use crate::methods::PySearch;
use crate::pool::{Fields, PyPool, fields};
use crate::remote::Servers;
use crate::results::{Fitness, Metrics, arrays};
use crate::sample::PySample;
use crate::statistics::aggregate;

use queue::{End, Produced, ProducedGenomes, Shared};
use work::{Limits, Place, Work};

/// The thread of a producer. The pool that it was lent knows it, too: a producer may be lost before anyone can close it, as when
/// Ctrl-C comes while it is made.
pub struct Borrower {
    shared: Arc<Shared>,
    /// Returns the pool where there is one.
    thread: Mutex<Option<JoinHandle<Option<Pool>>>>,
    waker: Option<Waker>,
}

impl Borrower {
    fn stop(&self) {
        self.shared.stop();
        if let Some(waker) = &self.waker {
            waker.wake();
        }
    }

    /// Ends the thread; generations that wait are lost. The pool where it has not been returned yet.
    pub fn end(&self) -> Option<Pool> {
        self.stop();
        let thread = lock(&self.thread).take()?;
        // `next` has reported an error of the thread, unless the run was ended before it.
        thread.join().ok().flatten()
    }
}

/// Evolves in a separate thread.
#[pyclass(name = "Producer", module = "swarmwright._engine")]
pub struct PyProducer {
    shared: Arc<Shared>,
    borrower: Arc<Borrower>,
    /// The object to which the pool is returned.
    lender: Option<Py<PyPool>>,
    genes: usize,
    episodes: usize,
    metrics: usize,
}

/// What evaluates.
#[derive(FromPyObject)]
enum Evaluator<'py> {
    Engine(PyRef<'py, PyEvaluator>),
    Pool(Bound<'py, PyPool>),
}

type Numbers<'py> = Bound<'py, PyArray1<f64>>;
type Generation<'py> = (
    Bound<'py, PyAny>,
    Fitness<'py>,
    Metrics<'py>,
    Numbers<'py>,
    Numbers<'py>,
    (f64, f64, f64, f64, f64),
    (usize, usize),
    PyDigests,
    Vec<Fields<'py>>,
    Vec<Fields<'py>>,
);

#[pymethods]
impl PyProducer {
    #[new]
    #[pyo3(signature = (search, evaluator, architecture, *, seed, growth, episodes, aggregate, level, generations,
        evaluations=None, target=None, run="", generation=0, samples=true))]
    #[expect(
        clippy::too_many_arguments,
        reason = "pyo3 hands arguments over by value, keywords in Python"
    )]
    fn new(
        py: Python<'_>,
        search: &mut PySearch,
        evaluator: Evaluator<'_>,
        architecture: &Bound<'_, PyDict>,
        seed: u64,
        growth: u64,
        episodes: usize,
        aggregate: &str,
        level: f64,
        generations: u64,
        evaluations: Option<(u64, u64)>,
        target: Option<f64>,
        run: &str,
        generation: u64,
        samples: bool,
    ) -> PyResult<Self> {
        let aggregate = self::aggregate(aggregate, level)?;
        let (read, specification) = self::architecture(architecture)?;
        let weights = match &evaluator {
            Evaluator::Engine(evaluator) => evaluator.0.genes(),
            Evaluator::Pool(_) => read.weight_count(),
        };
        let conversation = search.take()?;
        let genes = conversation.genes();
        if genes != weights || episodes == 0 {
            return Err(input(format!(
                "expected genomes of {weights} genes and at least one episode, found {genes} and {episodes}"
            )));
        }
        // The engine's threads begin here at the latest, so that they do not have the name of the one that begins now.
        rayon::current_num_threads();
        let shared = Arc::new(Shared::default());
        let mut lender = None;
        let (location, metrics, waker) = match evaluator {
            Evaluator::Engine(evaluator) => {
                let evaluation = evaluator.0.clone();
                let metrics = evaluation.metrics();
                (Place::Here(evaluation), metrics, None)
            }
            Evaluator::Pool(lent) => {
                let pool = lent.borrow_mut().lend()?;
                let (metrics, waker) = (lent.borrow().metrics(), pool.waker());
                lender = Some(lent.unbind());
                let servers = Servers {
                    pool,
                    architecture: Arc::new(read),
                    specification,
                    run: run.to_owned(),
                    generation,
                    expected: shared.expected.clone(),
                };
                (Place::Servers(Box::new(servers)), metrics, Some(waker))
            }
        };
        let mut work = Work {
            conversation,
            place: location,
            seed,
            growth,
            episodes,
            aggregate,
            limits: Limits {
                generations,
                evaluations,
                target,
            },
            samples,
        };
        let thread_shared = shared.clone();
        let thread = std::thread::Builder::new()
            .name("generations".into())
            .spawn(move || {
                let mut end = End(
                    &thread_shared,
                    Some(engine("the engine's thread has ended early")),
                );
                end.1 = work.run(&thread_shared).err();
                match work.place {
                    Place::Here(_) => None,
                    Place::Servers(servers) => Some(servers.pool),
                }
            })
            .map_err(|error| engine(format!("could not start a thread: {error}")))?;
        let borrower = Arc::new(Borrower {
            shared: shared.clone(),
            thread: Mutex::new(Some(thread)),
            waker,
        });
        if let Some(lender) = &lender {
            lender.borrow_mut(py).lent_to(borrower.clone());
        }
        Ok(Self {
            shared,
            borrower,
            lender,
            genes,
            episodes,
            metrics,
        })
    }

    /// Waits for the next generation.
    #[pyo3(signature = (on_progress))]
    fn next<'py>(
        &self,
        py: Python<'py>,
        on_progress: &Bound<'py, PyAny>,
    ) -> PyResult<Option<Generation<'py>>> {
        loop {
            let (produced, over) = py.detach(|| self.shared.take(REPORT));
            if let Some(produced) = produced {
                return self.arrays(py, produced).map(Some);
            }
            if over {
                return self.shared.failure().map_or(Ok(None), Err);
            }
            py.check_signals()?;
            let [done, total] =
                [&self.shared.done, &self.shared.total].map(|count| count.load(Ordering::Relaxed));
            if done < total {
                let waits = lock(&self.shared.waits).clone();
                on_progress.call1((done, total, waits))?;
            }
        }
    }

    /// Whether `next` returns without waiting.
    fn is_ready(&self) -> bool {
        self.shared.is_ready()
    }

    /// Sets the expected number of generations of the run, for progress displays.
    fn expect(&self, generations: u64) {
        self.shared.expected.store(generations, Ordering::Relaxed);
    }

    /// Ends the thread; generations that wait are lost.
    fn close(&mut self, py: Python<'_>) {
        match self.lender.take() {
            Some(lender) => lender.borrow_mut(py).take_back(py),
            None => drop(py.detach(|| self.borrower.end())),
        }
    }
}

impl PyProducer {
    fn arrays<'py>(&self, py: Python<'py>, mut produced: Produced) -> PyResult<Generation<'py>> {
        let (digests, figures) = py.detach(|| produced.summary())?;
        let candidates = produced.fitness.len();
        let shape = [candidates, self.episodes, self.metrics];
        let (episodes, metrics) = arrays(py, produced.episodes, produced.metrics, shape)?;
        let genomes = match produced.genomes {
            ProducedGenomes::Genomes(genomes) => PyArray1::from_vec(py, genomes)
                .reshape([candidates, self.genes])?
                .into_any(),
            ProducedGenomes::Sample(sample) => Bound::new(py, PySample(*sample))?.into_any(),
        };
        let fitness = PyArray1::from_vec(py, produced.fitness);
        let population = match produced.population {
            Some(population) => PyArray1::from_vec(py, population),
            None => fitness.clone(),
        };
        let figures = (
            figures.best,
            figures.mean,
            figures.lower_quartile,
            figures.median,
            figures.upper_quartile,
        );
        let outcome = (produced.outcome.leader, produced.outcome.failed);
        let digests = PyDigests::known(digests);
        let attempts = fields(py, &produced.attempts)?;
        let warnings = fields(py, &produced.warnings)?;
        Ok((
            genomes, episodes, metrics, fitness, population, figures, outcome, digests, attempts,
            warnings,
        ))
    }
}

impl Drop for PyProducer {
    fn drop(&mut self) {
        self.borrower.stop();
    }
}
