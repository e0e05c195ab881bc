//! Fitness shaping: what a candidate's fitness is worth among the others', without regard to its size.

use crate::log;
use crate::ranking::{key, ordered};

/// Fitness in order: equal values are one group.
struct Groups {
    /// Of each candidate, counted from the worst on.
    group: Vec<usize>,
    /// Candidates in it and in those before it.
    ends: Vec<usize>,
}

impl Groups {
    /// `fitness`: NaN where a candidate failed, which is worse than anything else.
    fn of(fitness: &[f64]) -> Self {
        let keys: Vec<u64> = fitness.iter().map(|fitness| key(*fitness)).collect();
        let (mut group, mut ends) = (vec![0; keys.len()], Vec::with_capacity(keys.len()));
        let mut before = None;
        for (rank, index) in ordered(&keys).iter().rev().enumerate() {
            let index = *index as usize;
            let key = Some(keys[index]);
            if std::mem::replace(&mut before, key) == key {
                ends.pop();
            }
            group[index] = ends.len();
            ends.push(rank + 1);
        }
        Self { group, ends }
    }

    /// A number for each candidate, made of where its group begins and ends.
    fn map(&self, number: impl Fn(usize, usize) -> f64) -> Vec<f64> {
        let begins = std::iter::once(&0).chain(&self.ends);
        let numbers: Vec<f64> = begins
            .zip(&self.ends)
            .map(|(begin, end)| number(*begin, *end))
            .collect();
        self.group.iter().map(|group| numbers[*group]).collect()
    }
}

/// Ranks from -1/2 (worst) to 1/2 (best) of at least two candidates; equal ones share the mean, failed ones (NaN) are worst.
#[must_use]
pub fn centered_ranks(fitness: &[f64]) -> Vec<f64> {
    let last = number(fitness.len()) - 1.0;
    Groups::of(fitness).map(|begin, end| {
        let mean = number(end) - (number(end - begin) + 1.0) / 2.0;
        mean / last - 0.5
    })
}

/// Weights of natural evolution strategies for at least two candidates, with the sum 0 but for rounding: the k-th best has
/// max(0, ln(n / 2 + 1) - ln(k)), scaled to the sum 1, less 1 / n; equal ones share the mean, failed ones (NaN) are worst.
///
/// Wierstra et al., "Natural evolution strategies", JMLR 15, 2014, section 3.1.
#[must_use]
pub fn utilities(fitness: &[f64]) -> Vec<f64> {
    let size = number(fitness.len());
    let most = log(size / 2.0 + 1.0);
    // From the worst to the best, added one after another.
    let mut sums = vec![0.0];
    for rank in (1..=fitness.len()).rev() {
        let weight = (most - log(number(rank))).max(0.0);
        sums.push(sums.last().copied().unwrap_or_default() + weight);
    }
    let sum = sums.last().copied().unwrap_or_default();
    Groups::of(fitness).map(|begin, end| {
        let mean = (sums[end] - sums[begin]) / number(end - begin);
        (mean - sum / size) / sum
    })
}

#[expect(clippy::cast_precision_loss, reason = "populations are small")]
fn number(count: usize) -> f64 {
    count as f64
}
