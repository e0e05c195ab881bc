//! Trial vectors of differential evolution (Storn and Price, Journal of Global Optimization 11, 1997).

use crate::Stream;
use crate::polynomial::mutate;

/// What a difference is added to.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Base {
    /// The best member.
    Best,
    /// A random one.
    Random,
    /// The member itself; the difference is the one between the best member and another, as in pymoo.
    TargetToBest,
}

/// How a member and its mutant are mixed.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Crossover {
    /// Gene by gene, at least one of the mutant.
    Binomial,
    /// A run of genes of the mutant, at least one.
    Exponential,
    /// In between the two, each gene by a share of its own.
    Hypercube,
    /// In between the two, all genes by the same share.
    Line,
}

/// Settings of differential evolution.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Differential {
    /// What a difference is added to.
    pub base: Base,
    /// How member and mutant are mixed.
    pub crossover: Crossover,
    /// F: how much of a difference is added.
    pub factor: f64,
    /// CR, 0..=1. Binomial: probability that a gene is the mutant's; exponential: probability that the run of the mutant's
    /// genes has one more; hypercube and line: the largest share of the way from the member to the mutant, of which a uniform
    /// part is taken.
    pub rate: f64,
    /// Probability of a polynomial mutation.
    pub mutate: f64,
}

impl Differential {
    /// Makes the trial vector of the member `target`, between the least and the largest value of each gene; `members` are
    /// rows of as many genes as `trial` has.
    ///
    /// # Panics
    ///
    /// With fewer than four members, or when lengths do not fit together.
    pub fn trial(
        &self,
        members: &[f32],
        best: usize,
        target: usize,
        (lower, upper): (&[f64], &[f64]),
        stream: &mut Stream,
        trial: &mut [f64],
    ) {
        let genes = trial.len();
        assert_eq!((lower.len(), upper.len()), (genes, genes));
        let count = members.len() / genes.max(1);
        assert!(genes == 0 || (count >= 4 && members.len() == count * genes));
        let member = |index: usize| &members[index * genes..(index + 1) * genes];
        let [first, second, third] = distinct(stream, count, target);
        let base = match self.base {
            Base::Best => member(best),
            Base::Random => member(third),
            Base::TargetToBest => member(target),
        };
        let (plus, minus) = match self.base {
            Base::TargetToBest => (member(best), member(first)),
            Base::Best | Base::Random => (member(first), member(second)),
        };
        for gene in 0..genes {
            let from = f64::from(base[gene]);
            let value = from + self.factor * (f64::from(plus[gene]) - f64::from(minus[gene]));
            trial[gene] = within(stream, value, from, lower[gene], upper[gene]);
        }
        self.cross(member(target), stream, trial);
        if stream.unit() < self.mutate {
            mutate(stream, trial, lower, upper, PRECISION);
        }
    }

    /// Puts genes of the member in place of the mutant's.
    fn cross(&self, member: &[f32], stream: &mut Stream, mutant: &mut [f64]) {
        let genes = mutant.len();
        if genes == 0 {
            return;
        }
        match self.crossover {
            Crossover::Binomial => {
                let fixed = index(stream, genes);
                for (gene, value) in mutant.iter_mut().enumerate() {
                    if stream.unit() >= self.rate && gene != fixed {
                        *value = f64::from(member[gene]);
                    }
                }
            }
            Crossover::Exponential => {
                let first = index(stream, genes);
                let mut length = 1;
                while length < genes && stream.unit() < self.rate {
                    length += 1;
                }
                for (gene, value) in mutant.iter_mut().enumerate() {
                    if (gene + genes - first) % genes >= length {
                        *value = f64::from(member[gene]);
                    }
                }
            }
            Crossover::Hypercube => {
                for (value, from) in mutant.iter_mut().zip(member) {
                    let share = stream.unit() * self.rate;
                    *value = between(f64::from(*from), *value, share);
                }
            }
            Crossover::Line => {
                let share = stream.unit() * self.rate;
                for (value, from) in mutant.iter_mut().zip(member) {
                    *value = between(f64::from(*from), *value, share);
                }
            }
        }
    }
}

/// Distribution index of the mutation: the larger, the smaller the changes.
const PRECISION: f64 = 20.0;

fn between(from: f64, to: f64, share: f64) -> f64 {
    from + share * (to - from)
}

/// Puts a value that left the box between the bound and where it came from, at random; what came from outside, onto the nearer bound.
pub(crate) fn within(stream: &mut Stream, value: f64, from: f64, lower: f64, upper: f64) -> f64 {
    let from = from.max(lower).min(upper);
    if value < lower {
        lower + stream.unit() * (from - lower)
    } else if value > upper {
        upper - stream.unit() * (upper - from)
    } else {
        value
    }
}

/// Three members, different from each other and from the target.
fn distinct(stream: &mut Stream, count: usize, target: usize) -> [usize; 3] {
    let mut indices = [target; 4];
    let mut drawn = [0; 3];
    for round in 0..3 {
        let mut candidate = index(stream, count - 1 - round);
        let mut sorted = indices;
        sorted[..=round].sort_unstable();
        for used in &sorted[..=round] {
            candidate += usize::from(candidate >= *used);
        }
        drawn[round] = candidate;
        indices[round + 1] = candidate;
    }
    drawn
}

#[expect(
    clippy::cast_possible_truncation,
    reason = "below a number of members or genes"
)]
pub(crate) fn index(stream: &mut Stream, below: usize) -> usize {
    stream.integer(below as u64) as usize
}
