//! Eigenvalues and eigenvectors of symmetric matrices.

use proptest::prelude::*;
use swarmwright_evolution::{Stream, eigen, purpose_key};

/// A matrix is the sum of its parts, and these are orthogonal, within a few roundings.
fn check(matrix: &[f64], size: usize) -> Vec<f64> {
    let decomposition = eigen(matrix, size);
    assert!(decomposition.is_some(), "no eigenvalues of {matrix:?}");
    let (values, vectors) = decomposition
        .map(|parts| (parts.values, parts.vectors))
        .unwrap_or_default();
    assert_eq!(values.len(), size);
    let vector = |index: usize| &vectors[index * size..(index + 1) * size];
    let norm = values
        .iter()
        .fold(0.0, |most: f64, value| most.max(value.abs()));
    let within = 4.0 * f64::EPSILON * (1 + size) as f64;
    for row in 0..size {
        for column in 0..size {
            let sum: f64 = (0..size)
                .map(|index| values[index] * vector(index)[row] * vector(index)[column])
                .sum();
            let expected = matrix[row * size + column];
            assert!((sum - expected).abs() <= within * norm, "{sum} {expected}");
            let product: f64 = vector(row)
                .iter()
                .zip(vector(column))
                .map(|(left, right)| left * right)
                .sum();
            let expected = f64::from(u8::from(row == column));
            assert!(
                (product - expected).abs() <= within,
                "{row} {column} {product}"
            );
        }
    }
    let mut values = values;
    values.sort_by(f64::total_cmp);
    values
}

fn close(actual: &[f64], expected: &[f64]) {
    assert_eq!(actual.len(), expected.len());
    let most = expected
        .iter()
        .fold(0.0, |most: f64, value| most.max(value.abs()));
    for (left, right) in actual.iter().zip(expected) {
        assert!(
            (left - right).abs() <= 1e-14 * most,
            "{actual:?} {expected:?}"
        );
    }
}

/// Symmetric, numbers between -1 and 1.
fn random(size: usize, seed: u64) -> Vec<f64> {
    let mut stream = Stream::new(seed, purpose_key("matrix"), 0, 0);
    let mut matrix = vec![0.0; size * size];
    for row in 0..size {
        for column in 0..=row {
            let value = stream.uniform(1.0);
            matrix[row * size + column] = value;
            matrix[column * size + row] = value;
        }
    }
    matrix
}

#[test]
fn known_matrices() {
    assert!(check(&[], 0).is_empty());
    close(&check(&[-3.0], 1), &[-3.0]);
    close(&check(&[2.0, 1.0, 1.0, 2.0], 2), &[1.0, 3.0]);
    close(&check(&[0.0, 1.0, 1.0, 0.0], 2), &[-1.0, 1.0]);
    close(
        &check(&[2.0, -1.0, 0.0, -1.0, 2.0, -1.0, 0.0, -1.0, 2.0], 3),
        &[2.0 - 2f64.sqrt(), 2.0, 2.0 + 2f64.sqrt()],
    );
    // Second differences: 2 - 2 cos(k pi / (n + 1)).
    let size = 53;
    let mut matrix = vec![0.0; size * size];
    for index in 0..size {
        matrix[index * size + index] = 2.0;
        if index > 0 {
            matrix[index * size + index - 1] = -1.0;
            matrix[(index - 1) * size + index] = -1.0;
        }
    }
    let expected: Vec<f64> = (1..=size)
        .map(|k| 2.0 - 2.0 * (k as f64 * std::f64::consts::PI / (size + 1) as f64).cos())
        .collect();
    close(&check(&matrix, size), &expected);
}

#[test]
fn degenerate_matrices() {
    for size in [1, 2, 3, 8, 9, 17] {
        close(&check(&vec![0.0; size * size], size), &vec![0.0; size]);
        // All ones: of rank 1.
        let mut expected = vec![0.0; size];
        expected[size - 1] = size as f64;
        close(&check(&vec![1.0; size * size], size), &expected);
        let mut diagonal = vec![0.0; size * size];
        for index in 0..size {
            diagonal[index * size + index] = [5.0, 1.0, 5.0, -2.0][index % 4];
        }
        let mut expected: Vec<f64> = (0..size)
            .map(|index| diagonal[index * (size + 1)])
            .collect();
        expected.sort_by(f64::total_cmp);
        close(&check(&diagonal, size), &expected);
    }
    // Two blocks that have nothing to do with each other.
    let blocks = [
        2.0, 1.0, 0.0, 0.0, 1.0, 2.0, 0.0, 0.0, 0.0, 0.0, 7.0, 2.0, 0.0, 0.0, 2.0, 7.0,
    ];
    close(&check(&blocks, 4), &[1.0, 3.0, 5.0, 9.0]);
}

#[test]
fn numbers_of_any_size() {
    for scale in [1e-300, 1e-160, 1e160, 1e300] {
        let matrix: Vec<f64> = random(10, 3).iter().map(|value| value * scale).collect();
        let found = eigen(&matrix, 10).unwrap();
        let plain = eigen(&random(10, 3), 10).unwrap();
        for (one, other) in found.values.iter().zip(&plain.values) {
            assert!((one / scale - other).abs() < 1e-13, "{one} {other}");
        }
    }
    // A condition of 1e12, as that of a covariance matrix shortly before it is given up.
    let size = 12;
    let turn = eigen(&random(size, 5), size).unwrap().vectors;
    let mut matrix = vec![0.0; size * size];
    let values: Vec<f64> = (0..size)
        .map(|k| libm::pow(10.0, -(k as f64) * 12.0 / 11.0))
        .collect();
    for row in 0..size {
        for column in 0..=row {
            let sum: f64 = (0..size)
                .map(|k| values[k] * turn[k * size + row] * turn[k * size + column])
                .sum();
            matrix[row * size + column] = sum;
            matrix[column * size + row] = sum;
        }
    }
    let found = check(&matrix, size);
    assert!((found[0] / 1e-12 - 1.0).abs() < 1e-3, "{}", found[0]);
}

#[test]
fn what_is_not_finite_has_none() {
    assert_eq!(eigen(&[1.0, f64::NAN, f64::NAN, 1.0], 2), None);
    assert_eq!(eigen(&[f64::INFINITY], 1), None);
}

#[test]
fn the_bits_are_the_same_everywhere() {
    let found = eigen(&random(20, 1), 20).unwrap();
    let folded = |values: &[f64]| {
        values
            .iter()
            .fold(0u64, |sum, value| sum.rotate_left(7) ^ value.to_bits())
    };
    assert_eq!(
        folded(&found.values),
        0xcf12_eff0_7097_be28,
        "{:#x}",
        folded(&found.values)
    );
    assert_eq!(
        folded(&found.vectors),
        0x798b_02f1_3074_9b5b,
        "{:#x}",
        folded(&found.vectors)
    );
}

proptest! {
    #[test]
    fn random_matrices_are_the_sum_of_their_parts(size in 1usize..40, seed in any::<u64>()) {
        let values = check(&random(size, seed), size);
        let trace: f64 = (0..size).map(|index| random(size, seed)[index * (size + 1)]).sum();
        prop_assert!((values.iter().sum::<f64>() - trace).abs() < 1e-12);
    }
}
