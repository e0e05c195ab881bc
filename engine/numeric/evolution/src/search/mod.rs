//! Methods as conversations: they ask for evaluations and learn from what came out, generation after generation.

mod adam;
mod ahead;
mod bounded;
mod evostick;
mod gaussian;
mod genetic;
mod neat;
mod nes;
mod restarts;
mod swarm;

pub use bounded::{Bounded, Challenger};
pub use evostick::{Evostick, EvostickSettings};
pub use gaussian::{Gaussian, Learning, Space};
pub use genetic::{Genetic, GeneticSettings, Operators, Variation};
pub use neat::{Neat, NeatSettings};
pub use nes::{Nes, NesSettings, Restart, Shape};
pub use restarts::{CmaSearch, CmaSettings, Restarts};
pub use swarm::{SwarmSettings, Swarming};

use crate::sample::GaussianSample;

/// A function of the caller that makes starts or genomes has failed. Details are with the caller, who has the function's error.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Unavailable;

/// Genes of a new start, by its number.
pub type Starts = Box<dyn Fn(u64) -> Result<Vec<f64>, Unavailable> + Send + Sync>;

/// A method that asks for whole generations.
pub trait Search: Send + Sync {
    /// The genomes to be evaluated next, row after row.
    ///
    /// # Errors
    /// A new start, or the genomes of [`Operators`] from elsewhere, could not be made.
    fn ask(&mut self) -> Result<Vec<f32>, Unavailable>;

    /// As [`ask`](Self::ask) without making the genomes, which are [`drawn`](Self::drawn) then: returns how many there are. None,
    /// and nothing is done, where they are needed.
    ///
    /// # Errors
    /// As of [`ask`](Self::ask).
    fn draw(&mut self) -> Result<Option<usize>, Unavailable> {
        Ok(None)
    }

    /// Takes the fitness of the genomes asked for last, in their order; NaN where an evaluation failed.
    ///
    /// # Errors
    /// A new start could not be made.
    ///
    /// # Panics
    ///
    /// When there are not as many values as genomes. The genomes are not needed where [`draw`](Self::draw) stood in for asking.
    fn tell(&mut self, genomes: &[f32], fitness: &[f64]) -> Result<(), Unavailable>;

    /// Fitness of the members that stay, where there are such: what the figures of a generation describe. None: those told last.
    fn members(&self) -> Option<Members<'_>> {
        None
    }

    /// Takes new fitness of the members that stay.
    fn rescore(&mut self, _fitness: &[f64]) {}

    /// Why each of its starts has ended, where it begins anew.
    fn stopped(&self) -> &[&'static str] {
        &[]
    }

    /// The sample of the last genomes until their fitness is told; `None` unless it is one of a normal
    /// distribution with a deviation for each gene.
    fn drawn(&self) -> Option<GaussianSample<'_>> {
        None
    }

    /// A part of the state, by its name.
    fn state(&self, name: &str) -> Option<Vec<f64>>;
}

/// Members that stay from one generation to the next.
#[derive(Debug, Clone, Copy)]
pub struct Members<'a> {
    /// Rows.
    pub genomes: &'a [f32],
    /// NaN: it has failed.
    pub fitness: &'a [f64],
}
