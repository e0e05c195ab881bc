//! Natural evolution strategies: weights by rank move center and shape of a normal distribution; new starts (Wierstra et al., JMLR 15, 2014).

use super::gaussian::{Sample, Space, count, limited};
use super::{Search, Starts, Unavailable};
use crate::exact::exact_sum;
use crate::matrix::{exponential, product};
use crate::sample::GaussianSample;
use crate::sampling::add_weighted_products;
use crate::shaping::utilities;

/// Where all standard deviations are below this share of the first ones, a search is over.
const CONVERGED: f64 = 1e-3;

/// What happens when a search is over.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Restart {
    /// It goes on all the same.
    None,
    /// It begins anew elsewhere.
    Same,
    /// It begins anew elsewhere with twice the population.
    Doubled,
}

/// What is learnt of the distribution.
#[derive(Debug, Clone, PartialEq)]
pub enum Shape {
    /// A standard deviation of each gene.
    Separable(Vec<f64>),
    /// A standard deviation, and a matrix by which directions are turned and stretched.
    Full(f64, Vec<f64>),
}

/// Settings of a natural evolution strategy.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct NesSettings {
    /// Genomes of each generation at first.
    pub population: usize,
    /// First standard deviation.
    pub step: f64,
    /// How fast standard deviations are learnt.
    pub rate: f64,
    /// Whether only a standard deviation of each gene is learnt.
    pub separable: bool,
    /// Reaction to a stopping criterion.
    pub restart: Restart,
}

/// A natural evolution strategy.
pub struct Nes {
    sample: Sample,
    shape: Shape,
    settings: NesSettings,
    /// Genes of a new start in a generation.
    starts: Starts,
    /// Generations in which the best fitness has been the same.
    unchanged: usize,
    best: f64,
}

impl Nes {
    /// `address`: seed and kind. `start`: genes of the first center. `starts`: those of the next ones, by generation.
    #[must_use]
    pub fn new(
        address: (u64, &str),
        space: Space,
        start: Option<&[f64]>,
        settings: NesSettings,
        starts: Starts,
    ) -> Self {
        let genes = space.genes();
        Self {
            sample: Sample::new(address, space, start, settings.population, false),
            shape: settings.shape(genes),
            settings,
            starts,
            unchanged: 0,
            best: f64::NAN,
        }
    }

    fn follow(&mut self, weights: &[f64]) {
        let rate = self.settings.rate;
        let toward = self.sample.weighted(weights);
        let genes = toward.len();
        match &mut self.shape {
            Shape::Separable(deviation) => {
                // The weights add up to 0, so that of z^2 - 1 nothing but z^2 is left.
                let widening = self.sample.weighted_squares(weights);
                let step = deviation.iter().zip(&toward);
                self.sample
                    .shift(step.map(|(deviation, along)| deviation * along));
                for (deviation, wider) in deviation.iter_mut().zip(widening) {
                    *deviation = limited(*deviation * libm::exp(rate / 2.0 * wider));
                }
            }
            Shape::Full(step, matrix) => {
                let turned = product(&toward, &transposed(matrix, genes), genes);
                self.sample.shift(turned.iter().map(|along| *step * along));
                // The weights add up to 0, so that the identity matrix has no part in the gradient.
                let mut gradient = vec![0.0; genes * genes];
                add_weighted_products(&self.sample.directions, weights, &mut gradient);
                let diagonal = gradient.iter().step_by(genes + 1).copied();
                let mean = exact_sum(diagonal).map_or(f64::NAN, |sum| sum / count(genes));
                *step = limited(*step * libm::exp(rate / 2.0 * mean));
                for (index, value) in gradient.iter_mut().enumerate() {
                    let own = if index % (genes + 1) == 0 { 1.0 } else { 0.0 };
                    *value = rate / 2.0 * (*value - mean * own);
                }
                if let Some(turn) = exponential(&gradient, genes) {
                    *matrix = product(matrix, &turn, genes);
                }
            }
        }
    }

    /// The largest standard deviation.
    fn widest(&self) -> f64 {
        match &self.shape {
            Shape::Separable(deviation) => deviation.iter().copied().fold(f64::MIN, f64::max),
            Shape::Full(step, matrix) => {
                let rows = matrix.chunks_exact(self.sample.space.genes().max(1));
                let squares = rows.map(|row| {
                    exact_sum(row.iter().map(|value| value * value)).unwrap_or(f64::INFINITY)
                });
                step * squares.fold(f64::MIN, f64::max).sqrt()
            }
        }
    }

    /// Whether going on from here makes no sense.
    fn is_over(&self) -> bool {
        let patience =
            10.0 + 30.0 * count(self.sample.space.genes()) / count(self.sample.population);
        count(self.unchanged) >= patience || self.widest() < CONVERGED * self.settings.step
    }

    fn begin_anew(&mut self) -> Result<(), Unavailable> {
        if self.settings.restart == Restart::Doubled {
            self.sample.resize(2 * self.sample.population);
        }
        self.unchanged = 0;
        let genes = (self.starts)(self.sample.generation())?;
        self.sample.center = self.sample.space.point(&genes);
        self.shape = self.settings.shape(genes.len());
        Ok(())
    }
}

impl NesSettings {
    /// That of a new start.
    fn shape(&self, genes: usize) -> Shape {
        if self.separable {
            return Shape::Separable(vec![self.step; genes]);
        }
        let mut matrix = vec![0.0; genes * genes];
        matrix
            .iter_mut()
            .step_by(genes + 1)
            .for_each(|entry| *entry = 1.0);
        Shape::Full(self.step, matrix)
    }
}

impl Search for Nes {
    fn ask(&mut self) -> Result<Vec<f32>, Unavailable> {
        self.sample.draw();
        let directions = &self.sample.directions;
        Ok(match &self.shape {
            Shape::Separable(deviation) => self.sample.genomes(directions, deviation),
            Shape::Full(step, matrix) => {
                let genes = self.sample.space.genes();
                let directions: Vec<f64> = directions.iter().copied().map(f64::from).collect();
                let turned = product(&directions, &transposed(matrix, genes), genes);
                self.sample.genomes(&turned, &vec![*step; genes])
            }
        })
    }

    fn draw(&mut self) -> Result<Option<usize>, Unavailable> {
        if let Shape::Full(..) = self.shape {
            return Ok(None);
        }
        self.sample.draw();
        Ok(Some(self.sample.population))
    }

    fn tell(&mut self, _genomes: &[f32], fitness: &[f64]) -> Result<(), Unavailable> {
        assert_eq!(fitness.len(), self.sample.population);
        if fitness.iter().all(|value| value.is_nan()) {
            return Ok(());
        }
        self.follow(&utilities(fitness));
        // max leaves NaN out.
        let best = fitness.iter().copied().fold(f64::NAN, f64::max);
        self.unchanged = if best == self.best {
            self.unchanged + 1
        } else {
            0
        };
        self.best = best;
        if self.settings.restart != Restart::None && self.is_over() {
            return self.begin_anew();
        }
        Ok(())
    }

    fn drawn(&self) -> Option<GaussianSample<'_>> {
        match &self.shape {
            Shape::Separable(deviation) => Some(self.sample.drawn(deviation)),
            Shape::Full(..) => None,
        }
    }

    fn state(&self, name: &str) -> Option<Vec<f64>> {
        match (name, &self.shape) {
            ("widest", _) => Some(vec![self.widest()]),
            ("deviation", Shape::Separable(deviation)) => Some(deviation.clone()),
            ("deviation", Shape::Full(step, matrix)) => {
                Some(matrix.iter().map(|value| step * value).collect())
            }
            _ => self.sample.state(name),
        }
    }
}

fn transposed(matrix: &[f64], size: usize) -> Vec<f64> {
    let at = |index: usize| matrix[index % size * size + index / size];
    (0..matrix.len()).map(at).collect()
}
