//! Evolution strategies with covariance matrix adaptation: the whole state of a search, sampled and learned from.
//!
//! Hansen, "The CMA evolution strategy: a tutorial" (arXiv:1604.00772), and for diagonal matrices Ros and Hansen, "A simple
//! modification in CMA-ES achieving linear time and space complexity", PPSN 2008; constants, negative weights, the handling of
//! bounds and the criteria for stopping are those of the library cma 4.5 (doi:10.5281/zenodo.2559634).

mod bounds;
mod constants;
mod full;
mod stop;

use rayon::prelude::*;

use self::bounds::{Bounds, finite};
use self::constants::Constants;
use self::full::Full;
use self::stop::Monitor;
pub use self::stop::Stop;
use crate::linear::{add_rows, dot};
use crate::ranking::key;
use crate::stream::{Stream, normals_of_each};

/// Standard deviations are at most this share of the distance of two bounds.
const WIDEST: f64 = 1.0 / 3.0;
/// Genomes that are made together, with one pass through the matrix.
const TOGETHER: usize = 16;
/// Numbers below which other threads are not worth their start.
const FEW: usize = 1 << 13;

/// A search by a normal distribution, which follows the better half of each sample.
#[derive(Debug, Clone)]
pub struct Cma {
    constants: Constants,
    bounds: Bounds,
    /// Before the bounds' transformation, as genes.
    mean: Vec<f64>,
    /// Units of each gene; with a diagonal matrix they are what is learned of it.
    units: Vec<f64>,
    first_units: Vec<f64>,
    sigma: f64,
    /// p_sigma: where the mean has gone to, as if the distribution were round.
    step_path: Vec<f64>,
    /// p_c: where the mean has gone to, in units.
    covariance_path: Vec<f64>,
    /// None: diagonal.
    full: Option<Full>,
    /// The last sample, in units and multiples of sigma, from the mean: rows.
    steps: Vec<f64>,
    /// Squared lengths of the normal numbers of which they were made.
    lengths: Vec<f64>,
    generations: u32,
    /// (1 - c_sigma)^(2 generations)
    faded: f64,
    monitor: Monitor,
}

/// How a search begins.
#[derive(Debug, Clone, Copy)]
pub struct Start<'a> {
    /// Where, as genes.
    pub center: &'a [f64],
    /// Half of the initial range of each gene: its unit.
    pub reach: &'a [f64],
    /// Least value of each gene, minus infinity where there is none.
    pub lower: &'a [f64],
    /// Largest value of each gene, infinity where there is none.
    pub upper: &'a [f64],
    /// Standard deviation of each gene in its unit.
    pub step: f64,
    /// Genomes of each sample, at least 3.
    pub population: usize,
    /// Whether the covariance matrix stays diagonal.
    pub separable: bool,
}

impl Cma {
    /// Begins a search.
    ///
    /// # Panics
    ///
    /// When lengths do not fit together, or the population is below 3.
    #[must_use]
    pub fn new(start: Start<'_>) -> Self {
        let genes = start.center.len();
        for row in [start.reach, start.lower, start.upper] {
            assert_eq!(row.len(), genes);
        }
        let constants = Constants::new(genes, start.population, start.separable);
        let bounds = Bounds::new(start.lower, start.upper);
        let mut mean = start.center.to_vec();
        bounds.undo(&mut mean);
        let mut cma = Self {
            bounds,
            mean,
            units: start.reach.to_vec(),
            first_units: start.reach.to_vec(),
            sigma: start.step,
            step_path: vec![0.0; genes],
            covariance_path: vec![0.0; genes],
            full: (!start.separable).then(|| Full::new(genes, constants.gap(genes))),
            steps: Vec::new(),
            lengths: Vec::new(),
            generations: 0,
            faded: 1.0,
            monitor: Monitor::new(genes, start.population, start.step),
            constants,
        };
        cma.limit_deviations();
        cma
    }

    /// Genomes of a sample.
    #[must_use]
    pub fn population(&self) -> usize {
        self.constants.weights.len()
    }

    /// Draws a sample: a genome from each stream, within the bounds, rounded to binary32.
    ///
    /// # Panics
    ///
    /// When there are not as many streams and rows of `genomes` as the population has.
    pub fn ask(&mut self, streams: &mut [Stream], genomes: &mut [f32]) {
        let (genes, population) = (self.mean.len(), self.population());
        assert_eq!(streams.len(), population);
        assert_eq!(genomes.len(), population * genes);
        if let Some(full) = &mut self.full {
            full.decompose_if_due(self.generations);
        }
        let mut steps = std::mem::take(&mut self.steps);
        let mut lengths = std::mem::take(&mut self.lengths);
        steps.resize(population * genes, 0.0);
        lengths.resize(population, 0.0);
        if population * genes < FEW {
            self.sample(streams, &mut steps, &mut lengths, genomes);
        } else {
            let rows = TOGETHER * genes;
            steps
                .par_chunks_mut(rows)
                .zip(genomes.par_chunks_mut(rows))
                .zip(lengths.par_chunks_mut(TOGETHER))
                .zip(streams.par_chunks_mut(TOGETHER))
                .with_min_len(FEW.div_ceil(2 * rows))
                .for_each(|(((steps, genomes), lengths), streams)| {
                    self.sample(streams, steps, lengths, genomes);
                });
        }
        (self.steps, self.lengths) = (steps, lengths);
    }

    /// Draws a part of a sample: a row of each from each stream.
    #[expect(clippy::cast_possible_truncation, reason = "genomes are binary32")]
    fn sample(
        &self,
        streams: &mut [Stream],
        steps: &mut [f64],
        lengths: &mut [f64],
        genomes: &mut [f32],
    ) {
        let genes = self.mean.len().max(1);
        normals_of_each(streams, genes, steps);
        if let Some(full) = &self.full {
            for (step, length) in steps.chunks_exact(genes).zip(lengths) {
                *length = dot(step, step);
            }
            full.shape(steps);
        }
        let bounded = self.bounds.any();
        let scale: Vec<f64> = self.units.iter().map(|unit| self.sigma * unit).collect();
        let rows = steps
            .chunks_exact(genes)
            .zip(genomes.chunks_exact_mut(genes));
        for (step, genome) in rows {
            for (gene, slot) in genome.iter_mut().enumerate() {
                let value = self.mean[gene] + scale[gene] * step[gene];
                *slot = if bounded {
                    self.bounds.within(gene, value) as f32
                } else {
                    finite(value) as f32
                };
            }
        }
    }

    /// Learns from the fitness of the last sample, of which NaN is worst; returns why going on makes no sense, if so.
    ///
    /// # Panics
    ///
    /// When there is no sample, or not a value for each of its genomes.
    pub fn tell(&mut self, fitness: &[f64]) -> Option<Stop> {
        assert_eq!(self.lengths.len(), self.population());
        assert_eq!(fitness.len(), self.population());
        let order = best_first(fitness);
        self.generations += 1;
        self.monitor.note(fitness, &order, self.generations);
        let shift = self.weighted(&order[..self.constants.parents]);
        for (gene, value) in self.mean.iter_mut().enumerate() {
            *value += self.sigma * self.units[gene] * shift[gene];
        }
        let stalled = self.lengthen_paths(&shift);
        let lost = if stalled {
            let keep = self.constants.c_c;
            self.constants.c_1 * keep * (2.0 - keep)
        } else {
            0.0
        };
        match &mut self.full {
            Some(full) => full.learn(
                &self.constants,
                lost,
                &self.covariance_path,
                &self.steps,
                &self.lengths,
                &order,
            ),
            None => self.learn_units(lost, &order),
        }
        let excess = dot(&self.step_path, &self.step_path).sqrt() / self.constants.expected - 1.0;
        let change = excess * self.constants.c_sigma / self.constants.damping;
        self.sigma *= libm::exp(change.clamp(-1.0, 1.0));
        self.limit_deviations();
        self.stop()
    }

    /// The steps of some genomes times their weights.
    fn weighted(&self, order: &[usize]) -> Vec<f64> {
        let genes = self.mean.len();
        let mut sum = vec![0.0; genes];
        add_rows(&mut sum, &self.constants.weights[..order.len()], |rank| {
            &self.steps[order[rank] * genes..(order[rank] + 1) * genes]
        });
        sum
    }

    /// Returns whether the path of the step size is so long that that of the covariance is stalled (h_sigma = 0).
    fn lengthen_paths(&mut self, shift: &[f64]) -> bool {
        let constants = &self.constants;
        let round = match &self.full {
            Some(full) => full.unshape(shift),
            None => shift.to_vec(),
        };
        extend(
            &mut self.step_path,
            &round,
            constants.c_sigma,
            constants.effective,
        );
        let retained = 1.0 - constants.c_sigma;
        self.faded *= retained * retained;
        let genes = count(self.mean.len());
        let length = dot(&self.step_path, &self.step_path) / (1.0 - self.faded) / genes;
        let stalled = length >= 2.0 + 4.0 / (genes + 1.0);
        let effective = if stalled { 0.0 } else { constants.effective };
        extend(&mut self.covariance_path, shift, constants.c_c, effective);
        stalled
    }

    /// Changes the unit of each gene by its variance in the sample.
    fn learn_units(&mut self, lost: f64, order: &[usize]) {
        let genes = self.mean.len();
        let (rank_one, all) = (self.constants.c_1 - lost, self.constants.c_mu);
        let mut sum = vec![0.0; genes];
        for (value, along) in sum.iter_mut().zip(&self.covariance_path) {
            *value = rank_one * (along * along);
        }
        let mut total = rank_one;
        for (weight, index) in self.constants.weights.iter().zip(order) {
            let weight = all * weight;
            total += weight;
            let step = &self.steps[index * genes..(index + 1) * genes];
            for (value, along) in sum.iter_mut().zip(step) {
                *value += weight * (along * along);
            }
        }
        for (unit, value) in self.units.iter_mut().zip(&sum) {
            *unit *= libm::exp(std::f64::consts::LN_2 * (value - total) / 2.0);
        }
    }

    /// Makes units smaller where the standard deviation is large for the distance of the bounds.
    fn limit_deviations(&mut self) {
        for gene in 0..self.mean.len() {
            let most = WIDEST * self.bounds.width(gene);
            if most.is_finite() {
                let deviation = self.deviation(gene);
                if deviation > most {
                    self.units[gene] *= most / deviation;
                }
            }
        }
    }

    /// Standard deviation of a gene.
    fn deviation(&self, gene: usize) -> f64 {
        let own = self.full.as_ref().map_or(1.0, |full| full.deviation(gene));
        self.sigma * self.units[gene] * own
    }

    fn stop(&mut self) -> Option<Stop> {
        let deviations: Vec<f64> = (0..self.mean.len())
            .map(|gene| self.deviation(gene))
            .collect();
        let state = stop::State {
            mean: &self.mean,
            deviations: &deviations,
            first_units: &self.first_units,
            units: &self.units,
            sigma: self.sigma,
            covariance_path: &self.covariance_path,
            full: self.full.as_ref(),
        };
        self.monitor.stop(&state)
    }

    /// The mean of the distribution, as genes before the transformation into the bounds.
    #[must_use]
    pub fn mean(&self) -> &[f64] {
        &self.mean
    }

    /// The step size, by which all else is multiplied.
    #[must_use]
    pub fn sigma(&self) -> f64 {
        self.sigma
    }

    /// The evolution path of the step size.
    #[must_use]
    pub fn step_path(&self) -> &[f64] {
        &self.step_path
    }

    /// The evolution path of the covariance matrix, in units.
    #[must_use]
    pub fn covariance_path(&self) -> &[f64] {
        &self.covariance_path
    }

    /// The unit of each gene.
    #[must_use]
    pub fn units(&self) -> &[f64] {
        &self.units
    }

    /// The covariance matrix in units, without the step size; `None` if it is the identity.
    #[must_use]
    pub fn covariance(&self) -> Option<&[f64]> {
        self.full.as_ref().map(Full::covariance)
    }
}

/// Extends an evolution path by a shift.
fn extend(path: &mut [f64], shift: &[f64], rate: f64, effective: f64) {
    let (retained, added) = (1.0 - rate, (rate * (2.0 - rate) * effective).sqrt());
    for (value, along) in path.iter_mut().zip(shift) {
        *value = retained * *value + added * along;
    }
}

/// Indices by fitness, the largest first, failed ones last, equals in their order.
fn best_first(fitness: &[f64]) -> Vec<usize> {
    let mut order: Vec<usize> = (0..fitness.len()).collect();
    order.sort_by_cached_key(|index| key(fitness[*index]));
    order
}

#[expect(
    clippy::cast_precision_loss,
    reason = "numbers of genes and genomes are small"
)]
fn count(number: usize) -> f64 {
    number as f64
}
