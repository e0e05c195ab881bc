//! Functions that the controllers' arithmetic does not have, as fixed sequences of binary32 operations.
//!
//! Polynomials are Chebyshev fits; the error is at most 2e-7 of the true value (absolute; of the exponential relative).

use swarmwright_controllers::functions::lanes;
use swarmwright_lanes::{Int, Lanes, Number, number};

/// atan(a) / (pi a) over a^2 in 0..=1.
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
/// exp(r) over r in -ln(2)/2..=ln(2)/2.
const EXP: [f32; 7] = [
    1.0,
    1.0,
    0.5,
    0.166_664_15,
    0.041_666_217,
    0.008_375_129,
    0.001_394_858_1,
];
/// Horner's rule, the highest coefficient last.
#[inline(always)]
fn polynomial<L: Lanes>(coefficients: &[f32], x: Number<L>) -> Number<L> {
    let mut p = number(coefficients[coefficients.len() - 1]);
    for coefficient in coefficients[..coefficients.len() - 1].iter().rev() {
        p = p * x + *coefficient;
    }
    p
}

/// |x|
#[inline(always)]
pub(crate) fn absolute<L: Lanes>(x: Number<L>) -> Number<L> {
    Number(L::from_pattern(
        x.0.pattern().and(L::Int::splat(0x7FFF_FFFF)),
    ))
}

/// The angle of a vector in half turns, -1..=1, counter-clockwise from x; 0 for the vector 0, 0.
#[inline(always)]
pub(crate) fn bearing<L: Lanes>(x: Number<L>, y: Number<L>) -> Number<L> {
    let (ax, ay) = (absolute(x), absolute(y));
    let steep = ax.lt(ay);
    let (low, high) = (ax.select(ay, steep), ay.select(ax, steep));
    // The smallest normal number keeps 0, 0 from being no number.
    let a = low / high.at_least(number(f32::MIN_POSITIVE));
    let angle = a * polynomial(&ATAN, a * a);
    let angle = (number(0.5) - angle).select(angle, steep);
    let angle = (number(1.0) - angle).select(angle, x.lt(number(0.0)));
    (-angle).select(angle, y.lt(number(0.0)))
}

/// e^x for x in -80..=80.
#[inline(always)]
pub(crate) fn exp<L: Lanes>(x: Number<L>) -> Number<L> {
    let whole = (x * std::f32::consts::LOG2_E + 0.5).0.floor();
    let n = Number(L::from_int(whole));
    // ln(2) in two parts, the first one exact in products with n.
    let r = x - n * 0.693_359_4 + n * 2.121_944_4e-4;
    let scale = whole.add(L::Int::splat(127)).shl(L::Int::splat(23));
    polynomial(&EXP, r) * Number(L::from_pattern(scale))
}

/// The natural logarithm of a normal number above 0.
#[inline(always)]
pub(crate) fn ln<L: Lanes>(x: Number<L>) -> Number<L> {
    Number(lanes::ln(x.0))
}

/// Two independent numbers of the standard normal distribution from two in 0..1, the first above 0.
#[inline(always)]
pub(crate) fn normal<L: Lanes>(length: Number<L>, angle: Number<L>) -> [Number<L>; 2] {
    let half_turns = angle + angle - number(1.0);
    lanes::normal_pair(length.0, half_turns.0).map(Number)
}

/// The square of the length of a vector.
#[inline(always)]
pub(crate) fn square<L: Lanes>([x, y]: [Number<L>; 2]) -> Number<L> {
    x * x + y * y
}

/// The probability of at least one of two independent causes.
#[inline(always)]
pub(crate) fn either(first: f32, second: f32) -> f32 {
    1.0 - (1.0 - first) * (1.0 - second)
}
