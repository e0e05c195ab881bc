//! tanh, sigmoid, sine and cosine in lanes: the sequences of the module above, operation by operation.

use super::{SIN, TANH_LIMIT, TANH_P, TANH_Q};
use swarmwright_lanes::Lanes;

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
