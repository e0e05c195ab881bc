//! Evolution in a thread of its own, some generations ahead of what Python has stored and reported.

use std::collections::VecDeque;
use std::sync::atomic::{AtomicBool, AtomicU64, AtomicUsize, Ordering};
use std::sync::{Arc, Condvar, Mutex, PoisonError};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use numpy::{PyArray1, PyArrayMethods};
use pyo3::prelude::*;
use pyo3::types::PyDict;
use swarmwright_evolution::{Aggregate, Figures, Outcome};
use swarmwright_mqtt::Waker;
use swarmwright_pool::{Attempt, Pool};
use swarmwright_protocol::Sample;

use crate::digests::{Columns, PyDigests, columns, of_genomes, of_sample};
use crate::errors::{engine, input};
use crate::genomes::architecture;
use crate::local::{Evaluation, PyEvaluator, REPORT, lock};
use crate::methods::{Asked, Conversation, PySearch};
use crate::pool::{AttemptRow, PyPool, rows};
use crate::remote::{Evaluated, Servers};
use crate::results::{Fitness, Metrics, apart, arrays};
use crate::sample::{PySample, genomes_of};
use crate::statistics::aggregate;

/// Generations that wait at most, and how many bytes of them, unless it is a single one.
const WAITING: usize = 64;
const BYTES: usize = 1 << 25;
/// So many are handed over together, where each takes less time than `QUICK`: waking a thread takes as long as a tenth of a small one.
const TOGETHER: usize = 8;
const QUICK: Duration = Duration::from_micros(500);

/// Evolves in a thread of its own.
#[pyclass(name = "Producer", module = "swarmwright._engine")]
pub struct PyProducer {
    shared: Arc<Shared>,
    /// Returns the pool where there is one.
    thread: Option<JoinHandle<Option<Pool>>>,
    /// Who gets the pool back.
    lender: Option<Py<PyPool>>,
    waker: Option<Waker>,
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

enum Place {
    Here(Arc<Evaluation>),
    Servers(Box<Servers>),
}

/// Genomes as the store keeps them.
enum Kept {
    Genomes(Vec<f32>),
    Sample(Box<Sample>),
}

/// A generation that the method has been told of.
struct Produced {
    genomes: Kept,
    episodes: Vec<f64>,
    metrics: Vec<f64>,
    fitness: Vec<f64>,
    /// None: the fitness.
    population: Option<Vec<f64>>,
    outcome: Outcome,
    /// What is computed from its columns, where it is known.
    summary: Option<(Columns, Figures)>,
    attempts: Vec<Attempt>,
    warnings: Vec<String>,
}

impl Produced {
    /// The digests of its columns, and what the fitness looks like.
    fn summary(&mut self) -> PyResult<(Columns, Figures)> {
        if let Some(known) = self.summary {
            return Ok(known);
        }
        let genomes = match &self.genomes {
            Kept::Genomes(genomes) => of_genomes(genomes),
            Kept::Sample(sample) => of_sample(sample)?,
        };
        let digests = columns(&self.fitness, &self.episodes, &self.metrics, genomes);
        let population = self.population.as_ref().unwrap_or(&self.fitness);
        let found = (digests, Figures::of(population));
        self.summary = Some(found);
        Ok(found)
    }

    fn bytes(&self) -> usize {
        let numbers = self.episodes.len() + self.metrics.len() + 2 * self.fitness.len();
        let genomes = match &self.genomes {
            Kept::Genomes(genomes) => size_of_val(&genomes[..]),
            Kept::Sample(sample) => sample.rows().iter().map(|(_, row)| size_of_val(*row)).sum(),
        };
        genomes + 8 * numbers
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
    /// What is waited for.
    waits: Mutex<String>,
    /// Generations that the run is expected to have.
    expected: Arc<AtomicU64>,
}

#[derive(Default)]
struct Queue {
    waiting: VecDeque<Produced>,
    bytes: usize,
    /// There are enough to take them, until there is none.
    ready: bool,
    /// The one or the other waits for a change.
    taker_waits: bool,
    producer_waits: bool,
    /// Nothing more comes; perhaps because of an error.
    over: bool,
    failed: Option<PyErr>,
}

impl Queue {
    fn is_full(&self, bytes: usize) -> bool {
        !self.waiting.is_empty() && (self.waiting.len() >= WAITING || self.bytes + bytes > BYTES)
    }

    /// Whether there is room for several, so that the producer need not be woken for each.
    fn has_room(&self) -> bool {
        self.waiting.len() <= WAITING / 2 && self.bytes <= BYTES / 2
    }
}

impl Shared {
    /// Adds a generation when there is room; returns whether to go on. `soon`: it is not to wait for others.
    fn put(&self, produced: Produced, soon: bool) -> bool {
        let bytes = produced.bytes();
        let mut queue = lock(&self.queue);
        if queue.is_full(bytes) {
            self.call(&mut queue);
            queue.producer_waits = true;
            queue = self
                .changed
                .wait_while(queue, |queue| {
                    !self.stopped.load(Ordering::Relaxed)
                        && !queue.waiting.is_empty()
                        && !queue.has_room()
                })
                .unwrap_or_else(PoisonError::into_inner);
            queue.producer_waits = false;
        }
        queue.bytes += bytes;
        queue.waiting.push_back(produced);
        if soon || queue.waiting.len() >= TOGETHER {
            self.call(&mut queue);
        }
        !self.stopped.load(Ordering::Relaxed)
    }

    /// Says that there are enough to take them.
    fn call(&self, queue: &mut Queue) {
        queue.ready = true;
        if queue.taker_waits {
            self.changed.notify_all();
        }
    }

    /// Whether more wait than are handed over together, so that who takes them has more to do.
    fn is_ahead(&self) -> bool {
        lock(&self.queue).waiting.len() > TOGETHER
    }

    /// Whether there is no processor for more threads: of two, the other one is that of the taker, unless it waits.
    fn is_busy(&self) -> bool {
        rayon::current_num_threads() <= 2 && !lock(&self.queue).taker_waits
    }

    /// Waits for a generation; returns it, and whether nothing more comes.
    fn take(&self, patience: Duration) -> (Option<Produced>, bool) {
        let mut queue = lock(&self.queue);
        if !queue.ready && !queue.over {
            queue.taker_waits = true;
            (queue, _) = self
                .changed
                .wait_timeout_while(queue, patience, |queue| !queue.ready && !queue.over)
                .unwrap_or_else(PoisonError::into_inner);
            queue.taker_waits = false;
        }
        let produced = queue.waiting.pop_front();
        queue.ready = !queue.waiting.is_empty();
        if let Some(produced) = &produced {
            queue.bytes -= produced.bytes();
            if queue.producer_waits && (queue.waiting.is_empty() || queue.has_room()) {
                self.changed.notify_all();
            }
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
    place: Place,
    /// Seed of the first episode of the first generation, and by how much it grows from one to the next.
    seed: u64,
    growth: u64,
    episodes: usize,
    aggregate: Aggregate,
    limits: Limits,
    /// Whether the store keeps samples instead of the genomes that are made from them.
    samples: bool,
}

/// Where the thread ends by itself.
struct Limits {
    generations: u64,
    /// Evaluations that the whole run may have, and those that it has had.
    evaluations: Option<(u64, u64)>,
    target: Option<f64>,
}

impl Limits {
    /// Whether a generation of so many candidates is not to be evaluated any more.
    fn excludes(&self, candidates: usize) -> bool {
        let full = |(most, used)| used > 0 && used + candidates as u64 > most;
        self.evaluations.is_some_and(full)
    }

    /// Takes what came out of a generation; returns whether to go on.
    fn counted(&mut self, fitness: &[f64]) -> bool {
        if let Some((_, used)) = &mut self.evaluations {
            *used += fitness.len() as u64;
        }
        let reached = |target| fitness.iter().any(|value| *value >= target);
        !self.target.is_some_and(reached)
    }
}

impl Work {
    fn run(&mut self, shared: &Shared) -> PyResult<()> {
        let mut seeds: Vec<u64> = (self.seed..).take(self.episodes).collect();
        for _ in 0..self.limits.generations {
            let began = Instant::now();
            let Some(mut produced) = self.next(&seeds, shared)? else {
                break;
            };
            let go_on = self.limits.counted(&produced.fitness);
            if shared.is_ahead() {
                produced.summary()?; // so that who takes it, and has more to do, need not
            }
            if !shared.put(produced, began.elapsed() > QUICK) || !go_on {
                break;
            }
            for seed in &mut seeds {
                *seed = seed.wrapping_add(self.growth);
            }
        }
        Ok(())
    }

    /// A generation; None when it was interrupted, or the budget ends before it.
    fn next(&mut self, seeds: &[u64], shared: &Shared) -> PyResult<Option<Produced>> {
        let asked = self.ask()?;
        let candidates = asked.candidates(self.conversation.genes());
        if self.limits.excludes(candidates) {
            return Ok(None);
        }
        shared.done.store(0, Ordering::Relaxed);
        let total = candidates * seeds.len();
        shared.total.store(total, Ordering::Relaxed);
        let is_made = matches!(asked, Asked::Genomes(_));
        let Some(found) = self.evaluate(asked, candidates, seeds, shared)? else {
            return Ok(None);
        };
        let fitness = self.aggregate.of_rows(found.fitness.clone(), seeds.len());
        let sample = if self.samples {
            self.conversation.short_sample(candidates)
        } else {
            None
        };
        let genomes = if is_made {
            self.conversation.told(found.genomes, &fitness)?
        } else {
            self.conversation.told_sample(&fitness)?;
            Vec::new()
        };
        let genomes = sample.map_or(Kept::Genomes(genomes), |sample| {
            Kept::Sample(Box::new(sample))
        });
        let population = self.conversation.members();
        Ok(Some(Produced {
            outcome: Outcome::of(&fitness),
            summary: None,
            genomes,
            episodes: found.fitness,
            metrics: found.metrics,
            fitness,
            population,
            attempts: found.attempts,
            warnings: found.warnings,
        }))
    }

    /// What is to be evaluated next: servers make the genomes of a sample themselves, and a store that keeps samples needs none.
    fn ask(&mut self) -> PyResult<Asked> {
        match self.place {
            Place::Servers(_) if self.samples => self.conversation.draw(),
            _ => self.conversation.take().map(Asked::Genomes),
        }
    }

    /// What came out of a generation; None when it was interrupted.
    fn evaluate(
        &mut self,
        asked: Asked,
        candidates: usize,
        seeds: &[u64],
        shared: &Shared,
    ) -> PyResult<Option<Evaluated>> {
        let go_on = || !shared.stopped.load(Ordering::Relaxed);
        let (evaluation, genomes) = match (&mut self.place, asked) {
            (Place::Here(evaluation), Asked::Genomes(genomes)) => (evaluation, genomes),
            (Place::Here(evaluation), Asked::Sample(sample)) => (evaluation, genomes_of(&sample)),
            (Place::Servers(servers), asked) => {
                let sample = match asked {
                    Asked::Genomes(_) => self.conversation.sample(candidates),
                    Asked::Sample(_) => None,
                };
                return servers.evaluate(asked, sample, seeds, go_on, |done, waiting_for| {
                    waiting_for.clone_into(&mut lock(&shared.waits));
                    shared.done.store(done, Ordering::Relaxed);
                });
            }
        };
        let block = evaluation.block(&genomes, seeds, Some(&shared.stopped))?;
        let none: Option<fn() -> bool> = None;
        let results = evaluation.in_parts(&block, shared.is_busy(), none, |done, _| {
            shared.done.store(done, Ordering::Relaxed);
            go_on()
        })?;
        let (fitness, metrics) = apart(results, block.numbers());
        Ok(go_on().then_some(Evaluated {
            genomes,
            fitness,
            metrics,
            attempts: Vec::new(),
            warnings: Vec::new(),
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
    Bound<'py, PyAny>,
    Fitness<'py>,
    Metrics<'py>,
    Numbers<'py>,
    Numbers<'py>,
    (f64, f64, f64, f64, f64),
    (usize, usize),
    PyDigests,
    Vec<AttemptRow>,
    Vec<String>,
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
        let (place, metrics, waker) = match evaluator {
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
            place,
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
        let there = shared.clone();
        let thread = std::thread::Builder::new()
            .name("generations".into())
            .spawn(move || {
                let mut end = End(&there, Some(engine("the engine's thread has ended early")));
                end.1 = work.run(&there).err();
                match work.place {
                    Place::Here(_) => None,
                    Place::Servers(servers) => Some(servers.pool),
                }
            })
            .map_err(|error| engine(format!("no thread can be started: {error}")))?;
        Ok(Self {
            shared,
            thread: Some(thread),
            lender,
            waker,
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
                let waits = lock(&self.shared.waits).clone();
                on_progress.call1((done, total, waits))?;
            }
        }
    }

    /// Whether `next` returns without waiting.
    fn is_ready(&self) -> bool {
        let queue = lock(&self.shared.queue);
        queue.ready || queue.over
    }

    /// For those who watch: how many generations the run is expected to have.
    fn expect(&self, generations: u64) {
        self.shared.expected.store(generations, Ordering::Relaxed);
    }

    /// Ends the thread; generations that wait are lost.
    fn close(&mut self, py: Python<'_>) {
        self.stop();
        if let Some(thread) = self.thread.take() {
            // How it ended was said by `next`, or nobody wants to know.
            let ended = py.detach(|| thread.join());
            if let (Ok(Some(pool)), Some(lender)) = (ended, self.lender.take()) {
                lender.borrow_mut(py).give_back(pool);
            }
        }
    }
}

impl PyProducer {
    fn stop(&self) {
        self.shared.stop();
        if let Some(waker) = &self.waker {
            waker.wake();
        }
    }

    fn arrays<'py>(&self, py: Python<'py>, mut produced: Produced) -> PyResult<Generation<'py>> {
        let (digests, one) = py.detach(|| produced.summary())?;
        let candidates = produced.fitness.len();
        let shape = [candidates, self.episodes, self.metrics];
        let (episodes, metrics) = arrays(py, produced.episodes, produced.metrics, shape)?;
        let genomes = match produced.genomes {
            Kept::Genomes(genomes) => PyArray1::from_vec(py, genomes)
                .reshape([candidates, self.genes])?
                .into_any(),
            Kept::Sample(sample) => Bound::new(py, PySample(*sample))?.into_any(),
        };
        let fitness = PyArray1::from_vec(py, produced.fitness);
        let population = match produced.population {
            Some(population) => PyArray1::from_vec(py, population),
            None => fitness.clone(),
        };
        let figures = (
            one.best,
            one.mean,
            one.lower_quartile,
            one.median,
            one.upper_quartile,
        );
        let outcome = (produced.outcome.leader, produced.outcome.failed);
        let digests = PyDigests::known(digests);
        let attempts = rows(produced.attempts);
        Ok((
            genomes,
            episodes,
            metrics,
            fitness,
            population,
            figures,
            outcome,
            digests,
            attempts,
            produced.warnings,
        ))
    }
}

impl Drop for PyProducer {
    fn drop(&mut self) {
        self.stop();
    }
}
