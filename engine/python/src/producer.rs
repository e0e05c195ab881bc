//! Evolution in a thread of its own, some generations ahead of what Python has stored and reported.

use std::collections::VecDeque;
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};
use std::sync::{Arc, Condvar, Mutex, PoisonError};
use std::thread::JoinHandle;
use std::time::Duration;

use numpy::{PyArray1, PyArray2, PyArrayMethods};
use pyo3::prelude::*;
use swarmwright_evolution::{Aggregate, Figures, Outcome};

use crate::digests::{Columns, PyDigests, columns};
use crate::errors::{engine, input};
use crate::local::{Evaluation, PyEvaluator, REPORT, lock};
use crate::methods::{Conversation, PySearch};
use crate::results::{Fitness, Metrics, apart, arrays};
use crate::statistics::aggregate;

/// Generations that wait at most, and how many bytes of them, unless it is a single one.
const WAITING: usize = 64;
const BYTES: usize = 1 << 25;

/// Evolves in a thread of its own.
#[pyclass(name = "Producer", module = "swarmwright._engine")]
pub struct PyProducer {
    shared: Arc<Shared>,
    thread: Option<JoinHandle<()>>,
    genes: usize,
    episodes: usize,
    metrics: usize,
}

/// A generation that the method has been told of.
struct Produced {
    genomes: Vec<f32>,
    episodes: Vec<f64>,
    metrics: Vec<f64>,
    fitness: Vec<f64>,
    /// None: the fitness.
    population: Option<Vec<f64>>,
    figures: Figures,
    outcome: Outcome,
    /// Those of its columns, where they are known.
    digests: Option<Columns>,
}

impl Produced {
    /// The digests of its columns.
    fn digested(&mut self) -> Columns {
        *self.digests.get_or_insert_with(|| {
            columns(&self.fitness, &self.episodes, &self.metrics, &self.genomes)
        })
    }

    fn bytes(&self) -> usize {
        let numbers = self.episodes.len() + self.metrics.len() + 2 * self.fitness.len();
        4 * self.genomes.len() + 8 * numbers
    }
}

#[derive(Default)]
struct Shared {
    queue: Mutex<Queue>,
    /// Something has come, been taken, or ended.
    changed: Condvar,
    stopped: AtomicBool,
    /// Episodes of the generation under way that are done, and all.
    done: AtomicUsize,
    total: AtomicUsize,
}

#[derive(Default)]
struct Queue {
    waiting: VecDeque<Produced>,
    bytes: usize,
    /// Nothing more comes; perhaps because of an error.
    over: bool,
    failed: Option<PyErr>,
}

impl Shared {
    /// Adds a generation when there is room; returns whether to go on.
    fn put(&self, produced: Produced) -> bool {
        let bytes = produced.bytes();
        let mut queue = lock(&self.queue);
        while !self.stopped.load(Ordering::Relaxed)
            && !queue.waiting.is_empty()
            && (queue.waiting.len() >= WAITING || queue.bytes + bytes > BYTES)
        {
            queue = self
                .changed
                .wait(queue)
                .unwrap_or_else(PoisonError::into_inner);
        }
        queue.bytes += bytes;
        queue.waiting.push_back(produced);
        self.changed.notify_all();
        !self.stopped.load(Ordering::Relaxed)
    }

    /// Whether a generation waits.
    fn is_ahead(&self) -> bool {
        !lock(&self.queue).waiting.is_empty()
    }

    /// Waits for a generation; returns it, and whether nothing more comes.
    fn take(&self, patience: Duration) -> (Option<Produced>, bool) {
        let queue = lock(&self.queue);
        let (mut queue, _) = self
            .changed
            .wait_timeout_while(queue, patience, |queue| {
                queue.waiting.is_empty() && !queue.over
            })
            .unwrap_or_else(PoisonError::into_inner);
        let produced = queue.waiting.pop_front();
        if let Some(produced) = &produced {
            queue.bytes -= produced.bytes();
            self.changed.notify_all();
        }
        let over = produced.is_none() && queue.over;
        (produced, over)
    }

    fn end(&self, failed: Option<PyErr>) {
        let mut queue = lock(&self.queue);
        queue.over = true;
        queue.failed = queue.failed.take().or(failed);
        self.changed.notify_all();
    }

    fn stop(&self) {
        let _queue = lock(&self.queue); // who waits has seen it, or is going to
        self.stopped.store(true, Ordering::Relaxed);
        self.changed.notify_all();
    }
}

/// What the thread works on.
struct Work {
    conversation: Conversation,
    evaluation: Arc<Evaluation>,
    /// Seed of the first episode of the first generation, and by how much it grows from one to the next.
    seed: u64,
    growth: u64,
    episodes: usize,
    aggregate: Aggregate,
    generations: u64,
}

impl Work {
    fn run(mut self, shared: &Shared) -> PyResult<()> {
        let mut seeds: Vec<u64> = (self.seed..).take(self.episodes).collect();
        for _ in 0..self.generations {
            let Some(mut produced) = self.next(&seeds, shared)? else {
                break;
            };
            if shared.is_ahead() {
                produced.digested(); // so that who takes it, and has more to do, need not
            }
            if !shared.put(produced) {
                break;
            }
            for seed in &mut seeds {
                *seed = seed.wrapping_add(self.growth);
            }
        }
        Ok(())
    }

    /// A generation; None when it was interrupted.
    fn next(&mut self, seeds: &[u64], shared: &Shared) -> PyResult<Option<Produced>> {
        let genomes = self.conversation.ask()?;
        let block = self
            .evaluation
            .block(genomes, seeds, Some(&shared.stopped))?;
        shared.done.store(0, Ordering::Relaxed);
        shared.total.store(block.len(), Ordering::Relaxed);
        let go_on = |done: usize, _: bool| {
            shared.done.store(done, Ordering::Relaxed);
            !shared.stopped.load(Ordering::Relaxed)
        };
        let none: Option<fn() -> bool> = None;
        let results = self.evaluation.in_parts(&block, true, none, go_on)?;
        if shared.stopped.load(Ordering::Relaxed) {
            return Ok(None);
        }
        let (episodes, metrics) = apart(results, block.numbers());
        let fitness = self.aggregate.of_rows(episodes.clone(), seeds.len());
        let genomes = self.conversation.tell(&fitness)?;
        let population = self.conversation.members();
        Ok(Some(Produced {
            figures: Figures::of(population.as_deref().unwrap_or(&fitness)),
            outcome: Outcome::of(&fitness),
            digests: None,
            genomes,
            episodes,
            metrics,
            fitness,
            population,
        }))
    }
}

/// Says that nothing more comes, also when the thread panics.
struct End<'a>(&'a Shared, Option<PyErr>);

impl Drop for End<'_> {
    fn drop(&mut self) {
        self.0.end(self.1.take());
    }
}

type Numbers<'py> = Bound<'py, PyArray1<f64>>;
type Generation<'py> = (
    Bound<'py, PyArray2<f32>>,
    Fitness<'py>,
    Metrics<'py>,
    Numbers<'py>,
    Numbers<'py>,
    (f64, f64, f64, f64, f64),
    (usize, usize),
    PyDigests,
);

#[pymethods]
impl PyProducer {
    #[new]
    #[pyo3(signature = (search, evaluator, *, seed, growth, episodes, aggregate, level, generations))]
    #[expect(
        clippy::too_many_arguments,
        reason = "pyo3 hands arguments over by value, keywords in Python"
    )]
    fn new(
        search: &mut PySearch,
        evaluator: &PyEvaluator,
        seed: u64,
        growth: u64,
        episodes: usize,
        aggregate: &str,
        level: f64,
        generations: u64,
    ) -> PyResult<Self> {
        let aggregate = self::aggregate(aggregate, level)?;
        let evaluation = evaluator.0.clone();
        let (metrics, weights) = (evaluation.metrics(), evaluation.genes());
        let conversation = search.take()?;
        let genes = conversation.genes();
        if genes != weights || episodes == 0 {
            return Err(input(format!(
                "expected genomes of {weights} genes and at least one episode, found {genes} and {episodes}"
            )));
        }
        let work = Work {
            conversation,
            evaluation,
            seed,
            growth,
            episodes,
            aggregate,
            generations,
        };
        let shared = Arc::new(Shared::default());
        let there = shared.clone();
        let thread = std::thread::Builder::new()
            .name("generations".into())
            .spawn(move || {
                let mut end = End(&there, Some(engine("the engine's thread has ended early")));
                end.1 = work.run(&there).err();
            })
            .map_err(|error| engine(format!("no thread can be started: {error}")))?;
        Ok(Self {
            shared,
            thread: Some(thread),
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
                return lock(&self.shared.queue).failed.take().map_or(Ok(None), Err);
            }
            py.check_signals()?;
            let [done, total] =
                [&self.shared.done, &self.shared.total].map(|count| count.load(Ordering::Relaxed));
            if done < total {
                on_progress.call1((done, total, ""))?;
            }
        }
    }

    /// Ends the thread; generations that wait are lost.
    fn close(&mut self, py: Python<'_>) {
        self.shared.stop();
        if let Some(thread) = self.thread.take() {
            // How it ended was said by `next`, or nobody wants to know.
            let _ = py.detach(|| thread.join());
        }
    }
}

impl PyProducer {
    fn arrays<'py>(&self, py: Python<'py>, mut produced: Produced) -> PyResult<Generation<'py>> {
        let digests = py.detach(|| produced.digested());
        let candidates = produced.fitness.len();
        let shape = [candidates, self.episodes, self.metrics];
        let (episodes, metrics) = arrays(py, produced.episodes, produced.metrics, shape)?;
        let genomes = PyArray1::from_vec(py, produced.genomes).reshape([candidates, self.genes])?;
        let fitness = PyArray1::from_vec(py, produced.fitness);
        let population = match produced.population {
            Some(population) => PyArray1::from_vec(py, population),
            None => fitness.clone(),
        };
        let one = produced.figures;
        let figures = (
            one.best,
            one.mean,
            one.lower_quartile,
            one.median,
            one.upper_quartile,
        );
        let outcome = (produced.outcome.leader, produced.outcome.failed);
        let digests = PyDigests::known(digests);
        Ok((
            genomes, episodes, metrics, fitness, population, figures, outcome, digests,
        ))
    }
}

impl Drop for PyProducer {
    fn drop(&mut self) {
        self.shared.stop();
    }
}
