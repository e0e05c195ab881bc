//! Exponentials of matrices, compared with what is known of them.

use proptest::prelude::*;
use swarmwright_evolution::{exponential, product};

fn close(left: &[f64], right: &[f64], within: f64) {
    let size = right
        .iter()
        .fold(1.0, |most: f64, value| most.max(value.abs()));
    for (number, other) in left.iter().zip(right) {
        assert!((number - other).abs() <= within * size, "{number} {other}");
    }
}

#[test]
fn a_product_sums_rows_times_columns() {
    let (left, right) = ([1.0, 2.0, 3.0, 4.0, 5.0, 6.0], [1.0, 0.5, -1.0, 2.0]);
    assert_eq!(
        product(&left, &right, 2),
        [-1.0, 4.5, -1.0, 9.5, -1.0, 14.5]
    );
}

#[test]
fn known_exponentials() {
    assert_eq!(
        exponential(&[0.0; 9], 3).unwrap(),
        [1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0]
    );
    assert_eq!(exponential(&[], 0).unwrap(), [0.0; 0]);
    // A nilpotent matrix, a rotation, and a diagonal.
    assert_eq!(
        exponential(&[0.0, 3.0, 0.0, 0.0], 2).unwrap(),
        [1.0, 3.0, 0.0, 1.0]
    );
    let turned = exponential(&[0.0, -2.0, 2.0, 0.0], 2).unwrap();
    close(
        &turned,
        &[2f64.cos(), -2f64.sin(), 2f64.sin(), 2f64.cos()],
        1e-14,
    );
    let grown = exponential(&[5.0, 0.0, 0.0, -30.0], 2).unwrap();
    close(&grown, &[5f64.exp(), 0.0, 0.0, (-30f64).exp()], 1e-13);
}

#[test]
fn what_has_no_finite_exponential_is_refused() {
    for value in [f64::NAN, f64::INFINITY, 710.0, 1e300] {
        assert_eq!(exponential(&[value], 1), None);
    }
}

proptest! {
    #[test]
    fn the_exponential_of_minus_it_is_the_inverse(values in prop::collection::vec(-1.0f64..1.0, 16)) {
        let minus: Vec<f64> = values.iter().map(|value| -value).collect();
        let one = product(&exponential(&values, 4).unwrap(), &exponential(&minus, 4).unwrap(), 4);
        for (index, value) in one.iter().enumerate() {
            let expected = f64::from(u8::from(index % 5 == 0));
            prop_assert!((value - expected).abs() < 1e-12, "{value} at {index}");
        }
    }
}
