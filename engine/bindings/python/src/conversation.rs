//! A method, asked and told generation after generation.

use std::sync::{Arc, Mutex};

use pyo3::prelude::*;
use swarmwright_evolution::{Search, Unavailable};
use swarmwright_protocol::{F64s, NORMAL, Sample};

use crate::errors::{engine, input};
use crate::local::lock;
use crate::sample;

/// A method, and what it has asked for.
pub struct Conversation {
    pub search: Box<dyn Search>,
    genes: usize,
    pending: Option<Vec<f32>>,
    /// Why there was no new start, or no genomes.
    failed: Failure,
}

/// What is to be evaluated.
pub enum Candidates {
    /// (candidates, genes), row-major.
    Genomes(Vec<f32>),
    /// What they are made from.
    Sample(Box<Sample>),
}

impl Candidates {
    /// Number of candidates with `genes` genes each.
    pub fn candidates(&self, genes: usize) -> usize {
        match self {
            Self::Genomes(genomes) => genomes.len() / genes.max(1),
            Self::Sample(sample) => usize::try_from(sample.count).unwrap_or(usize::MAX),
        }
    }
}

/// Where an error of Python's goes, of which the engine knows only that there is one ([`Unavailable`]).
pub type Failure = Arc<Mutex<Option<PyErr>>>;

impl Conversation {
    /// Creates a method whose genomes have `genes` genes; its errors go to `failed`.
    pub fn new(genes: usize, search: impl Search + 'static, failed: Failure) -> Self {
        Self {
            search: Box::new(search),
            genes,
            pending: None,
            failed,
        }
    }

    /// The genomes to be evaluated: those asked for last, if their fitness is missing.
    pub fn ask(&mut self) -> PyResult<&[f32]> {
        if self.pending.is_none() {
            let genomes = self.search.ask().map_err(|error| self.reason(error))?;
            self.pending = Some(genomes);
        }
        Ok(self.pending.as_deref().unwrap_or_default())
    }

    /// Takes their fitness, and returns them.
    pub fn tell(&mut self, fitness: &[f64]) -> PyResult<Vec<f32>> {
        let genomes = match self.pending.take() {
            Some(genomes) if genomes.len() == fitness.len() * self.genes => genomes,
            other => {
                self.pending = other;
                return Err(input(
                    "expected one fitness value for each genome of the last ask",
                ));
            }
        };
        let outcome = self.search.tell(&genomes, fitness);
        outcome.map_err(|error| self.reason(error))?;
        Ok(genomes)
    }

    /// As [`ask`](Self::ask), handed over until [`tell_taken`](Self::tell_taken).
    pub fn take(&mut self) -> PyResult<Vec<f32>> {
        self.ask()?;
        Ok(self.pending.take().unwrap_or_default())
    }

    /// As [`tell`](Self::tell), for genomes that were taken.
    pub fn tell_taken(&mut self, genomes: Vec<f32>, fitness: &[f64]) -> PyResult<Vec<f32>> {
        self.pending = Some(genomes);
        self.tell(fitness)
    }

    /// As [`take`](Self::take) without making genomes that a sample stands for, in the store and for servers.
    pub fn draw(&mut self) -> PyResult<Candidates> {
        if self.pending.is_none()
            && let Some(count) = self.search.draw().map_err(|error| self.reason(error))?
        {
            if let Some(sample) = self.short_sample(count) {
                return Ok(Candidates::Sample(Box::new(sample)));
            }
            let mut genomes = vec![0.0; count * self.genes];
            if let Some(drawn) = self.search.drawn() {
                drawn.genomes_parallel(0, &mut genomes);
            }
            return Ok(Candidates::Genomes(genomes));
        }
        self.take().map(Candidates::Genomes)
    }

    /// As [`tell`](Self::tell), for a sample.
    pub fn tell_sample(&mut self, fitness: &[f64]) -> PyResult<()> {
        let outcome = self.search.tell(&[], fitness);
        outcome.map_err(|error| self.reason(error))
    }

    /// The sample of the last `count` genomes, if servers can expand it.
    pub fn sample(&self, count: usize) -> Option<Sample> {
        let drawn = self.search.drawn().filter(|_| count > 0)?;
        let row = |row: &[f64]| F64s(row.to_vec());
        let sample = Sample {
            distribution: NORMAL.to_owned(),
            seed: drawn.seed,
            purpose: drawn.purpose.to_owned(),
            generation: drawn.generation,
            first: 0,
            count: count as u64,
            mirrored: drawn.mirrored,
            center: row(drawn.center),
            deviation: row(drawn.deviation),
            middle: row(drawn.scale.middle),
            reach: row(drawn.scale.reach),
            lower: row(drawn.scale.lower),
            upper: row(drawn.scale.upper),
        };
        sample.problem().is_none().then_some(sample)
    }

    /// As [`sample`](Self::sample), where the store keeps it instead of the genomes.
    pub fn short_sample(&self, count: usize) -> Option<Sample> {
        self.sample(count).filter(sample::is_shorter)
    }

    /// Takes the fitness of the next genomes if they are those of this sample; returns whether they are.
    pub fn retell_sample(&mut self, sample: &Sample, fitness: &[f64]) -> PyResult<bool> {
        let drawn = match self.pending {
            Some(_) => None,
            None => self.search.draw().map_err(|error| self.reason(error))?,
        };
        let count = match drawn {
            Some(count) => count,
            None => self.ask()?.len() / self.genes.max(1),
        };
        let same = count == fitness.len() && self.sample(count).as_ref() == Some(sample);
        if !same {
            return Ok(false);
        }
        let genomes = self.pending.take().unwrap_or_default();
        let outcome = self.search.tell(&genomes, fitness);
        outcome.map_err(|error| self.reason(error)).map(|()| true)
    }

    /// Takes the fitness of the next genomes if they are these, bit by bit; returns whether they are.
    pub fn retell(&mut self, genomes: &[f32], fitness: &[f64]) -> PyResult<bool> {
        let expected = self.ask()?;
        let same = expected.len() == genomes.len() && are_same(expected, genomes);
        if same {
            self.tell(fitness)?;
        }
        Ok(same)
    }

    /// Number of genomes that were asked for last and have no fitness yet.
    pub fn candidate_count(&self) -> usize {
        self.pending.as_ref().map_or(0, Vec::len) / self.genes.max(1)
    }

    /// Fitness of the surviving members; `None` for methods without survivors.
    pub fn members(&self) -> Option<Vec<f64>> {
        Some(self.search.members()?.fitness.to_vec())
    }

    /// Genes of a genome.
    pub fn genes(&self) -> usize {
        self.genes
    }

    fn reason(&self, Unavailable: Unavailable) -> PyErr {
        let failed = lock(&self.failed).take();
        failed.unwrap_or_else(|| engine("a new start or new genomes could not be made"))
    }
}

/// Whether numbers have the same bits.
fn are_same(left: &[f32], right: &[f32]) -> bool {
    // A loop without a way out is one that the compiler can do in vectors.
    let differ = |(left, right): (&[f32], &[f32])| {
        let pairs = left.iter().zip(right);
        pairs.fold(0, |bits, (left, right)| {
            bits | (left.to_bits() ^ right.to_bits())
        })
    };
    left.chunks(1024)
        .zip(right.chunks(1024))
        .all(|parts| differ(parts) == 0)
}
