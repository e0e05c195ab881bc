//! Accuracy and exact values of the fixed sequences, against binary64.

use std::f64::consts::PI;
use swarmwright_controllers::functions::{cos_pi, sigmoid, sin_pi, tanh};

const LIMIT: f64 = 2e-7;

/// A function, its true value, the end of the range that matters.
type Case = (&'static str, fn(f32) -> f32, fn(f64) -> f64, f32);

const CASES: [Case; 4] = [
    ("tanh", tanh, f64::tanh, 20.0),
    ("sigmoid", sigmoid, |x| 1.0 / (1.0 + (-x).exp()), 40.0),
    ("sin_pi", sin_pi, |a| (PI * a).sin(), 1.0),
    ("cos_pi", cos_pi, |a| (PI * a).cos(), 1.0),
];

fn check(case: &Case, x: f32, worst: &mut (f64, f32)) {
    for x in [x, -x] {
        let error = (f64::from(case.1(x)) - case.2(f64::from(x))).abs();
        if error > worst.0 || error.is_nan() {
            *worst = (error, x);
        }
    }
}

/// Bit patterns from 0 to the end of the range, `step` apart, and evenly spread numbers.
fn sweep(case: &Case, step: usize, even: u32) {
    let mut worst = (0.0, 0.0);
    for bits in (0..=case.3.to_bits()).step_by(step) {
        check(case, f32::from_bits(bits), &mut worst);
    }
    for i in 0..=even {
        check(case, case.3 * (i as f32 / even as f32), &mut worst);
    }
    println!("{}: largest error {:.3e} at {:?}", case.0, worst.0, worst.1);
    assert!(
        worst.0 <= LIMIT,
        "{}: error {:e} at {:?}",
        case.0,
        worst.0,
        worst.1
    );
}

#[test]
fn errors_stay_below_the_limit() {
    for case in &CASES {
        // Twice five million points, both signs of each: the densest part and the whole range of exponents.
        sweep(case, 220, 2_500_000);
    }
}

#[test]
#[ignore = "every binary32 of the range: a minute with --release, half an hour without"]
fn errors_stay_below_the_limit_everywhere() {
    for case in &CASES {
        sweep(case, 1, 1);
    }
}

#[test]
fn exact_values() {
    for (value, expected) in [
        (sin_pi(0.0), 0.0),
        (sin_pi(0.5), 1.0),
        (sin_pi(-0.5), -1.0),
        (sin_pi(1.0), 0.0),
        (sin_pi(-1.0), 0.0),
        (cos_pi(0.0), 1.0),
        (cos_pi(-0.0), 1.0),
        (cos_pi(0.5), 0.0),
        (cos_pi(-0.5), 0.0),
        (cos_pi(1.0), -1.0),
        (cos_pi(-1.0), -1.0),
        (tanh(0.0), 0.0),
        (tanh(10.0), 1.0),
        (tanh(f32::INFINITY), 1.0),
        (tanh(f32::NEG_INFINITY), -1.0),
        (sigmoid(0.0), 0.5),
        (sigmoid(f32::MAX), 1.0),
        (sigmoid(f32::MIN), 0.0),
    ] {
        assert_eq!(value, expected);
    }
}

#[test]
fn symmetry_and_bounds() {
    let all = (0..f32::INFINITY.to_bits())
        .step_by(1009)
        .map(f32::from_bits);
    for x in all {
        assert_eq!(
            tanh(-x).to_bits(),
            (-tanh(x)).to_bits(),
            "tanh is odd at {x:?}"
        );
        assert!((0.0..=1.0).contains(&tanh(x)), "tanh({x:?})");
        assert!(
            (0.0..=1.0).contains(&sigmoid(x)) && (0.0..=1.0).contains(&sigmoid(-x)),
            "sigmoid({x:?})"
        );
        if x <= 1.0 {
            assert_eq!(sin_pi(-x), -sin_pi(x), "sin_pi is odd at {x:?}");
            assert_eq!(cos_pi(-x), cos_pi(x), "cos_pi is even at {x:?}");
            assert!((0.0..=1.0).contains(&sin_pi(x)), "sin_pi({x:?})");
            assert!((-1.0..=1.0).contains(&cos_pi(x)), "cos_pi({x:?})");
        }
    }
}

#[test]
fn nan_passes_through() {
    for case in &CASES {
        assert!(case.1(f32::NAN).is_nan(), "{}", case.0);
    }
}
