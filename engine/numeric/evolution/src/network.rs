//! The genetic operators of networks of nodes, after FREVO's `FullyMeshedNet`.

use crate::stream::{Stream, uniform, unit};

/// Share of its own size by which a proportional mutation moves a gene.
const SHARE: f64 = 0.2;
/// The least border of a proportional mutation.
const LEAST: f64 = 0.1;
/// Genes whose words are drawn at once.
const AT_ONCE: usize = 64;

/// How a mutation moves a gene.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Mutation {
    /// Within severity times the gene's range.
    Uniform,
    /// Within a fifth of the gene's own size, at least 0.1.
    Proportional,
}

/// Genomes that are rows of nodes, each with its bias first and then its incoming weights.
#[derive(Debug, Clone)]
pub struct NodeNetwork {
    /// Where each unit that a crossover can exchange begins, and the end of the last one.
    starts: Vec<usize>,
    /// The range of each gene.
    ranges: Vec<f64>,
    mutation: Mutation,
}

impl NodeNetwork {
    /// `sizes`: how many weights each node has, its bias not counted; genes start within +-range.
    ///
    /// # Panics
    ///
    /// Without nodes.
    #[must_use]
    pub fn new(sizes: &[usize], weight_range: f64, bias_range: f64, mutation: Mutation) -> Self {
        assert!(!sizes.is_empty(), "a network has nodes");
        let mut starts = vec![0];
        let mut ranges = Vec::new();
        for size in sizes {
            ranges.push(bias_range);
            ranges.resize(ranges.len() + size, weight_range);
            starts.push(ranges.len());
        }
        if sizes.len() == 1 {
            // A single node has no runs of nodes to exchange: it exchanges runs of genes.
            starts = (0..=ranges.len()).collect();
        }
        Self {
            starts,
            ranges,
            mutation,
        }
    }

    /// Number of genes.
    #[must_use]
    pub fn genes(&self) -> usize {
        self.ranges.len()
    }

    /// A genome uniform in +-range.
    pub fn initial(&self, stream: &mut Stream, genome: &mut [f32]) {
        let mut words = [0; AT_ONCE];
        for (genes, ranges) in genome.chunks_mut(AT_ONCE).zip(self.ranges.chunks(AT_ONCE)) {
            stream.fill(&mut words[..genes.len()]);
            for ((gene, range), word) in genes.iter_mut().zip(ranges).zip(&words) {
                *gene = rounded(uniform(*word, *range));
            }
        }
    }

    /// A copy of `parent` in which each gene is moved with `probability`; a uniform mutation by up to `severity` times
    /// its range.
    pub fn mutate(
        &self,
        parent: &[f32],
        stream: &mut Stream,
        severity: f64,
        probability: f64,
        child: &mut [f32],
    ) {
        // First a word for each gene whether it is moved, then one for each how far; those of no use are passed over.
        let mut chances = stream.clone();
        stream.skip(self.genes());
        child.copy_from_slice(parent);
        if probability <= 0.0 {
            return stream.skip(self.genes());
        }
        let all = probability >= 1.0;
        let (mut lots, mut moves) = ([0; AT_ONCE], [0; AT_ONCE]);
        for (genes, ranges) in child.chunks_mut(AT_ONCE).zip(self.ranges.chunks(AT_ONCE)) {
            stream.fill(&mut moves[..genes.len()]);
            if all {
                self.move_genes(genes, ranges, &moves, severity, |_| true);
            } else {
                chances.fill(&mut lots[..genes.len()]);
                let chosen = |gene: usize| unit(lots[gene]) < probability;
                self.move_genes(genes, ranges, &moves, severity, chosen);
            }
        }
    }

    /// Changes chosen genes, each by its random word.
    #[inline]
    fn move_genes(
        &self,
        genes: &mut [f32],
        ranges: &[f64],
        words: &[u64],
        severity: f64,
        chosen: impl Fn(usize) -> bool,
    ) {
        let (ranges, words) = (&ranges[..genes.len()], &words[..genes.len()]);
        for index in 0..genes.len() {
            if chosen(index) {
                let before = f64::from(genes[index]);
                let border = match self.mutation {
                    Mutation::Uniform => ranges[index] * severity,
                    Mutation::Proportional => (before.abs() * SHARE).max(LEAST),
                };
                genes[index] = rounded(before + uniform(words[index], border));
            }
        }
    }

    /// A copy of `mother` with a run of nodes of `father`: at least one, not all; it ends at the last node.
    pub fn crossover(
        &self,
        mother: &[f32],
        father: &[f32],
        stream: &mut Stream,
        child: &mut [f32],
    ) {
        child.copy_from_slice(mother);
        let units = self.starts.len() - 1;
        // A network of one gene has nothing to exchange; 0 would mean 2^64.
        let count = index(stream, units.saturating_sub(1).max(1)) + 1;
        let first = index(stream, units);
        let run = self.starts[first]..self.starts[(first + count).min(units)];
        child[run.clone()].copy_from_slice(&father[run]);
    }
}

#[expect(clippy::cast_possible_truncation, reason = "it is below a usize")]
fn index(stream: &mut Stream, below: usize) -> usize {
    stream.integer(below as u64) as usize
}

#[expect(clippy::cast_possible_truncation, reason = "rounding is meant")]
#[inline]
fn rounded(value: f64) -> f32 {
    value as f32
}
