//! A sample of an evolution strategy by its address: any candidate of any generation can be made anywhere.

use rayon::prelude::*;

use crate::sampling::{Scale, samples};
use crate::stream::{normal_rows, purpose_key, rows_of};

/// Numbers of directions that are drawn at once.
const TOGETHER: usize = 2048;
/// Numbers of genomes that are made in little more time than another thread takes to begin.
const FEW: usize = 32_768;

/// A normal distribution with a deviation for each gene, and the random numbers of one generation of samples.
#[derive(Debug, Clone, Copy)]
pub struct GaussianSample<'a> {
    /// Of the run.
    pub seed: u64,
    /// What the directions are for.
    pub purpose: &'a str,
    /// The generation.
    pub generation: u64,
    /// Whether candidates 2 i and 2 i + 1 lie on opposite sides of the center, in direction i.
    pub mirrored: bool,
    /// Center of the samples.
    pub center: &'a [f64],
    /// Standard deviation of each gene.
    pub deviation: &'a [f64],
    /// From points to genes.
    pub scale: Scale<'a>,
}

impl GaussianSample<'_> {
    /// The genomes of candidate `first` and those behind it, as many as fit: rows of `center.len()` numbers, as
    /// [`samples`] makes them from the directions of [`normal_rows`].
    ///
    /// # Panics
    ///
    /// When lengths do not fit together.
    pub fn genomes(&self, first: u64, genomes: &mut [f32]) {
        let genes = self.center.len();
        if genes == 0 || genomes.is_empty() {
            return;
        }
        if !self.mirrored {
            return self.rows(first, genomes);
        }
        let mut rest = genomes;
        let mut row = first / 2;
        if !first.is_multiple_of(2) {
            let (half, others) = rest.split_at_mut(genes);
            self.half(row, 1, half);
            rest = others;
            row += 1;
        }
        let pairs = rest.len() / (2 * genes);
        let (whole, half) = rest.split_at_mut(2 * genes * pairs);
        self.rows(row, whole);
        if !half.is_empty() {
            self.half(row + pairs as u64, 0, half);
        }
    }

    /// As [`genomes`](Self::genomes), many of them on all processors.
    ///
    /// # Panics
    ///
    /// When lengths do not fit together.
    pub fn genomes_parallel(&self, first: u64, genomes: &mut [f32]) {
        let genes = self.center.len().max(1);
        let rows = 2 * rows_of(FEW / 2, genes);
        // Pairs stay together.
        let alone = usize::from(self.mirrored && !first.is_multiple_of(2)) * genes;
        let (alone, rest) = genomes.split_at_mut(alone.min(genomes.len()));
        self.genomes(first, alone);
        let first = first + (alone.len() / genes) as u64;
        rest.par_chunks_mut(rows * genes)
            .enumerate()
            .for_each(|(part, genomes)| self.genomes(first + (part * rows) as u64, genomes));
    }

    /// All genomes of direction `row` and those behind it.
    fn rows(&self, mut row: u64, genomes: &mut [f32]) {
        let genes = self.center.len();
        let each = if self.mirrored { 2 } else { 1 };
        let purpose = purpose_key(self.purpose);
        let rows = rows_of(TOGETHER, genes);
        let mut directions = vec![0.0; (rows * genes).min(genomes.len() / each)];
        for part in genomes.chunks_mut(each * rows * genes) {
            let directions = &mut directions[..part.len() / each];
            normal_rows(self.seed, purpose, self.generation, row, genes, directions);
            samples(
                directions,
                self.center,
                self.deviation,
                self.scale,
                self.mirrored,
                part,
            );
            row += rows as u64;
        }
    }

    /// One genome of a pair: the first or the second.
    fn half(&self, row: u64, side: usize, genome: &mut [f32]) {
        let genes = self.center.len();
        let mut pair = vec![0.0; 2 * genes];
        self.rows(row, &mut pair);
        genome.copy_from_slice(&pair[side * genes..][..genes]);
    }
}
