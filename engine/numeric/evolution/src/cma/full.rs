//! A full covariance matrix.

use swarmwright_lanes::{Kernel, Lanes, Level};

use super::constants::Constants;
use super::count;
use crate::eigen::eigen;
use crate::linear::{Product, add_rows, dot};

/// The largest ratio of eigenvalues; beyond, numbers are lost.
pub(super) const WORST_CONDITION: f64 = 1e14;

#[derive(Debug, Clone)]
pub(super) struct Full {
    genes: usize,
    /// C, row after row; symmetric to the bit.
    covariance: Vec<f64>,
    /// B: eigenvectors, row after row.
    vectors: Vec<f64>,
    /// D: square roots of the eigenvalues.
    deviations: Vec<f64>,
    /// Eigenvectors times the square roots of their eigenvalues, row after row.
    axes: Vec<f64>,
    /// Generations after which they are computed anew.
    gap: f64,
    /// Generations told when they were computed last.
    computed: u32,
    /// Whether the matrix had to be repaired, or has no eigenvalues.
    broken: bool,
}

impl Full {
    pub fn new(genes: usize, gap: f64) -> Self {
        let mut identity = vec![0.0; genes * genes];
        for gene in 0..genes {
            identity[gene * genes + gene] = 1.0;
        }
        Self {
            genes,
            vectors: identity.clone(),
            axes: identity.clone(),
            covariance: identity,
            deviations: vec![1.0; genes],
            gap,
            computed: 0,
            broken: false,
        }
    }

    pub fn covariance(&self) -> &[f64] {
        &self.covariance
    }

    /// Standard deviation of a gene in units, without the step size.
    pub fn deviation(&self, gene: usize) -> f64 {
        self.covariance[gene * (self.genes + 1)].sqrt()
    }

    /// Whether eigenvalues differ so much that numbers are lost.
    pub fn is_ill_conditioned(&self) -> bool {
        self.broken
    }

    /// An axis of the distribution, in units, without the step size.
    pub fn axis(&self, index: usize) -> &[f64] {
        &self.axes[index * self.genes..(index + 1) * self.genes]
    }

    /// Computes eigenvalues and eigenvectors if they are old enough.
    pub fn decompose_if_due(&mut self, generations: u32) {
        if generations == self.computed
            || f64::from(generations) < f64::from(self.computed) + self.gap
        {
            return;
        }
        self.computed = generations;
        let Some(decomposition) = eigen(&self.covariance, self.genes) else {
            self.broken = true;
            return;
        };
        let (mut least, mut most) = (f64::INFINITY, 0.0_f64);
        for value in &decomposition.values {
            (least, most) = (least.min(*value), most.max(*value));
        }
        // Added to the diagonal, it limits the condition, and makes the matrix positive definite should it not be.
        let missing = (most - WORST_CONDITION * least) / (WORST_CONDITION - 1.0);
        self.broken = missing > 0.0;
        let more = missing.max(0.0);
        if self.broken {
            for gene in 0..self.genes {
                self.covariance[gene * (self.genes + 1)] += more;
            }
        }
        self.vectors = decomposition.vectors;
        for (deviation, value) in self.deviations.iter_mut().zip(&decomposition.values) {
            *deviation = (value + more).sqrt();
        }
        let size = self.genes;
        for (index, deviation) in self.deviations.iter().enumerate() {
            let rows = index * size..(index + 1) * size;
            for (along, value) in self.axes[rows.clone()].iter_mut().zip(&self.vectors[rows]) {
                *along = deviation * value;
            }
        }
    }

    /// Makes rows of standard normal numbers steps of the distribution, in units, without the step size: B D z.
    pub fn shape(&self, rows: &mut [f64]) {
        if self.computed > 0 {
            let mut steps = vec![0.0; rows.len()];
            Level::best().run(Product {
                left: rows,
                right: &self.axes,
                size: self.genes,
                sums: &mut steps,
            });
            rows.copy_from_slice(&steps);
        }
    }

    /// Makes a step of the distribution one of a round distribution: B D^-1 B^T y.
    pub fn unshape(&self, step: &[f64]) -> Vec<f64> {
        let rows = self.vectors.chunks_exact(self.genes.max(1));
        let shares: Vec<f64> = rows
            .zip(&self.deviations)
            .map(|(row, deviation)| dot(row, step) / deviation)
            .collect();
        let mut round = vec![0.0; self.genes];
        add_rows(&mut round, &shares, |index| {
            &self.vectors[index * self.genes..(index + 1) * self.genes]
        });
        round
    }

    /// The rank-one and rank-mu updates; `lost`: of the rate of the former, where the path was stalled.
    pub fn learn(
        &mut self,
        constants: &Constants,
        lost: f64,
        covariance_path: &[f64],
        steps: &[f64],
        lengths: &[f64],
        order: &[usize],
    ) {
        let mut total = constants.c_1 - lost;
        let mut rows = vec![(constants.c_1, covariance_path)];
        for (weight, index) in constants.weights.iter().zip(order) {
            let weight = constants.c_mu * weight;
            total += weight;
            // Those that are far away count as those at the usual distance do, else a matrix would not stay positive definite.
            let weight = if weight < 0.0 {
                let length = lengths[*index].sqrt() + 1e-9;
                weight * (count(self.genes) / (length * length))
            } else {
                weight
            };
            rows.push((weight, &steps[index * self.genes..(index + 1) * self.genes]));
        }
        Level::best().run(Update {
            kept: 1.0 - total,
            rows: &rows,
            matrix: &mut self.covariance,
            size: self.genes,
        });
    }
}

/// A symmetric matrix: what is kept of it, and the products of rows with themselves times their weights.
struct Update<'a> {
    kept: f64,
    rows: &'a [(f64, &'a [f64])],
    matrix: &'a mut [f64],
    size: usize,
}

impl Kernel for Update<'_> {
    type Output = ();

    #[inline(always)]
    fn run<L: Lanes>(self) {
        let size = self.size;
        for value in &mut *self.matrix {
            *value *= self.kept;
        }
        // Eight rows at a time stay in the nearest cache. Only what is left of the diagonal is computed.
        for block in self.rows.chunks(8) {
            let mut factors = [0.0; 8];
            for (index, line) in self.matrix.chunks_exact_mut(size).enumerate() {
                for (factor, (weight, row)) in factors.iter_mut().zip(block) {
                    *factor = weight * row[index];
                }
                add_rows(&mut line[..=index], &factors[..block.len()], |row| {
                    block[row].1
                });
            }
        }
        for row in 1..size {
            for column in 0..row {
                self.matrix[column * size + row] = self.matrix[row * size + column];
            }
        }
    }
}
