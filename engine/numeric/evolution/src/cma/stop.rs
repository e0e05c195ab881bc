//! When going on makes no sense: the criteria of the library cma, by their names there.

use super::count;
use super::full::Full;

/// Least range of fitness.
const TOLFUN: f64 = 1e-11;
/// Least range of the best fitness of generations.
const TOLFUNHIST: f64 = 1e-12;
/// Least standard deviation, in multiples of the initial range's half.
const TOLX: f64 = 1e-11;
/// Largest standard deviation, in multiples of the first one.
const TOLFACUPX: f64 = 1e3;
/// Generations that are flat at most.
const TOLFLATFITNESS: u32 = 1;
/// Interval between the generations that are kept to detect stagnation.
const SPARSE: u32 = 5;
/// So many are kept at most.
const LONGEST: usize = 20_000;

/// Why going on makes no sense.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Stop {
    /// Numbers are no longer finite: not even a sample can be drawn.
    Infinite,
    /// The fitness of the last generation, and the best of each of the last ones, hardly differ.
    Tolfun,
    /// The best fitness of each of the last generations hardly differs.
    Tolfunhist,
    /// Three quarters of a generation have the best fitness, twice in a row.
    Tolflatfitness,
    /// All standard deviations are tiny.
    Tolx,
    /// A standard deviation has become a thousand times as large as at first.
    Tolfacupx,
    /// The best and the median fitness have not become better for long.
    Tolstagnation,
    /// Eigenvalues of the covariance matrix differ by a factor of 1e14.
    Tolconditioncov,
    /// A tenth of a standard deviation along an axis does not change the mean.
    Noeffectaxis,
    /// A fifth of a gene's standard deviation does not change its mean.
    Noeffectcoord,
    /// There have been very many generations for this number of genes.
    Maxiter,
}

impl Stop {
    /// The name in the library.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Infinite => "infinite",
            Self::Tolfun => "tolfun",
            Self::Tolfunhist => "tolfunhist",
            Self::Tolflatfitness => "tolflatfitness",
            Self::Tolx => "tolx",
            Self::Tolfacupx => "tolfacupx",
            Self::Tolstagnation => "tolstagnation",
            Self::Tolconditioncov => "tolconditioncov",
            Self::Noeffectaxis => "noeffectaxis",
            Self::Noeffectcoord => "noeffectcoord",
            Self::Maxiter => "maxiter",
        }
    }
}

/// The state of a search that stopping criteria examine.
pub(super) struct State<'a> {
    pub mean: &'a [f64],
    /// Standard deviation of each gene.
    pub deviations: &'a [f64],
    pub first_units: &'a [f64],
    pub units: &'a [f64],
    pub sigma: f64,
    pub covariance_path: &'a [f64],
    pub full: Option<&'a Full>,
}

/// The course of fitness so far.
#[derive(Debug, Clone)]
pub(super) struct Monitor {
    genes: usize,
    population: usize,
    first_sigma: f64,
    /// Generations told.
    generations: u32,
    /// Lowest and highest fitness of the last generation, of candidates that did not fail.
    range: [f64; 2],
    /// The best fitness of each of the last generations, the newest last.
    recent: Vec<f64>,
    /// The best and the median fitness of every fifth generation, the newest last.
    bests: Vec<f64>,
    medians: Vec<f64>,
    best: f64,
    /// When it was found.
    improved: u32,
    flat: u32,
}

impl Monitor {
    pub fn new(genes: usize, population: usize, first_sigma: f64) -> Self {
        Self {
            genes,
            population,
            first_sigma,
            generations: 0,
            range: [0.0; 2],
            recent: Vec::new(),
            bests: Vec::new(),
            medians: Vec::new(),
            best: f64::NEG_INFINITY,
            improved: 0,
            flat: 0,
        }
    }

    /// Takes the fitness of a generation; `order`: the best first, failed ones last.
    pub fn note(&mut self, fitness: &[f64], order: &[usize], generations: u32) {
        self.generations = generations;
        let ranked = |rank: usize| {
            let value = fitness[order[rank]];
            if value.is_nan() {
                f64::NEG_INFINITY
            } else {
                value
            }
        };
        let judged = fitness.iter().filter(|value| !value.is_nan()).count();
        let best = ranked(0);
        self.range = [ranked(judged.max(1) - 1), best];
        self.recent.push(best);
        let most = 10 + 30 * self.genes / self.population;
        if self.recent.len() > most {
            self.recent.remove(0);
        }
        if generations.is_multiple_of(SPARSE) {
            self.bests.push(best);
            self.medians.push(median_of(order.len(), ranked));
            if self.bests.len() > LONGEST {
                self.bests.remove(0);
                self.medians.remove(0);
            }
        }
        if best > self.best {
            (self.best, self.improved) = (best, generations);
        }
        let is_flat = ranked(0) <= ranked(order.len() * 3 / 4);
        self.flat = if is_flat { self.flat + 1 } else { 0 };
    }

    /// Why going on makes no sense, if so.
    pub fn stop(&self, state: &State<'_>) -> Option<Stop> {
        let criteria = [
            (Stop::Infinite, !state.is_finite()),
            (
                Stop::Tolfun,
                self.range[1] - self.range[0] < TOLFUN && self.recent_range() < TOLFUN,
            ),
            (
                Stop::Tolfunhist,
                self.recent.len() > 9 && self.recent_range() < TOLFUNHIST,
            ),
            (Stop::Tolflatfitness, self.flat > TOLFLATFITNESS),
            (Stop::Tolx, state.is_tiny()),
            (Stop::Tolfacupx, state.is_huge(self.first_sigma)),
            (
                Stop::Tolconditioncov,
                state.full.is_some_and(Full::is_ill_conditioned),
            ),
            (
                Stop::Noeffectaxis,
                state.has_no_effect_along(self.generations as usize % self.genes.max(1)),
            ),
            (Stop::Noeffectcoord, state.has_no_effect_on_a_gene()),
            (Stop::Tolstagnation, self.stagnates()),
            (Stop::Maxiter, f64::from(self.generations) >= self.longest()),
        ];
        criteria
            .into_iter()
            .find_map(|(stop, holds)| holds.then_some(stop))
    }

    fn recent_range(&self) -> f64 {
        let (mut least, mut most) = (f64::INFINITY, f64::NEG_INFINITY);
        for value in &self.recent {
            (least, most) = (least.min(*value), most.max(*value));
        }
        most - least
    }

    /// Generations after which a search ends in any case.
    fn longest(&self) -> f64 {
        let side = count(self.genes) + 3.0;
        100.0 + (150.0 * side * side / count(self.population).sqrt()).floor()
    }

    fn stagnates(&self) -> bool {
        let (genes, population) = (count(self.genes), count(self.population));
        let patience = (100.0 + 100.0 * genes * genes.sqrt() / population).floor();
        let length = self.bests.len();
        let part = (patience / 10.0).max(count(length) / 10.0).floor();
        let enough = f64::from(self.generations) > genes * (5.0 + 100.0 / population)
            && f64::from(self.generations - self.improved) > patience / 2.0
            && length > 100
            && 2.0 * part < count(length);
        if !enough {
            return false;
        }
        #[expect(
            clippy::cast_possible_truncation,
            clippy::cast_sign_loss,
            reason = "it is below a length"
        )]
        let part = part as usize;
        let worse = |values: &[f64]| {
            let (before, now) = values[length - 2 * part..].split_at(part);
            median(now) <= median(before)
        };
        worse(&self.medians) && worse(&self.bests)
    }
}

impl State<'_> {
    fn is_finite(&self) -> bool {
        let all = |values: &[f64]| values.iter().all(|value| value.is_finite());
        let positive = |values: &[f64]| values.iter().all(|value| *value > 0.0);
        all(self.mean)
            && all(self.deviations)
            && positive(self.deviations)
            && all(self.covariance_path)
    }

    fn is_tiny(&self) -> bool {
        (0..self.mean.len()).all(|gene| {
            let least = TOLX * self.first_units[gene];
            let path = self.sigma * self.units[gene] * self.covariance_path[gene];
            self.deviations[gene] < least && path < least
        })
    }

    fn is_huge(&self, first_sigma: f64) -> bool {
        let most = TOLFACUPX * first_sigma;
        let pairs = self.deviations.iter().zip(self.first_units);
        pairs
            .into_iter()
            .any(|(deviation, unit)| *deviation > most * unit)
    }

    fn has_no_effect_along(&self, axis: usize) -> bool {
        self.full.is_some_and(|full| {
            let along = full.axis(axis);
            (0..self.mean.len()).all(|gene| {
                let step = 0.1 * self.sigma * self.units[gene] * along[gene];
                self.mean[gene] == self.mean[gene] + step
            })
        })
    }

    fn has_no_effect_on_a_gene(&self) -> bool {
        let mut pairs = self.mean.iter().zip(self.deviations);
        pairs.any(|(mean, deviation)| *mean == mean + 0.2 * deviation)
    }
}

fn median(values: &[f64]) -> f64 {
    let mut sorted = values.to_vec();
    sorted.sort_by(|left, right| right.total_cmp(left));
    median_of(sorted.len(), |rank| sorted[rank])
}

/// The median of ranked values.
fn median_of(length: usize, ranked: impl Fn(usize) -> f64) -> f64 {
    let middle = length / 2;
    if length % 2 == 1 {
        ranked(middle)
    } else {
        ranked(middle - 1) / 2.0 + ranked(middle) / 2.0
    }
}
