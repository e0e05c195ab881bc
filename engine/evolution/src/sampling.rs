//! Samples of evolution strategies, and what is learnt from them, in a written-down order of operations.

use rayon::prelude::*;

/// Numbers of samples that are made in less time than another thread takes to begin.
const FEW: usize = 16384;

/// Where and how wide samples are drawn, all of the same length.
#[derive(Debug, Clone, Copy)]
pub struct Scale<'a> {
    /// Value of each gene where a point is 0.
    pub middle: &'a [f64],
    /// By how much each gene changes where a point changes by 1.
    pub reach: &'a [f64],
    /// Least value of each gene.
    pub lower: &'a [f64],
    /// Largest value of each gene.
    pub upper: &'a [f64],
}

/// A genome for each direction, `center` plus `deviation` times it; where they are mirrored, two: plus and minus, genomes 2 i and 2 i + 1.
///
/// `directions` and `genomes` are rows of `center.len()` numbers. Genomes are middle + reach * point, within the limits, rounded
/// to binary32.
///
/// # Panics
///
/// When lengths do not fit together.
pub fn samples(
    directions: &[f64],
    center: &[f64],
    deviation: &[f64],
    scale: Scale<'_>,
    mirrored: bool,
    genomes: &mut [f32],
) {
    let genes = center.len();
    let each = if mirrored { 2 } else { 1 };
    assert_eq!(genomes.len(), each * directions.len());
    let rows = [
        deviation,
        scale.middle,
        scale.reach,
        scale.lower,
        scale.upper,
    ];
    for row in rows {
        assert_eq!(row.len(), genes);
    }
    if genes == 0 {
        return;
    }
    let part = |directions: &[f64], genomes: &mut [f32]| {
        let made = genomes.chunks_exact_mut(each * genes);
        for (direction, made) in directions.chunks_exact(genes).zip(made) {
            let (plus, minus) = made.split_at_mut(genes);
            sample::<false>(direction, center, deviation, scale, plus);
            if mirrored {
                sample::<true>(direction, center, deviation, scale, minus);
            }
        }
    };
    if directions.len() <= FEW {
        return part(directions, genomes);
    }
    let rows = FEW.div_ceil(genes) * genes;
    directions
        .par_chunks(rows)
        .zip(genomes.par_chunks_mut(each * rows))
        .for_each(|(directions, genomes)| part(directions, genomes));
}

#[expect(clippy::cast_possible_truncation, reason = "genomes are binary32")]
fn sample<const OPPOSITE: bool>(
    direction: &[f64],
    center: &[f64],
    deviation: &[f64],
    scale: Scale<'_>,
    genome: &mut [f32],
) {
    for (gene, place) in genome.iter_mut().enumerate() {
        let away = deviation[gene] * direction[gene];
        let point = center[gene] + if OPPOSITE { -away } else { away };
        let value = scale.middle[gene] + scale.reach[gene] * point;
        let (lower, upper) = (scale.lower[gene], scale.upper[gene]);
        let value = if value >= lower { value } else { lower };
        *place = (if value <= upper { value } else { upper }) as f32;
    }
}

/// Adds each row times its weight to `sum`, row after row; rows of weight 0 are left out.
///
/// # Panics
///
/// When `rows` is not `weights.len()` rows of `sum.len()` numbers.
pub fn add_weighted(rows: &[f64], weights: &[f64], sum: &mut [f64]) {
    assert_eq!(rows.len(), weights.len() * sum.len());
    if sum.is_empty() {
        return;
    }
    for (row, weight) in rows.chunks_exact(sum.len()).zip(weights) {
        if *weight != 0.0 {
            for (total, value) in sum.iter_mut().zip(row) {
                *total += weight * value;
            }
        }
    }
}

/// Adds the product of each row with itself, a matrix, times its weight to `sum`, row after row; rows of weight 0 are left out.
///
/// `sum` is a square matrix, row after row. It stays symmetric to the bit.
///
/// # Panics
///
/// When `rows` is not `weights.len()` rows of as many numbers as `sum` has rows.
pub fn add_weighted_products(rows: &[f64], weights: &[f64], sum: &mut [f64]) {
    let size = sum.len().isqrt();
    assert_eq!(sum.len(), size * size);
    assert_eq!(rows.len(), weights.len() * size);
    if size == 0 {
        return;
    }
    for (row, weight) in rows.chunks_exact(size).zip(weights) {
        if *weight != 0.0 {
            for (line, left) in sum.chunks_exact_mut(size).zip(row) {
                for (total, right) in line.iter_mut().zip(row) {
                    *total += weight * (left * right);
                }
            }
        }
    }
}
