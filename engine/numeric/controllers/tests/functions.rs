//! Accuracy and exact values of the fixed sequences, against binary64.

use std::f64::consts::PI;
use swarmwright_controllers::functions::{cos_pi, exp, sigmoid, sin_pi, tanh};

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

/// Bits of x, and of what FREVO's FastMath gives for e^x.
const EXP: [(u64, u64); 19] = [
    (0xc08750249197a10f, 0x0000000000000000), // -746
    (0xc0871ff2810ed2a5, 0x0000000000000055), // -740
    (0xc08680017939952c, 0x0000000991f1708f), // -720
    (0xc08610053cec5852, 0x0045e95306a5c972), // -706
    (0xc0860bfecf02fcd2, 0x00521ea542eda860), // -705.5
    (0xc0860000bf472bae, 0x007448531b0e2a3e), // -704
    (0xc072c02776bed828, 0x24e2188a45cae5de), // -300
    (0xc035000051545293, 0x3e0a0da889f52d0d), // -21
    (0xbff33360d40c53b2, 0x3fd3468d1df7b5c9), // -1.2
    (0xbfd333d197ebea47, 0x3fe7b48dbe6e6bfa), // -0.3
    (0xbf50e13c43ec301d, 0x3feff7907eb2b250), // -0.00103
    (0x3fc998ae84bc3a68, 0x3ff38ab9ba57422e), // 0.2
    (0x3feccce0bbe2f383, 0x4003ad50a7449c08), // 0.9
    (0x3ffb341c4ef42000, 0x4015e691819de109), // 1.7
    (0x4032ffd465227a14, 0x41a5433983729439), // 19
    (0x405000056a839ab8, 0x45b4274cb7033250), // 64
    (0x407f400400000000, 0x6d0460ba358d0ac6), // 500
    (0x40862997be0c8026, 0x7fe1da1d2a0ea365), // 709.2
    (0x4086401068c2b68a, 0x7ff0000000000000), // 712
];

#[test]
fn exp_is_that_of_frevo_to_the_bit() {
    for (x, y) in EXP {
        assert_eq!(exp(f64::from_bits(x)).to_bits(), y, "{}", f64::from_bits(x));
    }
    assert!(exp(f64::NAN).is_nan());
    assert_eq!(exp(-0.0).to_bits(), 1.0_f64.to_bits());
}
