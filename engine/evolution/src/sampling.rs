//! Samples of evolution strategies, and what is learnt from them, in a written-down order of operations.

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

/// Two genomes for each direction, `center` plus and minus `noise` times it: genomes 2 i and 2 i + 1.
///
/// `directions` and `genomes` are rows of `center.len()` numbers. Genomes are middle + reach * point, within the limits, rounded
/// to binary32.
///
/// # Panics
///
/// When lengths do not fit together.
pub fn mirrored(
    directions: &[f64],
    center: &[f64],
    noise: f64,
    scale: Scale<'_>,
    genomes: &mut [f32],
) {
    let genes = center.len();
    assert_eq!(genomes.len(), 2 * directions.len());
    for row in [scale.middle, scale.reach, scale.lower, scale.upper] {
        assert_eq!(row.len(), genes);
    }
    if genes == 0 {
        return;
    }
    for (direction, pair) in directions
        .chunks_exact(genes)
        .zip(genomes.chunks_exact_mut(2 * genes))
    {
        let (plus, minus) = pair.split_at_mut(genes);
        sample(direction, center, noise, scale, plus);
        sample(direction, center, -noise, scale, minus);
    }
}

#[expect(clippy::cast_possible_truncation, reason = "genomes are binary32")]
fn sample(direction: &[f64], center: &[f64], noise: f64, scale: Scale<'_>, genome: &mut [f32]) {
    for (gene, place) in genome.iter_mut().enumerate() {
        let point = center[gene] + noise * direction[gene];
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
