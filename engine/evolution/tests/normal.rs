//! Normal numbers against tables of the distribution, and their bits.

use proptest::prelude::*;
use swarmwright_evolution::{Stream, normal_at, purpose_key};

#[test]
fn quantiles_are_those_of_tables() {
    // Made with mpmath 1.3, 30 digits.
    let table = [
        (0.5, 0.0),
        (0.6, 0.253_347_103_135_799_8),
        (0.975, 1.959_963_984_540_054),
        (0.001, -3.090_232_306_167_813_5),
        (1e-10, -6.361_340_902_404_056),
        (1e-15, -7.941_345_326_170_997),
    ];
    for (share, expected) in table {
        let found = normal_at(share);
        assert!(
            (found - expected).abs() <= 1e-14 * f64::abs(expected),
            "{share}: {found}"
        );
    }
}

#[test]
fn bits_are_the_same_everywhere() {
    let mut stream = Stream::new(7, purpose_key("golden"), 0, 0);
    let found: Vec<u64> = (0..4).map(|_| stream.normal().to_bits()).collect();
    assert_eq!(
        found,
        [
            0xBFDD_5FFC_7A2B_4345,
            0xBFDC_4224_067A_3ED1,
            0x3FF9_5F69_DF40_3427,
            0xC000_BD91_0648_7ADB,
        ]
    );
}

#[test]
fn many_numbers_are_the_same_as_one_after_another() {
    for count in [0, 1, 7, 64, 65, 100_000] {
        let (mut one, mut other) = (Stream::new(3, 5, 0, 0), Stream::new(3, 5, 0, 0));
        let mut numbers = vec![0.0; count];
        one.normals(&mut numbers);
        for number in numbers {
            assert_eq!(number.to_bits(), other.normal().to_bits());
        }
        assert_eq!(one.word(), other.word());
    }
}

#[test]
fn the_ends_are_finite() {
    assert!((normal_at(f64::EPSILON / 4.0) + 8.2924).abs() < 1e-3);
    assert!((normal_at(1.0) - 8.2924).abs() < 1e-3);
}

proptest! {
    #[test]
    fn larger_shares_have_larger_numbers(share in 1e-15..1.0 - 1e-9, more in 1e-9..1e-1) {
        prop_assume!(share + more < 1.0);
        prop_assert!(normal_at(share) < normal_at(share + more));
    }
}
