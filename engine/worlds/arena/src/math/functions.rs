//! Functions that the arithmetic of controllers lacks, as fixed sequences of binary32 operations.
//!
//! Polynomials are Chebyshev fits. The error is at most 2e-7: relative for the exponential, absolute for the others.

use swarmwright_controllers::functions::lanes;
use swarmwright_lanes::{Int, Lanes, Number, number};

/// Coefficients of atan(a) / (pi a) as a polynomial in a^2, for a^2 in 0..=1.
const ATAN: [f32; 8] = [
    0.318_309_84,
    -0.106_098_92,
    0.063_564_05,
    -0.044_616_18,
    0.031_532_086,
    -0.018_897_135,
    0.007_692_337,
    -0.001_486_116_7,
];
/// Coefficients of exp(r) for r in -ln(2)/2..=ln(2)/2.
const EXP: [f32; 7] = [
    1.0,
    1.0,
    0.5,
    0.166_664_15,
    0.041_666_217,
    0.008_375_129,
    0.001_394_858_1,
];
/// Evaluates a polynomial by Horner's rule; the highest coefficient is last.
#[inline(always)]
fn polynomial<L: Lanes>(coefficients: &[f32], x: Number<L>) -> Number<L> {
    let mut p = number(coefficients[coefficients.len() - 1]);
    for coefficient in coefficients[..coefficients.len() - 1].iter().rev() {
        p = p * x + *coefficient;
    }
    p
}

/// Returns |x|.
#[inline(always)]
pub fn absolute<L: Lanes>(x: Number<L>) -> Number<L> {
    Number(L::from_pattern(
        x.0.pattern().and(L::Int::splat(0x7FFF_FFFF)),
    ))
}

/// Returns the angle of a vector in half turns, -1..=1, counter-clockwise from x; 0 for the zero vector.
#[inline(always)]
pub fn bearing<L: Lanes>(x: Number<L>, y: Number<L>) -> Number<L> {
    let (ax, ay) = (absolute(x), absolute(y));
    let steep = ax.lt(ay);
    let (low, high) = (ax.select(ay, steep), ay.select(ax, steep));
    // The smallest normal number prevents NaN for the zero vector.
    let a = low / high.at_least(number(f32::MIN_POSITIVE));
    let angle = a * polynomial(&ATAN, a * a);
    let angle = (number(0.5) - angle).select(angle, steep);
    let angle = (number(1.0) - angle).select(angle, x.lt(number(0.0)));
    (-angle).select(angle, y.lt(number(0.0)))
}

/// Returns e^x for x in -80..=80.
#[inline(always)]
pub fn exp<L: Lanes>(x: Number<L>) -> Number<L> {
    let whole = (x * std::f32::consts::LOG2_E + 0.5).0.floor();
    let n = Number(L::from_int(whole));
    // ln(2) is split into two parts; products of the first part with n are exact.
    let r = x - n * 0.693_359_4 + n * 2.121_944_4e-4;
    let scale = whole.add(L::Int::splat(127)).shl(L::Int::splat(23));
    polynomial(&EXP, r) * Number(L::from_pattern(scale))
}

/// Returns the natural logarithm of a normal number above 0.
#[inline(always)]
pub fn ln<L: Lanes>(x: Number<L>) -> Number<L> {
    Number(lanes::ln(x.0))
}

/// Returns two independent numbers of the standard normal distribution from two uniform numbers in 0..1, the first
/// above 0.
#[inline(always)]
pub fn normal<L: Lanes>(length: Number<L>, angle: Number<L>) -> [Number<L>; 2] {
    let half_turns = angle + angle - number(1.0);
    lanes::normal_pair(length.0, half_turns.0).map(Number)
}

/// Returns the square of the length of a vector.
#[inline(always)]
pub fn square<L: Lanes>([x, y]: [Number<L>; 2]) -> Number<L> {
    x * x + y * y
}

/// Returns the probability of at least one of two independent events.
#[inline(always)]
pub fn either(first: f32, second: f32) -> f32 {
    1.0 - (1.0 - first) * (1.0 - second)
}
