//! Polynomial mutation in a box (Deb and Deb, International Journal of Artificial Intelligence and Soft Computing 4, 2014).

use crate::Stream;
use crate::differential::index;

/// Changes each gene with probability 1 / genes, at most 1/2, and at least one.
///
/// `precision`: distribution index; the larger, the smaller the changes. Changed genes are within the bounds, those from outside too; one
/// whose bounds are equal keeps its value.
pub(crate) fn mutate(
    stream: &mut Stream,
    genome: &mut [f64],
    lower: &[f64],
    upper: &[f64],
    precision: f64,
) {
    if genome.is_empty() {
        return;
    }
    #[expect(clippy::cast_precision_loss, reason = "numbers of genes are small")]
    let probability = (1.0 / genome.len() as f64).min(0.5);
    let mut changed: Vec<bool> = genome.iter().map(|_| stream.unit() < probability).collect();
    if !changed.contains(&true) {
        changed[index(stream, genome.len())] = true;
    }
    for (gene, value) in genome.iter_mut().enumerate() {
        if changed[gene] {
            *value = mutated(stream.unit(), *value, lower[gene], upper[gene], precision);
        }
    }
}

/// The value of a gene for a share from 0 to 1: below 1/2 it becomes smaller.
fn mutated(share: f64, value: f64, lower: f64, upper: f64, precision: f64) -> f64 {
    let width = upper - lower;
    if width <= 0.0 {
        return value;
    }
    // From outside, a margin would be above 1, and its power not a number.
    let value = value.clamp(lower, upper);
    let (down, margin) = if share <= 0.5 {
        (true, (value - lower) / width)
    } else {
        (false, (upper - value) / width)
    };
    let share = if down { share } else { 1.0 - share };
    let rest = libm::pow(1.0 - margin, precision + 1.0);
    let inner = 2.0 * share + (1.0 - 2.0 * share) * rest;
    let change = 1.0 - libm::pow(inner, 1.0 / (precision + 1.0));
    let moved = if down {
        value - change * width
    } else {
        value + change * width
    };
    moved.clamp(lower, upper)
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::{Stream, mutate};

    proptest! {
        #[test]
        fn changed_genes_are_within_the_bounds(
            seed: u64, genes in 1_usize..20, scale in -30.0..30.0_f64, precision in 0.0..100.0_f64,
        ) {
            let mut stream = Stream::new(seed, 1, 0, 0);
            let before: Vec<f64> = (0..genes).map(|_| stream.uniform(libm::exp(scale))).collect();
            let mut genome = before.clone();
            mutate(&mut stream, &mut genome, &vec![-10.0; genes], &vec![10.0; genes], precision);
            for (value, before) in genome.iter().zip(before) {
                prop_assert!(value.to_bits() == before.to_bits() || value.abs() <= 10.0);
            }
        }
    }
}
