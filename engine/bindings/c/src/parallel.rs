//! Offloaded evaluation on several threads: each has a simulation of its own.

use std::num::NonZero;
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};
use std::sync::{Arc, Mutex, PoisonError};
use std::thread;

use swarmwright_controllers::{Architecture, Controller};
use swarmwright_worlds::{Block, Means, Parameters, measure, rollout_until};
use swarmwright_wrapper::guarded;

use crate::callbacks::Table;
use crate::foreign::Foreign;

/// How many threads are worth it for a block.
pub(crate) fn threads(means: Means, block: &Block<'_>) -> usize {
    let most = match means.threads {
        0 => thread::available_parallelism().map_or(1, NonZero::get),
        threads => threads,
    };
    most.min(block.len())
}

/// Simulations, kept for the next block.
#[derive(Default)]
pub(crate) struct WorkerGroup(Vec<Foreign>);

/// What all threads work on.
struct Task<'a> {
    block: &'a Block<'a>,
    architecture: Arc<Architecture>,
    /// By episode.
    parameters: Vec<Parameters>,
    /// The next evaluation that no thread has begun.
    next: AtomicUsize,
    failed: AtomicBool,
}

impl WorkerGroup {
    /// The fitness of every candidate in every episode, each followed by the metrics that are wanted; none if something
    /// failed: evaluated one by one it can be seen what.
    pub(crate) fn evaluate(
        &mut self,
        table: &Arc<Table>,
        block: &Block<'_>,
        threads: usize,
    ) -> Option<Vec<f64>> {
        while self.0.len() < threads {
            self.0.push(Foreign::new(table).ok()?);
        }
        let task = Task {
            block,
            architecture: Arc::new(block.architecture.clone()),
            parameters: (0..block.seeds.len())
                .map(|episode| block.parameters_of(episode))
                .collect(),
            next: AtomicUsize::new(0),
            failed: AtomicBool::new(false),
        };
        let numbers = block.numbers();
        let mut results = vec![f64::NAN; block.len() * numbers];
        let places: Vec<Mutex<&mut [f64]>> =
            results.chunks_exact_mut(numbers).map(Mutex::new).collect();
        thread::scope(|scope| {
            for simulation in self.0.iter_mut().take(threads) {
                let work = || {
                    task.failed.fetch_or(
                        guarded(|| task.work(simulation, &places)) != Ok(true),
                        Ordering::Relaxed,
                    );
                };
                if thread::Builder::new()
                    .name("evaluation".to_owned())
                    .spawn_scoped(scope, work)
                    .is_err()
                {
                    // Other threads do it, or none does and it is noticed below.
                    break;
                }
            }
        });
        drop(places);
        let complete = task.next.into_inner() >= block.len() && !task.failed.into_inner();
        complete.then_some(results)
    }
}

impl Task<'_> {
    /// Evaluates what no other thread does, until nothing is left or something fails; whether nothing failed.
    fn work(&self, simulation: &mut Foreign, places: &[Mutex<&mut [f64]>]) -> bool {
        let episodes = self.block.seeds.len();
        while !self.failed.load(Ordering::Relaxed) {
            let index = self.next.fetch_add(1, Ordering::Relaxed);
            let Some(slot) = places.get(index) else {
                break;
            };
            let genome = self.block.genome(index / episodes);
            let fitness = Controller::with_weights(&self.architecture, genome.into())
                .ok()
                .and_then(|controller| {
                    let parameters = &self.parameters[index % episodes];
                    rollout_until(simulation, parameters, &controller, self.block.stop).ok()
                });
            let Some(fitness) = fitness else {
                return false;
            };
            // No other thread has this index.
            let mut results = slot.lock().unwrap_or_else(PoisonError::into_inner);
            results[0] = fitness;
            measure(simulation, self.block.metrics, &mut results[1..]);
        }
        true
    }
}
