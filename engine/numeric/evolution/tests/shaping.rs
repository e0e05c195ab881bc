//! Ranks and utilities: known values, equal and failed candidates.

use proptest::prelude::*;
use swarmwright_evolution::{centered_ranks, utilities};

#[test]
fn ranks_are_centered() {
    assert_eq!(centered_ranks(&[5.0, 1e300, -7.0]), [0.0, 0.5, -0.5]);
    assert_eq!(centered_ranks(&[3.0; 4]), [0.0; 4]);
    assert_eq!(
        centered_ranks(&[1.0, 1.0, 2.0, 3.0, 3.0]),
        [-0.375, -0.375, 0.0, 0.375, 0.375]
    );
    assert_eq!(centered_ranks(&[0.0, -0.0, 1.0]), [-0.25, -0.25, 0.5]);
}

#[test]
fn failed_candidates_share_the_lowest_rank() {
    assert_eq!(
        centered_ranks(&[f64::NAN, -1e300, f64::NAN]),
        [-0.25, 0.5, -0.25]
    );
    let weights = utilities(&[f64::NAN, 1.0, -f64::NAN, 2.0]);
    assert_eq!(weights[0].to_bits(), weights[2].to_bits());
    assert!(weights[0] < weights[1] && weights[1] < weights[3]);
}

proptest! {
    #[test]
    fn both_follow_the_order_and_add_up_to_0(values in prop::collection::vec(-3_i8..3, 2..40)) {
        let fitness: Vec<f64> = values.iter().copied().map(f64::from).collect();
        for weights in [centered_ranks(&fitness), utilities(&fitness)] {
            prop_assert!(weights.iter().sum::<f64>().abs() < 1e-12);
            for (one, weight) in fitness.iter().zip(&weights) {
                for (other, compared) in fitness.iter().zip(&weights) {
                    // Half of the utilities are equal although the fitness differs.
                    prop_assert!(one > other || weight <= compared);
                    prop_assert!(one.to_bits() != other.to_bits() || weight.to_bits() == compared.to_bits());
                }
            }
        }
    }
}
