//! Samples of evolution strategies, and what is learnt from them, in a written-down order of operations.

use rayon::prelude::*;
use swarmwright_lanes::{Kernel, Lanes, Level};

/// Numbers of samples that are made in less time than another thread takes to begin.
const FEW: usize = 16384;

/// Where and how wide samples are drawn, all of the same length.
#[derive(Debug, Clone, Copy)]
pub struct Scale<'a> {
    /// Value of each gene where a point is 0.
    pub middle: &'a [f64],
    /// Change of each gene if a point changes by 1.
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
pub fn samples<T: Copy + Into<f64> + Sync>(
    directions: &[T],
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
    let part = |directions: &[T], genomes: &mut [f32]| {
        Level::best().run(Samples {
            directions,
            center,
            deviation,
            scale,
            mirrored,
            genomes,
        });
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

/// Some rows of [`samples`], in vectors.
struct Samples<'a, T> {
    directions: &'a [T],
    center: &'a [f64],
    deviation: &'a [f64],
    scale: Scale<'a>,
    mirrored: bool,
    genomes: &'a mut [f32],
}

impl<T: Copy + Into<f64>> Kernel for Samples<'_, T> {
    type Output = ();

    #[inline(always)]
    fn run<L: Lanes>(self) {
        let genes = self.center.len();
        let directions = self.directions.chunks_exact(genes);
        let (center, deviation, scale) = (self.center, self.deviation, self.scale);
        if !self.mirrored {
            for (direction, genome) in directions.zip(self.genomes.chunks_exact_mut(genes)) {
                sample::<false, T>(direction, center, deviation, scale, genome);
            }
            return;
        }
        for (direction, pair) in directions.zip(self.genomes.chunks_exact_mut(2 * genes)) {
            let (plus, minus) = pair.split_at_mut(genes);
            sample::<false, T>(direction, center, deviation, scale, plus);
            sample::<true, T>(direction, center, deviation, scale, minus);
        }
    }
}

#[expect(clippy::cast_possible_truncation, reason = "genomes are binary32")]
#[inline(always)]
fn sample<const OPPOSITE: bool, T: Copy + Into<f64>>(
    direction: &[T],
    center: &[f64],
    deviation: &[f64],
    scale: Scale<'_>,
    genome: &mut [f32],
) {
    // Slices of one length need no checks, so that the loop is one over vectors.
    let genes = genome.len();
    let direction = &direction[..genes];
    let [center, deviation] = [center, deviation].map(|row| &row[..genes]);
    let [middle, reach] = [scale.middle, scale.reach].map(|row| &row[..genes]);
    let [lower, upper] = [scale.lower, scale.upper].map(|row| &row[..genes]);
    for gene in 0..genes {
        let away = deviation[gene] * direction[gene].into();
        let point = center[gene] + if OPPOSITE { -away } else { away };
        let value = middle[gene] + reach[gene] * point;
        let value = if value >= lower[gene] {
            value
        } else {
            lower[gene]
        };
        genome[gene] = (if value <= upper[gene] {
            value
        } else {
            upper[gene]
        }) as f32;
    }
}

/// Adds each row times its weight to `sum`, row after row; rows of weight 0 are left out.
///
/// # Panics
///
/// When `rows` is not `weights.len()` rows of `sum.len()` numbers.
pub fn add_weighted(rows: &[f32], weights: &[f64], sum: &mut [f64]) {
    add(rows, weights, sum, |value| value);
}

/// As [`add_weighted`], the squares of the rows.
///
/// # Panics
///
/// As of [`add_weighted`].
pub fn add_weighted_squares(rows: &[f32], weights: &[f64], sum: &mut [f64]) {
    add(rows, weights, sum, |value| value * value);
}

fn add(rows: &[f32], weights: &[f64], sum: &mut [f64], of: impl Fn(f64) -> f64) {
    assert_eq!(rows.len(), weights.len() * sum.len());
    if sum.is_empty() {
        return;
    }
    Level::best().run(Sum {
        rows,
        weights,
        sum,
        of,
    });
}

/// A sum of rows, in vectors.
struct Sum<'a, F> {
    rows: &'a [f32],
    weights: &'a [f64],
    sum: &'a mut [f64],
    of: F,
}

impl<F: Fn(f64) -> f64> Kernel for Sum<'_, F> {
    type Output = ();

    #[inline(always)]
    fn run<L: Lanes>(self) {
        let Self { sum, of, .. } = self;
        let size = sum.len();
        let mut fours = self.weights.chunks_exact(4);
        let mut rows = self.rows.chunks_exact(4 * size);
        for (weights, rows) in (&mut fours).zip(&mut rows) {
            if weights.contains(&0.0) {
                add_each(rows, weights, sum, &of);
                continue;
            }
            // Each sum is loaded and stored once for four rows, and the order stays.
            let (first, rest) = rows.split_at(size);
            let (second, rest) = rest.split_at(size);
            let (third, fourth) = rest.split_at(size);
            for index in 0..size {
                let mut total = sum[index];
                total += weights[0] * of(f64::from(first[index]));
                total += weights[1] * of(f64::from(second[index]));
                total += weights[2] * of(f64::from(third[index]));
                total += weights[3] * of(f64::from(fourth[index]));
                sum[index] = total;
            }
        }
        add_each(rows.remainder(), fours.remainder(), sum, &of);
    }
}

#[inline(always)]
fn add_each(rows: &[f32], weights: &[f64], sum: &mut [f64], of: &impl Fn(f64) -> f64) {
    for (row, weight) in rows.chunks_exact(sum.len()).zip(weights) {
        if *weight != 0.0 {
            for (total, value) in sum.iter_mut().zip(row) {
                *total += weight * of(f64::from(*value));
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
pub fn add_weighted_products(rows: &[f32], weights: &[f64], sum: &mut [f64]) {
    let size = sum.len().isqrt();
    assert_eq!(sum.len(), size * size);
    assert_eq!(rows.len(), weights.len() * size);
    if size == 0 {
        return;
    }
    let mut wide = vec![0.0; size];
    for (row, weight) in rows.chunks_exact(size).zip(weights) {
        if *weight != 0.0 {
            for (slot, value) in wide.iter_mut().zip(row) {
                *slot = f64::from(*value);
            }
            for (line, left) in sum.chunks_exact_mut(size).zip(&wide) {
                for (total, right) in line.iter_mut().zip(&wide) {
                    *total += weight * (left * right);
                }
            }
        }
    }
}
