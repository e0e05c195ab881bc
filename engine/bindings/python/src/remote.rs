//! Generations of a producer that simulation servers evaluate.

use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};

use pyo3::prelude::*;
use serde_json::{Map, Value};
use swarmwright_controllers::Architecture;
use swarmwright_pool::{About, Attempt, Pool, PoolError, Warning, Work};
use swarmwright_protocol::Sample;

use crate::conversation::Candidates;
use crate::errors::input;
use crate::pool::error;
use crate::sample::genomes_of;

/// A pool, and what it evaluates generation after generation.
pub struct Servers {
    pub pool: Pool,
    pub architecture: Arc<Architecture>,
    pub specification: Map<String, Value>,
    /// Name of the run, for those who watch.
    pub run: String,
    /// The next generation.
    pub generation: u64,
    /// Generations that the run is expected to have.
    pub expected: Arc<AtomicU64>,
}

/// What came out of a generation.
pub struct Evaluated {
    /// Those that were evaluated; none of a sample.
    pub genomes: Vec<f32>,
    /// (candidates, episodes)
    pub fitness: Vec<f64>,
    /// (candidates, episodes, metrics)
    pub metrics: Vec<f64>,
    pub attempts: Vec<Attempt>,
    pub warnings: Vec<Warning>,
}

impl Servers {
    /// Evaluates a generation; None when `go_on` said no. `sample`: what genomes are made from, where that is known.
    pub fn evaluate(
        &mut self,
        request: Candidates,
        sample: Option<Sample>,
        seeds: &[u64],
        go_on: impl Fn() -> bool,
        on_progress: impl FnMut(usize, &str),
    ) -> PyResult<Option<Evaluated>> {
        self.pool.set_about(About {
            run: Some(self.run.clone()),
            generation: Some(self.generation),
            generations: Some(self.expected.load(Ordering::Relaxed)),
            ..About::default()
        });
        self.generation += 1;
        let (architecture, specification) = (self.architecture.clone(), self.specification.clone());
        let seeds = seeds.to_vec();
        let work = match (request, sample) {
            (Candidates::Sample(sample), _) => {
                Work::drawn(architecture, specification, *sample, genomes_of, seeds)
            }
            (Candidates::Genomes(genomes), None) => {
                Work::of(architecture, specification, genomes, seeds)
            }
            (Candidates::Genomes(genomes), Some(sample)) => {
                Work::of(architecture, specification, genomes, seeds)
                    .and_then(|work| work.sampled(sample))
            }
        };
        let work = work.map_err(input)?;
        let (results, genomes) = match self.pool.evaluate_while(work, go_on, on_progress) {
            Ok(outcome) => outcome,
            Err(PoolError::Interrupted) => return Ok(None),
            Err(failed) => return Err(error(&failed)),
        };
        Ok(Some(Evaluated {
            genomes,
            fitness: results.fitness,
            metrics: results.metrics,
            attempts: self.pool.take_journal(),
            warnings: self.pool.take_warnings(),
        }))
    }
}
