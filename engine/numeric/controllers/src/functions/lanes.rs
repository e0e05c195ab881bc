//! tanh, sigmoid, sine and cosine in lanes, the sequences of the module above, operation by operation; logarithm and normal numbers.

use super::{LN, SIN, TANH_LIMIT, TANH_P, TANH_Q};
use swarmwright_lanes::{Int, Lanes};

/// Horner's rule, the highest coefficient last in `coefficients`.
#[inline(always)]
fn polynomial<L: Lanes>(coefficients: &[f32], z: L) -> L {
    let mut p = L::splat(coefficients[coefficients.len() - 1]);
    for coefficient in coefficients[..coefficients.len() - 1].iter().rev() {
        p = p.mul(z).add(L::splat(*coefficient));
    }
    p
}

#[inline(always)]
fn within_one<L: Lanes>(x: L) -> L {
    x.at_most(L::splat(1.0)).at_least(L::splat(-1.0))
}

/// Hyperbolic tangent.
#[inline(always)]
pub fn tanh<L: Lanes>(x: L) -> L {
    let y = x
        .at_most(L::splat(TANH_LIMIT))
        .at_least(L::splat(-TANH_LIMIT));
    let z = y.mul(y);
    let t = y.mul(polynomial(&TANH_P, z)).div(polynomial(&TANH_Q, z));
    within_one(t.add(t).div(L::splat(1.0).add(t.mul(t))))
}

/// Logistic function.
#[inline(always)]
pub fn sigmoid<L: Lanes>(x: L) -> L {
    let half = L::splat(0.5);
    half.add(half.mul(tanh(half.mul(x))))
}

/// sin(pi * a) for a in -1..=1.
#[inline(always)]
pub fn sin_pi<L: Lanes>(a: L) -> L {
    #[expect(clippy::disallowed_names, reason = "the number 1")]
    let (half, one) = (L::splat(0.5), L::splat(1.0));
    let r = one.sub(a).select(a, half.lt(a));
    let r = L::splat(-1.0).sub(r).select(r, r.lt(L::splat(-0.5)));
    sin_pi_half(r)
}

/// cos(pi * a) for a in -1..=1.
#[inline(always)]
pub fn cos_pi<L: Lanes>(a: L) -> L {
    let b = a.neg().select(a, a.lt(L::splat(0.0)));
    sin_pi_half(L::splat(0.5).sub(b))
}

#[inline(always)]
fn sin_pi_half<L: Lanes>(r: L) -> L {
    within_one(r.mul(polynomial(&SIN, r.mul(r))))
}

/// The natural logarithm of a normal number above 0 (Chebyshev fit).
#[inline(always)]
pub fn ln<L: Lanes>(x: L) -> L {
    /// The pattern of sqrt(1/2): what is left of the exponent counts doublings from there.
    const ROOT: i32 = 0x3F35_04F3;
    let bits = x.pattern().sub(L::Int::splat(ROOT));
    let doublings = bits.shr_signed(L::Int::splat(23));
    let mantissa = bits
        .and(L::Int::splat(0x007F_FFFF))
        .add(L::Int::splat(ROOT));
    let f = L::from_pattern(mantissa).sub(L::splat(1.0));
    let whole = L::from_int(doublings).mul(L::splat(std::f32::consts::LN_2));
    f.mul(polynomial(&LN, f)).add(whole)
}

/// Two independent numbers of the standard normal distribution (Box and Muller 1958) from two that are uniform, the first in 0..=1
/// without 0, the second in -1..=1.
#[inline(always)]
pub fn normal_pair<L: Lanes>(length: L, half_turns: L) -> [L; 2] {
    let squared = ln(length).mul(L::splat(-2.0)).at_least(L::splat(0.0));
    let radius = squared.sqrt();
    [
        radius.mul(cos_pi(half_turns)),
        radius.mul(sin_pi(half_turns)),
    ]
}
