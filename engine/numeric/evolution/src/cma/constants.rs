//! The constants of a search, by the number of genes and of genomes in a sample.

use super::count;

/// Learning rates, weights and damping, the library's defaults.
#[derive(Debug, Clone)]
pub(super) struct Constants {
    /// Of each rank, the best first: positive ones, whose sum is 1, and then those that are not.
    pub weights: Vec<f64>,
    /// mu, the number of positive weights.
    pub parents: usize,
    /// mu_eff: the variance effective number of parents.
    pub effective: f64,
    /// c_sigma: of the path of the step size.
    pub c_sigma: f64,
    /// c_c: of the path of the covariance matrix.
    pub c_c: f64,
    /// c_1: of the rank-one update.
    pub c_1: f64,
    /// c_mu: of the rank-mu update.
    pub c_mu: f64,
    /// d_sigma
    pub damping: f64,
    /// Expected length of a vector of standard normal numbers, one for each gene.
    pub expected: f64,
}

impl Constants {
    pub fn new(genes: usize, population: usize, separable: bool) -> Self {
        assert!(population >= 3, "at least 3 genomes");
        let mut weights = raw_weights(population);
        let parents = weights.iter().take_while(|weight| **weight > 0.0).count();
        let (better, worse) = weights.split_at_mut(parents);
        let effective = effective_size(better);
        let effective_worse = effective_size(worse);
        let n = count(genes);
        let [c_c, rank_one, all] = rates(n, count(population), effective, separable);
        scale_to(better, 1.0);
        let mut most = (1.0 + rank_one / all).min(1.0 + 2.0 * effective_worse / (effective + 2.0));
        if !separable {
            // The matrix stays positive definite.
            most = most.min((1.0 - rank_one - all) / all / n);
        }
        scale_to(worse, most);
        let c_sigma = ((effective + 2.0) / (n + effective + 3.0)).min(0.5);
        Self {
            weights,
            parents,
            effective,
            c_sigma,
            c_c,
            c_1: rank_one,
            c_mu: all,
            damping: damping(n, effective) + c_sigma,
            expected: n.sqrt() * (1.0 - 1.0 / (4.0 * n) + 1.0 / (21.0 * n * n)),
        }
    }

    /// Number of generations between computations of the eigenvectors, which limits the work per gene.
    pub fn gap(&self, genes: usize) -> f64 {
        1.0 / (self.c_1 + self.c_mu) / count(genes) / 10.0
    }
}

fn raw_weights(population: usize) -> Vec<f64> {
    let middle = libm::log((count(population) + 1.0) / 2.0);
    (1..=population)
        .map(|rank| middle - libm::log(count(rank)))
        .collect()
}

/// The square of the sum over the sum of the squares.
fn effective_size(weights: &[f64]) -> f64 {
    let (mut sum, mut squares) = (0.0, 0.0);
    for weight in weights {
        sum += weight;
        squares += weight * weight;
    }
    if squares == 0.0 {
        0.0
    } else {
        sum * sum / squares
    }
}

/// Scales weights so that their sum is so large, whatever its sign.
fn scale_to(weights: &mut [f64], size: f64) {
    let mut sum = 0.0;
    for weight in &*weights {
        sum += weight;
    }
    if sum != 0.0 {
        for weight in weights {
            *weight *= size / sum.abs();
        }
    }
}

/// c_c, c_1 and c_mu
fn rates(n: f64, population: f64, effective: f64, separable: bool) -> [f64; 3] {
    let share = effective / n;
    let gain = 0.25 + effective + 1.0 / effective - 2.0;
    if separable {
        let rank_one = 1.0 / (n + 2.0 * n.sqrt() + share);
        let all = gain / (n + 4.0 * n.sqrt() + effective / 2.0);
        let c_c = (1.0 + 1.0 / n + share) / (n.sqrt() + 1.0 / n + 2.0 * share);
        [c_c, rank_one, all.min(1.0 - rank_one)]
    } else {
        let rank_one = (population / 6.0).min(1.0) * 2.0 / ((n + 1.3) * (n + 1.3) + effective);
        let all = 2.0 * gain / ((n + 2.0) * (n + 2.0) + effective);
        let c_c = (4.0 + share) / (n + 4.0 + 2.0 * share);
        [c_c, rank_one, all.min(1.0 - rank_one)]
    }
}

/// d_sigma without c_sigma; with many parents up to three times as large as in the tutorial.
fn damping(n: f64, effective: f64) -> f64 {
    let many = 3.0 * (1.0 - libm::exp(-n / 9.0 * std::f64::consts::LN_2));
    let parents = ((effective - 1.0) / (n + 1.0)).max(0.0).sqrt();
    1.0 + 2.0 * (many.max(1.0) * parents - 1.0).max(0.0)
}
