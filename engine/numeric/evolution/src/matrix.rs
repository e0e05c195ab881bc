//! Products and exponentials of square matrices, in a written-down order of operations.

use swarmwright_lanes::Level;

use crate::linear::Product;

/// Terms of the series of the exponential; with arguments of at most 1/2 the rest is below 2^-60.
const TERMS: u32 = 14;

/// The product of `left`, rows of `size` numbers, and `right`, `size` rows of `size` numbers.
///
/// Sums go along a row of `left`, first to last.
///
/// # Panics
///
/// When lengths do not fit together.
#[must_use]
pub fn product(left: &[f64], right: &[f64], size: usize) -> Vec<f64> {
    assert_eq!(right.len(), size * size);
    let mut result = vec![0.0; left.len()];
    if size == 0 {
        return result;
    }
    assert_eq!(left.len() % size, 0);
    Level::best().run(Product {
        left,
        right,
        size,
        sums: &mut result,
    });
    result
}

/// The exponential of a square matrix of `size` rows: halved until it is small, its series, squared as often.
///
/// None when a number in it is not finite, or so large that the exponential is not.
///
/// # Panics
///
/// When `matrix` has not `size` rows of `size` numbers.
#[must_use]
pub fn exponential(matrix: &[f64], size: usize) -> Option<Vec<f64>> {
    assert_eq!(matrix.len(), size * size);
    let largest = matrix
        .chunks_exact(size.max(1))
        .map(|row| row.iter().map(|value| value.abs()).sum::<f64>())
        .fold(0.0, f64::max);
    // The sum over a row bounds the spectral radius; exp(709) is near the largest number.
    if !matrix.iter().all(|value| value.is_finite()) || largest > 1e4 {
        return None;
    }
    let (mut halvings, mut factor) = (0, 1.0);
    while largest * factor > 0.5 {
        halvings += 1;
        factor *= 0.5;
    }
    let small: Vec<f64> = matrix.iter().map(|value| value * factor).collect();
    // Horner's scheme: 1 + x (1 + x/2 (1 + x/3 (...))).
    let mut sum = identity(size);
    for term in (1..=TERMS).rev() {
        sum = product(&small, &sum, size);
        for value in &mut sum {
            *value /= f64::from(term);
        }
        for index in 0..size {
            sum[index * size + index] += 1.0;
        }
    }
    for _ in 0..halvings {
        sum = product(&sum, &sum, size);
    }
    sum.iter().all(|value| value.is_finite()).then_some(sum)
}

fn identity(size: usize) -> Vec<f64> {
    let mut matrix = vec![0.0; size * size];
    for index in 0..size {
        matrix[index * size + index] = 1.0;
    }
    matrix
}
