//! Generations between the thread that evolves and the one that stores them.

use std::collections::VecDeque;
use std::sync::atomic::{AtomicBool, AtomicU64, AtomicUsize, Ordering};
use std::sync::{Arc, Condvar, Mutex, PoisonError};
use std::time::Duration;

use pyo3::prelude::*;
use swarmwright_evolution::{Figures, Outcome};
use swarmwright_pool::{Attempt, Warning};
use swarmwright_protocol::Sample;

use crate::digests::{Columns, columns, of_genomes, of_sample};
use crate::local::lock;

/// Generations that wait at most, and how many bytes of them, unless it is a single one.
const WAITING: usize = 64;
const BYTES: usize = 1 << 25;
/// So many are handed over together where each takes little time.
const TOGETHER: usize = 8;

/// Genomes as the store keeps them.
pub enum ProducedGenomes {
    Genomes(Vec<f32>),
    Sample(Box<Sample>),
}

/// A generation that the method has been told of.
pub struct Produced {
    pub genomes: ProducedGenomes,
    pub episodes: Vec<f64>,
    pub metrics: Vec<f64>,
    pub fitness: Vec<f64>,
    /// Fitness of the population; `None` if it equals `fitness`.
    pub population: Option<Vec<f64>>,
    pub outcome: Outcome,
    /// What is computed from its columns, where it is known.
    pub summary: Option<(Columns, Figures)>,
    pub attempts: Vec<Attempt>,
    pub warnings: Vec<Warning>,
}

impl Produced {
    /// The digests of its columns, and what the fitness looks like.
    pub fn summary(&mut self) -> PyResult<(Columns, Figures)> {
        if let Some(summary) = self.summary {
            return Ok(summary);
        }
        let genomes = match &self.genomes {
            ProducedGenomes::Genomes(genomes) => of_genomes(genomes),
            ProducedGenomes::Sample(sample) => of_sample(sample)?,
        };
        let digests = columns(&self.fitness, &self.episodes, &self.metrics, genomes);
        let population = self.population.as_ref().unwrap_or(&self.fitness);
        let summary = (digests, Figures::of(population));
        self.summary = Some(summary);
        Ok(summary)
    }

    fn bytes(&self) -> usize {
        let numbers = self.episodes.len() + self.metrics.len() + 2 * self.fitness.len();
        let genomes = match &self.genomes {
            ProducedGenomes::Genomes(genomes) => size_of_val(&genomes[..]),
            ProducedGenomes::Sample(sample) => {
                sample.rows().iter().map(|(_, row)| size_of_val(*row)).sum()
            }
        };
        genomes + 8 * numbers
    }
}

#[derive(Default)]
pub struct Shared {
    queue: Mutex<Queue>,
    /// Something has come, been taken, or ended.
    changed: Condvar,
    pub stopped: AtomicBool,
    /// Number of finished episodes of the generation in progress, and of all its episodes.
    pub done: AtomicUsize,
    pub total: AtomicUsize,
    /// What is waited for.
    pub waits: Mutex<String>,
    /// Generations that the run is expected to have.
    pub expected: Arc<AtomicU64>,
}

#[derive(Default)]
struct Queue {
    waiting: VecDeque<Produced>,
    bytes: usize,
    /// There are enough to take them, until there is none.
    ready: bool,
    /// Whether the taker waits for a change.
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

    /// Whether several more fit, so that the producer need not be woken for each.
    fn fits_several(&self) -> bool {
        self.waiting.len() <= WAITING / 2 && self.bytes <= BYTES / 2
    }
}

impl Shared {
    /// Adds a generation as soon as it fits; returns whether to go on. `soon`: it is not to wait for others.
    pub fn put(&self, produced: Produced, soon: bool) -> bool {
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
                        && !queue.fits_several()
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
    pub fn is_ahead(&self) -> bool {
        lock(&self.queue).waiting.len() > TOGETHER
    }

    /// Whether there is no processor for more threads: of two, the other one is that of the taker, unless it waits.
    pub fn is_busy(&self) -> bool {
        rayon::current_num_threads() <= 2 && !lock(&self.queue).taker_waits
    }

    /// Waits for a generation; returns it, and whether nothing more comes.
    pub fn take(&self, patience: Duration) -> (Option<Produced>, bool) {
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
            if queue.producer_waits && (queue.waiting.is_empty() || queue.fits_several()) {
                self.changed.notify_all();
            }
        }
        let over = produced.is_none() && queue.over;
        (produced, over)
    }

    /// Whether `take` returns without waiting.
    pub fn is_ready(&self) -> bool {
        let queue = lock(&self.queue);
        queue.ready || queue.over
    }

    /// The error that it ended with, said once.
    pub fn failure(&self) -> Option<PyErr> {
        lock(&self.queue).failed.take()
    }

    fn end(&self, failed: Option<PyErr>) {
        let mut queue = lock(&self.queue);
        queue.over = true;
        queue.failed = queue.failed.take().or(failed);
        self.changed.notify_all();
    }

    /// Wakes both threads, so that they end.
    pub fn stop(&self) {
        let _queue = lock(&self.queue); // who waits has seen it, or is going to
        self.stopped.store(true, Ordering::Relaxed);
        self.changed.notify_all();
    }
}

/// Says that nothing more comes, also when the thread panics.
pub struct End<'a>(pub &'a Shared, pub Option<PyErr>);

impl Drop for End<'_> {
    fn drop(&mut self) {
        self.0.end(self.1.take());
    }
}
