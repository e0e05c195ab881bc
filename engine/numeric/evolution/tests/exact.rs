//! Exact sums, aggregates of episodes, and the figures of a population.

use proptest::prelude::*;
use swarmwright_evolution::{Aggregate, Figures, Outcome, exact_sum};

#[test]
fn a_sum_is_rounded_once() {
    assert_eq!(exact_sum([]), Some(0.0));
    assert_eq!(exact_sum([1e16, 1.0, 1e-16]), Some(1e16 + 2.0)); // half-way, and a little more
    assert_eq!(exact_sum([1e16, 1.0, -1e-16]), Some(1e16));
    assert_eq!(exact_sum([0.1; 10]), Some(1.0));
    assert_eq!(exact_sum([1e308, 1e308, -1e308]), None);
    assert_eq!(exact_sum([1e100, 1.0, -1e100, 1e-300]), Some(1.0));
}

proptest! {
    #[test]
    fn sums_of_fixed_point_numbers_are_exact(
        numbers in prop::collection::vec((-(1_i64 << 52)..1_i64 << 52, 0_u32..60), 1..40)
    ) {
        #[expect(clippy::cast_precision_loss, reason = "integers below 2^53, and the sum is what is to be rounded")]
        let values: Vec<f64> = numbers.iter().map(|(number, power)| *number as f64 * 2_f64.powi(power.cast_signed())).collect();
        let sum: i128 = numbers.iter().map(|(number, power)| i128::from(*number) << power).sum();
        #[expect(clippy::cast_precision_loss, reason = "it is rounded once, too")]
        let expected = sum as f64;
        prop_assert_eq!(exact_sum(values.iter().copied()), Some(expected));
        prop_assert_eq!(exact_sum(values.iter().rev().copied()), Some(expected));
    }
}

#[test]
fn aggregates() {
    let results = [3.0, -1.0, 4.0, 2.0, -5.0];
    assert_eq!(Aggregate::Mean.of(&results), 0.6);
    assert_eq!(Aggregate::Sum.of(&results), 3.0);
    assert_eq!(Aggregate::Median.of(&results), 2.0);
    assert_eq!(Aggregate::Median.of(&results[..4]), 2.5);
    assert_eq!(Aggregate::Worst.of(&results), -5.0);
    assert_eq!(Aggregate::Quantile(0.25).of(&results), -1.0);
    // The worst counts wholly and the second worst half.
    assert_eq!(Aggregate::WorstShare(0.3).of(&results), -5.5 / 1.5);
    assert_eq!(Aggregate::WorstShare(1.0).of(&results), 0.6);
}

#[test]
fn aggregates_of_rows_are_those_of_each_row() {
    let results = vec![-0.0, 2.5, f64::NAN, 1e308, f64::INFINITY, -3.0];
    let all = [
        Aggregate::Mean,
        Aggregate::Sum,
        Aggregate::Median,
        Aggregate::Worst,
        Aggregate::Quantile(0.4),
        Aggregate::WorstShare(0.4),
    ];
    let bits = |values: Vec<f64>| values.into_iter().map(f64::to_bits).collect::<Vec<_>>();
    for aggregate in all {
        for length in [1, 2, 3] {
            let rows = results.chunks_exact(length).map(|row| aggregate.of(row));
            let together = aggregate.of_rows(results.clone(), length);
            assert_eq!(
                bits(together),
                bits(rows.collect()),
                "{aggregate:?} {length}"
            );
        }
    }
}

#[test]
fn what_failed_or_overflows_is_nan_and_zero_has_no_sign() {
    for aggregate in [
        Aggregate::Mean,
        Aggregate::Worst,
        Aggregate::WorstShare(0.5),
    ] {
        assert!(aggregate.of(&[1.0, f64::NAN]).is_nan());
        assert!(aggregate.of(&[f64::INFINITY]).is_nan());
        assert_eq!(aggregate.of(&[-0.0]).to_bits(), 0);
    }
    assert!(Aggregate::Sum.of(&[1e308, 1e308]).is_nan());
}

#[test]
fn means_and_sums_of_large_numbers_do_not_overflow_on_the_way() {
    const LARGE: f64 = 1.7e308;
    assert_eq!(Aggregate::Mean.of(&[LARGE, LARGE]), LARGE);
    assert_eq!(Aggregate::Sum.of(&[LARGE, LARGE, 1.0, -LARGE]), LARGE);
    assert_eq!(Aggregate::Mean.of(&[f64::MAX; 3]), f64::MAX);
    for share in [0.1, 0.5, 0.9, 1.0] {
        for number in [LARGE, -LARGE, f64::MAX, -f64::MAX] {
            let found = Aggregate::WorstShare(share).of(&[number; 7]);
            assert!((found / number - 1.0).abs() < 1e-15, "{share} of {number}");
        }
    }
    let mixed = [-LARGE, -LARGE, 1e300, LARGE];
    assert_eq!(Aggregate::WorstShare(0.5).of(&mixed), -LARGE);
    assert_eq!(Figures::of(&[LARGE, LARGE, f64::NAN]).mean, LARGE);
    assert_eq!(Figures::of(&[-LARGE; 64]).mean, -LARGE);
    assert_eq!(Figures::of(&[LARGE, LARGE, -LARGE, -LARGE, 5.0]).mean, 1.0);
}

#[test]
fn figures_leave_out_what_failed() {
    let one = Figures::of(&[2.0, f64::NAN, 1.0, 4.0, 3.0]);
    assert_eq!((one.best, one.mean, one.median), (4.0, 2.5, 2.5));
    assert_eq!((one.lower_quartile, one.upper_quartile), (1.75, 3.25));
    let none = Figures::of(&[f64::NAN]);
    assert!(none.best.is_nan() && none.mean.is_nan() && none.median.is_nan());
}

#[test]
fn the_leader_is_the_first_of_the_best() {
    let outcome = |fitness: &[f64]| {
        let one = Outcome::of(fitness);
        (one.leader, one.failed)
    };
    assert_eq!(outcome(&[f64::NAN, -2.0, 5.0, 5.0, f64::NAN]), (2, 2));
    assert_eq!(outcome(&[f64::NAN; 3]), (0, 3));
    assert_eq!(outcome(&[-0.0, 0.0]), (0, 0));
}

/// Type 7 of Hyndman and Fan, of ordered numbers.
fn quantile(ordered: &[f64], share: f64) -> f64 {
    #[expect(clippy::cast_precision_loss, reason = "few numbers")]
    let position = share * (ordered.len() - 1) as f64;
    #[expect(
        clippy::cast_possible_truncation,
        clippy::cast_sign_loss,
        reason = "a place"
    )]
    let low = position.floor() as usize;
    let high = (low + 1).min(ordered.len() - 1);
    let part = position - position.floor();
    ordered[low] * (1.0 - part) + ordered[high] * part
}

proptest! {
    // Numbers of like and unlike size, of few bits and of many: sums in parts and those that need another way.
    #[test]
    fn figures_of_many_are_those_of_exact_sums_and_ordered_numbers(
        mantissas in prop::collection::vec(any::<i64>(), 1..300), times in 1_usize..8, spread in 0_i32..90, bits in 1_u32..63,
        offset in prop::sample::select(vec![0, -700, -640, 600, 660]), failed in 0_usize..3,
    ) {
        let mut values = Vec::new();
        for (index, mantissa) in mantissas.iter().enumerate() {
            for time in 0..i32::try_from(times).unwrap() {
                let power = (i32::try_from(index).unwrap() * 7 + time) % (spread + 1);
                #[expect(clippy::cast_precision_loss, reason = "rounded")]
                let number = (mantissa >> (63 - bits)) as f64;
                values.push(number * 2_f64.powi(power - spread / 2 + offset));
            }
        }
        let mut ordered = values.clone();
        ordered.sort_unstable_by(f64::total_cmp);
        #[expect(clippy::cast_precision_loss, reason = "few numbers")]
        let mean = exact_sum(values.iter().copied()).unwrap() / values.len() as f64;
        values.extend(vec![f64::NAN; failed]);
        let found = Figures::of(&values);
        let found = [found.best, found.mean, found.lower_quartile, found.median, found.upper_quartile];
        let [low, middle, high] = [0.25, 0.5, 0.75].map(|share| quantile(&ordered, share));
        let expected = [ordered[ordered.len() - 1], mean, low, middle, high];
        prop_assert_eq!(found.map(f64::to_bits), expected.map(f64::to_bits));
    }
}
