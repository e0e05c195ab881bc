//! Methods that draw each generation from a normal distribution around a center and climb along a gradient.

use super::adam::Adam;
use super::ahead::{Address, Ahead};
use super::{Search, Unavailable};
use crate::sample::GaussianSample;
use crate::sampling::{Scale, add_weighted, add_weighted_squares, samples};
use crate::shaping::centered_ranks;
use crate::stream::purpose_key;

/// Standard deviations between which nothing overflows.
const LEAST: f64 = 1e-30;
const MOST: f64 = 1e30;

/// The genes, in units in which the initial range of each is -1 to 1.
#[derive(Debug, Clone)]
pub struct Space {
    /// Value of each gene where a point is 0.
    pub middle: Vec<f64>,
    /// By how much it changes where a point changes by 1.
    pub reach: Vec<f64>,
    /// Least value of each gene.
    pub lower: Vec<f64>,
    /// Largest value.
    pub upper: Vec<f64>,
}

impl Space {
    fn scale(&self) -> Scale<'_> {
        Scale {
            middle: &self.middle,
            reach: &self.reach,
            lower: &self.lower,
            upper: &self.upper,
        }
    }

    /// Number of genes.
    pub(super) fn genes(&self) -> usize {
        self.middle.len()
    }

    /// Genes as a point.
    pub(super) fn point(&self, genes: &[f64]) -> Vec<f64> {
        let scale = self.middle.iter().zip(&self.reach);
        genes
            .iter()
            .zip(scale)
            .map(|(gene, (middle, reach))| (gene - middle) / reach)
            .collect()
    }

    fn values(&self, point: &[f64]) -> Vec<f64> {
        let scale = self.middle.iter().zip(&self.reach);
        point
            .iter()
            .zip(scale)
            .map(|(at, (middle, reach))| middle + reach * at)
            .collect()
    }
}

/// A center, and the directions of the last sample around it.
#[derive(Debug)]
pub(super) struct Sample {
    pub(super) space: Space,
    pub(super) center: Vec<f64>,
    pub(super) directions: Vec<f32>,
    /// Genomes of each generation.
    pub(super) population: usize,
    /// Whether they are pairs on opposite sides of the center: genomes 2 i and 2 i + 1.
    mirrored: bool,
    generation: u64,
    seed: u64,
    purpose: String,
    normals: Ahead,
}

impl Sample {
    /// `seed`, `kind`: address of the directions. `start`: genes of the center, instead of the middle.
    pub(super) fn new(
        (seed, kind): (u64, &str),
        space: Space,
        start: Option<&[f64]>,
        population: usize,
        mirrored: bool,
    ) -> Self {
        let purpose = format!("{kind}.direction");
        let center = match start {
            Some(genes) => space.point(genes),
            None => vec![0.0; space.genes()],
        };
        let mut sample = Self {
            center,
            directions: Vec::new(),
            population,
            mirrored,
            generation: 0,
            seed,
            normals: Ahead::new(Address {
                seed,
                purpose: purpose_key(&purpose),
                rows: 0,
                length: 0,
            }),
            purpose,
            space,
        };
        sample.resize(population);
        sample
    }

    /// Changes the number of genomes of the next generations.
    pub(super) fn resize(&mut self, population: usize) {
        self.population = population;
        let rows = if self.mirrored {
            population / 2
        } else {
            population
        };
        self.normals = Ahead::new(Address {
            seed: self.seed,
            purpose: purpose_key(&self.purpose),
            rows: rows as u64,
            length: self.space.genes(),
        });
    }

    /// Draws standard normal directions, one for each genome or for each pair.
    pub(super) fn draw(&mut self) {
        self.directions = self.normals.draw(self.generation);
        self.generation += 1;
    }

    /// The generation whose directions were drawn last.
    pub(super) fn generation(&self) -> u64 {
        self.generation.saturating_sub(1)
    }

    /// Genomes at the center plus (and minus) `deviation` times each direction.
    pub(super) fn genomes<T: Copy + Into<f64> + Sync>(
        &self,
        directions: &[T],
        deviation: &[f64],
    ) -> Vec<f32> {
        let mut genomes = vec![0.0; self.population * self.space.genes()];
        let scale = self.space.scale();
        samples(
            directions,
            &self.center,
            deviation,
            scale,
            self.mirrored,
            &mut genomes,
        );
        genomes
    }

    /// What the genomes asked for last were made from, with these standard deviations.
    pub(super) fn drawn<'a>(&'a self, deviation: &'a [f64]) -> GaussianSample<'a> {
        GaussianSample {
            seed: self.seed,
            purpose: &self.purpose,
            generation: self.generation(),
            mirrored: self.mirrored,
            center: &self.center,
            deviation,
            scale: self.space.scale(),
        }
    }

    /// The sum of the directions times their weights.
    pub(super) fn weighted(&self, weights: &[f64]) -> Vec<f64> {
        let mut sum = vec![0.0; self.space.genes()];
        add_weighted(&self.directions, weights, &mut sum);
        sum
    }

    /// The same of the squares of the directions.
    pub(super) fn weighted_squares(&self, weights: &[f64]) -> Vec<f64> {
        let mut sum = vec![0.0; self.space.genes()];
        add_weighted_squares(&self.directions, weights, &mut sum);
        sum
    }

    /// Moves the center, and keeps it within the bounds of the genes.
    pub(super) fn shift(&mut self, step: impl Iterator<Item = f64>) {
        let space = &self.space;
        for (gene, (value, along)) in self.center.iter_mut().zip(step).enumerate() {
            let (middle, reach) = (space.middle[gene], space.reach[gene]);
            let lower = (space.lower[gene] - middle) / reach;
            let upper = (space.upper[gene] - middle) / reach;
            *value = clip(*value + along, lower, upper);
        }
    }

    /// The state that every such method has.
    pub(super) fn state(&self, name: &str) -> Option<Vec<f64>> {
        match name {
            "center" => Some(self.space.values(&self.center)),
            "directions" => Some(self.directions.iter().copied().map(f64::from).collect()),
            #[expect(clippy::cast_precision_loss, reason = "populations are small")]
            "population" => Some(vec![self.population as f64]),
            _ => None,
        }
    }
}

/// A number within limits; NaN passes.
pub(super) fn clip(value: f64, lower: f64, upper: f64) -> f64 {
    let value = if value < lower { lower } else { value };
    if value > upper { upper } else { value }
}

/// Within limits in which nothing overflows.
pub(super) fn limited(deviation: f64) -> f64 {
    clip(deviation, LEAST, MOST)
}

/// What an evolution strategy of pairs learns, besides its center.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Learning {
    /// Nothing; its weights decay (Salimans et al., arXiv:1703.03864).
    Decay(f64),
    /// The standard deviation of each gene (Sehnke et al., Neural Networks 23, 2010).
    Deviations {
        /// How fast.
        rate: f64,
        /// Largest change in a generation, as a share.
        change: f64,
    },
}

/// An evolution strategy of pairs on opposite sides of a center, which Adam moves.
#[derive(Debug)]
pub struct Gaussian {
    sample: Sample,
    deviation: Vec<f64>,
    adam: Adam,
    learning: Learning,
}

impl Gaussian {
    /// `address`: seed and kind. `start`: genes of the center. `population`: an even number. `noise`: standard deviation of the
    /// genomes. `step`: that of Adam.
    #[must_use]
    pub fn new(
        address: (u64, &str),
        space: Space,
        start: Option<&[f64]>,
        population: usize,
        (noise, step): (f64, f64),
        learning: Learning,
    ) -> Self {
        let genes = space.genes();
        Self {
            sample: Sample::new(address, space, start, population, true),
            deviation: vec![noise; genes],
            adam: Adam::new(step, genes),
            learning,
        }
    }

    fn learn(&mut self, fitness: &[f64]) {
        let ranks = centered_ranks(fitness);
        let pairs = || ranks.chunks_exact(2).map(|pair| (pair[0], pair[1]));
        match self.learning {
            Learning::Decay(decay) => {
                let weights: Vec<f64> = pairs().map(|(plus, minus)| plus - minus).collect();
                let mut gradient = self.sample.weighted(&weights);
                let all = count(fitness.len());
                for (value, center) in gradient.iter_mut().zip(&self.sample.center) {
                    *value = *value / all - decay * center;
                }
                self.adam.climb(&mut gradient);
                self.sample.shift(gradient.into_iter());
            }
            Learning::Deviations { rate, change } => {
                let half = count(fitness.len()) / 2.0;
                let weights: Vec<f64> = pairs().map(|(plus, minus)| (plus - minus) / 2.0).collect();
                let mut gradient = self.sample.weighted(&weights);
                for (value, deviation) in gradient.iter_mut().zip(&self.deviation) {
                    *value = deviation * *value / half;
                }
                self.adam.climb(&mut gradient);
                self.sample.shift(gradient.into_iter());
                // The ranks add up to 0, so that of z^2 - 1 nothing but z^2 is left.
                let means: Vec<f64> = pairs().map(|(plus, minus)| (plus + minus) / 2.0).collect();
                let squares = self.sample.weighted_squares(&means);
                for (deviation, square) in self.deviation.iter_mut().zip(squares) {
                    let change = clip(rate * square / half, -change, change);
                    *deviation = limited(*deviation * (1.0 + change));
                }
            }
        }
    }
}

impl Search for Gaussian {
    fn ask(&mut self) -> Result<Vec<f32>, Unavailable> {
        self.sample.draw();
        Ok(self
            .sample
            .genomes(&self.sample.directions, &self.deviation))
    }

    fn draw(&mut self) -> Result<Option<usize>, Unavailable> {
        self.sample.draw();
        Ok(Some(self.sample.population))
    }

    fn tell(&mut self, _genomes: &[f32], fitness: &[f64]) -> Result<(), Unavailable> {
        assert_eq!(fitness.len(), self.sample.population);
        if fitness.iter().any(|value| !value.is_nan()) {
            self.learn(fitness);
        }
        Ok(())
    }

    fn drawn(&self) -> Option<GaussianSample<'_>> {
        Some(self.sample.drawn(&self.deviation))
    }

    fn state(&self, name: &str) -> Option<Vec<f64>> {
        match name {
            "deviation" => Some(self.deviation.clone()),
            "momentum" => Some(self.adam.mean().to_vec()),
            _ => self.sample.state(name),
        }
    }
}

#[expect(clippy::cast_precision_loss, reason = "populations are small")]
pub(super) fn count(number: usize) -> f64 {
    number as f64
}
