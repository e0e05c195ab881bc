//! Methods that search a box with members which stay until something better replaces them.

use super::swarm::Swarming;
use super::{Members, Search, Unavailable};
use crate::differential::Differential;
use crate::stream::{Stream, Streams, purpose_key, rows_of_two};
use crate::swarm::rounded;

/// Genes that are made in little more time than another thread takes to begin.
const FEW: usize = 1 << 12;

/// What competes with the members.
#[derive(Debug, Clone)]
pub enum Challenger {
    /// A trial vector for each member (Storn and Price, Journal of Global Optimization 11, 1997).
    Differential(Differential),
    /// A particle for each member (Kennedy and Eberhart, ICNN 1995).
    Swarm(Swarming),
}

/// Members in a box, and as many candidates that compete with them in each generation.
#[derive(Debug, Clone)]
pub struct Bounded {
    challenger: Challenger,
    seed: u64,
    purpose: u64,
    generation: u64,
    lower: Vec<f64>,
    upper: Vec<f64>,
    /// Rows; the first generation, as long as it has not been told.
    members: Vec<f32>,
    /// Empty as long as no generation has been told.
    fitness: Vec<f64>,
}

impl Bounded {
    /// `address`: seed and kind. `first`: genomes of the first generation, rows of as many genes as the box has.
    ///
    /// # Panics
    ///
    /// When lengths do not fit together.
    #[must_use]
    pub fn new(
        (seed, kind): (u64, &str),
        (lower, upper): (Vec<f64>, Vec<f64>),
        first: Vec<f32>,
        challenger: Challenger,
    ) -> Self {
        assert_eq!(lower.len(), upper.len());
        assert!(first.len().is_multiple_of(lower.len().max(1)));
        Self {
            challenger,
            seed,
            purpose: purpose_key(&format!("{kind}.candidate")),
            generation: 0,
            lower,
            upper,
            members: first,
            fitness: Vec::new(),
        }
    }

    /// The best member, the first of equals.
    fn best(&self) -> usize {
        let mut best = 0;
        for (index, fitness) in self.fitness.iter().enumerate() {
            if *fitness > self.fitness[best] || (self.fitness[best].is_nan() && !fitness.is_nan()) {
                best = index;
            }
        }
        best
    }

    fn candidates(&mut self) -> Vec<f32> {
        let genes = self.lower.len();
        let mut genomes = vec![0.0; self.members.len()];
        let best = self.best();
        let (lower, upper) = (&self.lower[..], &self.upper[..]);
        match &mut self.challenger {
            Challenger::Swarm(swarm) => {
                let streams = Streams {
                    seed: self.seed,
                    purpose: self.purpose,
                    generation: self.generation,
                    first: 0,
                };
                swarm.fly(&self.members, best, (lower, upper), streams, &mut genomes);
            }
            Challenger::Differential(settings) => {
                let settings = *settings;
                let count = 0..self.fitness.len() as u64;
                let mut streams = Stream::of_each(self.seed, self.purpose, self.generation, count);
                let members = &self.members[..];
                let mut none = vec![(); genomes.len()];
                let numbers = (&mut genomes[..], &mut none[..]);
                let trial = |trial: &mut Vec<f64>,
                             target,
                             stream: &mut Stream,
                             genome: &mut [f32],
                             _: &mut [()]| {
                    settings.trial(members, best, target, (lower, upper), stream, trial);
                    rounded(trial, lower, upper, genome);
                };
                rows_of_two(
                    &mut streams,
                    numbers,
                    genes,
                    FEW,
                    || vec![0.0; genes],
                    trial,
                );
            }
        }
        genomes
    }
}

impl Search for Bounded {
    fn ask(&mut self) -> Result<Vec<f32>, Unavailable> {
        if self.fitness.is_empty() {
            return Ok(self.members.clone());
        }
        Ok(self.candidates())
    }

    fn tell(&mut self, genomes: &[f32], fitness: &[f64]) -> Result<(), Unavailable> {
        let genes = self.lower.len().max(1);
        assert_eq!(fitness.len(), self.members.len() / genes);
        assert_eq!(genomes.len(), self.members.len());
        let first = self.fitness.is_empty();
        let leader = self.best();
        if first {
            self.fitness = fitness.to_vec();
        } else {
            let own = self.members.chunks_exact_mut(genes).zip(&mut self.fitness);
            for ((member, before), (genome, now)) in
                own.zip(genomes.chunks_exact(genes).zip(fitness))
            {
                if now > before || (before.is_nan() && !now.is_nan()) {
                    member.copy_from_slice(genome);
                    *before = *now;
                }
            }
        }
        if let Challenger::Swarm(swarm) = &mut self.challenger {
            let width: Vec<f64> = self
                .upper
                .iter()
                .zip(&self.lower)
                .map(|(u, l)| u - l)
                .collect();
            if first {
                swarm.begin(genomes, &width, self.seed);
            } else {
                swarm.land(genomes);
                swarm.adapt(&self.members, leader, &width, (self.seed, self.generation));
            }
        }
        self.generation += 1;
        Ok(())
    }

    fn members(&self) -> Option<Members<'_>> {
        let count = if self.fitness.is_empty() {
            0
        } else {
            self.members.len()
        };
        Some(Members {
            genomes: &self.members[..count],
            fitness: &self.fitness,
        })
    }

    fn rescore(&mut self, fitness: &[f64]) {
        self.fitness = fitness.to_vec();
    }

    fn state(&self, name: &str) -> Option<Vec<f64>> {
        match &self.challenger {
            Challenger::Swarm(swarm) => swarm.state(name),
            Challenger::Differential(_) => None,
        }
    }
}
