//! What the thread that evolves does.

use std::sync::Arc;
use std::sync::atomic::Ordering;
use std::time::{Duration, Instant};

use pyo3::prelude::*;
use swarmwright_evolution::{Aggregate, Outcome};

use super::queue::{Produced, ProducedGenomes, Shared};
use crate::conversation::{Candidates, Conversation};
use crate::local::{Evaluation, lock};
use crate::remote::{Evaluated, Servers};
use crate::results::apart;
use crate::sample::genomes_of;

/// A generation that takes longer than this is handed over at once, a quicker one with others: waking a thread takes as long as a
/// tenth of a small generation.
const QUICK: Duration = Duration::from_micros(500);

/// The place where candidates are evaluated.
pub enum Place {
    Here(Arc<Evaluation>),
    Servers(Box<Servers>),
}

/// What the thread works on.
pub struct Work {
    pub conversation: Conversation,
    pub place: Place,
    /// Seed of the first episode of the first generation, and by how much it grows from one to the next.
    pub seed: u64,
    pub growth: u64,
    pub episodes: usize,
    pub aggregate: Aggregate,
    pub limits: Limits,
    /// Whether the store keeps samples instead of the genomes that are made from them.
    pub samples: bool,
}

/// Limits at which the thread ends.
pub struct Limits {
    pub generations: u64,
    /// Evaluations that the whole run may have, and those that it has had.
    pub evaluations: Option<(u64, u64)>,
    pub target: Option<f64>,
}

impl Limits {
    /// Whether a generation of this many candidates exceeds the limits.
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
    /// Evolves until a limit is reached, the receiver has ended, or something fails.
    pub fn run(&mut self, shared: &Shared) -> PyResult<()> {
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
        let request = self.ask()?;
        let candidates = request.candidates(self.conversation.genes());
        if self.limits.excludes(candidates) {
            return Ok(None);
        }
        shared.done.store(0, Ordering::Relaxed);
        let total = candidates * seeds.len();
        shared.total.store(total, Ordering::Relaxed);
        let is_made = matches!(request, Candidates::Genomes(_));
        let Some(results) = self.evaluate(request, candidates, seeds, shared)? else {
            return Ok(None);
        };
        let fitness = self.aggregate.of_rows(results.fitness.clone(), seeds.len());
        let sample = if self.samples {
            self.conversation.short_sample(candidates)
        } else {
            None
        };
        let genomes = if is_made {
            self.conversation.tell_taken(results.genomes, &fitness)?
        } else {
            self.conversation.tell_sample(&fitness)?;
            Vec::new()
        };
        let genomes = sample.map_or(ProducedGenomes::Genomes(genomes), |sample| {
            ProducedGenomes::Sample(Box::new(sample))
        });
        let population = self.conversation.members();
        Ok(Some(Produced {
            outcome: Outcome::of(&fitness),
            summary: None,
            genomes,
            episodes: results.fitness,
            metrics: results.metrics,
            fitness,
            population,
            attempts: results.attempts,
            warnings: results.warnings,
        }))
    }

    /// What is to be evaluated next: servers make the genomes of a sample themselves, and a store that keeps samples needs none.
    fn ask(&mut self) -> PyResult<Candidates> {
        match self.place {
            Place::Servers(_) if self.samples => self.conversation.draw(),
            _ => self.conversation.take().map(Candidates::Genomes),
        }
    }

    /// What came out of a generation; None when it was interrupted.
    fn evaluate(
        &mut self,
        request: Candidates,
        candidates: usize,
        seeds: &[u64],
        shared: &Shared,
    ) -> PyResult<Option<Evaluated>> {
        let go_on = || !shared.stopped.load(Ordering::Relaxed);
        let (evaluation, genomes) = match (&mut self.place, request) {
            (Place::Here(evaluation), Candidates::Genomes(genomes)) => (evaluation, genomes),
            (Place::Here(evaluation), Candidates::Sample(sample)) => {
                (evaluation, genomes_of(&sample))
            }
            (Place::Servers(servers), request) => {
                let sample = match request {
                    Candidates::Genomes(_) => self.conversation.sample(candidates),
                    Candidates::Sample(_) => None,
                };
                return servers.evaluate(request, sample, seeds, go_on, |done, waiting_for| {
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
