//! tanh, sigmoid, sine and cosine as fixed sequences of binary32 operations.
//!
//! Every line is one IEEE 754 operation (or one comparison that selects), rounded to nearest, in the order written,
//! subnormals kept. Rust neither contracts a multiplication and an addition to a fused one nor re-associates, so
//! the source is what runs. Comparisons are written so that a NaN passes through. Error against the true value:
//! at most 2e-7 absolute. Decision 002 repeats the sequences and the coefficients for other languages.

mod exp;
/// The same sequences for lanes.
pub mod lanes;

pub use exp::exp;

/// From here on tanh is 1 in binary32.
const TANH_LIMIT: f32 = 9.15;
const TANH_P: [f32; 4] = [0.5, 0.015736774, 7.970824e-5, 4.2581547e-8];
const TANH_Q: [f32; 4] = [1.0, 0.11480684, 0.0013933508, 2.7218455e-6];
// Nearest binary32 to pi: the fit ends there by itself.
#[allow(clippy::approx_constant)]
const SIN: [f32; 5] = [3.1415927, -5.167707, 2.5500288, -0.59804523, 0.077220164];

/// ln(1 + f) / f over f in sqrt(1/2)-1..=sqrt(2)-1.
const LN: [f32; 10] = [
    1.0,
    -0.499_999_88,
    0.333_333_25,
    -0.250_015_85,
    0.200_020_72,
    -0.166_091_26,
    0.141_800_8,
    -0.132_408_43,
    0.129_141_7,
    -0.076_385_92,
];

/// Hyperbolic tangent, in -1..=1, odd to the bit.
///
/// With t = tanh(x/2) as a quotient of polynomials (relative minimax fit on 0..9.15), tanh(x) = 2t / (1 + t*t):
/// doubling the argument shrinks the relative error of t.
#[inline]
pub fn tanh(x: f32) -> f32 {
    let y = if x > TANH_LIMIT { TANH_LIMIT } else { x };
    let y = if y < -TANH_LIMIT { -TANH_LIMIT } else { y };
    let z = y * y;
    let p = ((TANH_P[3] * z + TANH_P[2]) * z + TANH_P[1]) * z + TANH_P[0];
    let q = ((TANH_Q[3] * z + TANH_Q[2]) * z + TANH_Q[1]) * z + TANH_Q[0];
    let t = (y * p) / q;
    let h = (t + t) / (1.0 + t * t);
    let h = if h > 1.0 { 1.0 } else { h };
    if h < -1.0 { -1.0 } else { h }
}

/// Logistic function 1 / (1 + e^-x), in 0..=1, computed as 0.5 + 0.5 * tanh(0.5 * x).
#[inline]
pub fn sigmoid(x: f32) -> f32 {
    0.5 + 0.5 * tanh(0.5 * x)
}

/// sin(pi * a) for a in -1..=1, in -1..=1; exact at multiples of a half.
#[inline]
pub fn sin_pi(a: f32) -> f32 {
    // 1 - a is exact for a in 0.5..=1.
    let r = if a > 0.5 { 1.0 - a } else { a };
    let r = if a < -0.5 { -1.0 - a } else { r };
    sin_pi_half(r)
}

/// cos(pi * a) for a in -1..=1, in -1..=1; exact at multiples of a half.
#[inline]
pub fn cos_pi(a: f32) -> f32 {
    let b = if a < 0.0 { -a } else { a };
    sin_pi_half(0.5 - b)
}

/// sin(pi * r) for r in -0.5..=0.5 (absolute minimax fit, odd).
#[inline]
fn sin_pi_half(r: f32) -> f32 {
    let z = r * r;
    let p = (((SIN[4] * z + SIN[3]) * z + SIN[2]) * z + SIN[1]) * z + SIN[0];
    let s = r * p;
    let s = if s > 1.0 { 1.0 } else { s };
    if s < -1.0 { -1.0 } else { s }
}
