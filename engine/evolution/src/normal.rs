//! Normally distributed numbers, the same bits on every machine.

use swarmwright_lanes::{Kernel, Lanes, Level};

/// Numerator and denominator of a rational function, highest power first.
struct Ratio([f64; 8], [f64; 8]);

/// For |share - 1/2| <= 0.425.
const CENTER: Ratio = Ratio(
    [
        2509.0809287301227,
        33430.57558358813,
        67265.7709270087,
        45921.95393154987,
        13731.69376550946,
        1971.5909503065513,
        133.14166789178438,
        3.3871328727963665,
    ],
    [
        5226.495278852854,
        28729.085735721943,
        39307.89580009271,
        21213.794301586597,
        5394.196021424751,
        687.1870074920579,
        42.31333070160091,
        1.0,
    ],
);
/// For the tails, up to a depth of 5.
const TAIL: Ratio = Ratio(
    [
        0.0007745450142783414,
        0.022723844989269184,
        0.2417807251774506,
        1.2704582524523684,
        3.6478483247632045,
        5.769497221460691,
        4.630337846156546,
        1.4234371107496835,
    ],
    [
        1.0507500716444169e-09,
        0.0005475938084995345,
        0.015198666563616457,
        0.14810397642748008,
        0.6897673349851,
        1.6763848301838038,
        2.053191626637759,
        1.0,
    ],
);
/// Beyond.
const FAR: Ratio = Ratio(
    [
        2.0103343992922881e-07,
        2.7115555687434876e-05,
        0.0012426609473880784,
        0.026532189526576124,
        0.29656057182850487,
        1.7848265399172913,
        5.463784911164114,
        6.657904643501103,
    ],
    [
        2.0442631033899397e-15,
        1.421511758316446e-07,
        1.8463183175100548e-05,
        0.0007868691311456133,
        0.014875361290850615,
        0.1369298809227358,
        0.599832206555888,
        1.0,
    ],
);
/// Of the series of the logarithm, highest power first.
const ODD: [f64; 12] = [
    1.0 / 23.0,
    1.0 / 21.0,
    1.0 / 19.0,
    1.0 / 17.0,
    1.0 / 15.0,
    1.0 / 13.0,
    1.0 / 11.0,
    1.0 / 9.0,
    1.0 / 7.0,
    1.0 / 5.0,
    1.0 / 3.0,
    1.0,
];
/// Depth up to which the tails go.
const FARTHEST: f64 = 5.0;
/// 2^-54.
const LEAST: f64 = 1.0 / 18_014_398_509_481_984.0;

/// The number below which a share of the standard normal distribution lies, for shares in (0, 1).
///
/// Algorithm AS 241, PPND16 (Wichura, Applied Statistics 37, 1988; relative error about 1e-16), in single operations
/// of +, -, *, / and square roots, with a logarithm of its own, because those of C libraries differ.
#[must_use]
#[inline]
pub fn normal_at(share: f64) -> f64 {
    let centered = share - 0.5;
    if centered.abs() <= BORDER {
        return centered * CENTER.at(0.180_625 - centered * centered);
    }
    let rare = if centered < 0.0 { share } else { 1.0 - share };
    let depth = (-logarithm(rare.max(LEAST))).sqrt();
    let size = if depth <= FARTHEST {
        TAIL.at(depth - 1.6)
    } else {
        FAR.at(depth - FARTHEST)
    };
    if centered < 0.0 { -size } else { size }
}

/// The normal number of a unit, a multiple of 2^-53 in 0 .. 1 without 1: |z| <= 8.3.
#[inline]
pub(crate) fn of_unit(unit: f64) -> f64 {
    normal_at(unit + LEAST)
}

/// The normal numbers of units in place of them; as [`of_unit`], and faster for many.
pub(crate) fn of_units(units: &mut [f64]) {
    Level::best().run(Center(units));
}

/// Numbers that are computed together.
const TOGETHER: usize = 256;
/// Numbers of a vector; so many more than are wanted may be computed.
const VECTOR: usize = 8;
/// Room for as many as are computed together and a vector behind them.
const ROOM: usize = TOGETHER + VECTOR;
/// How far from 1/2 a share is in the center at most.
const BORDER: f64 = 0.425;

struct Center<'a>(&'a mut [f64]);

impl Kernel for Center<'_> {
    type Output = ();

    #[inline(always)]
    fn run<L: Lanes>(self) {
        let mut parts = self.0.chunks_exact_mut(TOGETHER);
        for numbers in &mut parts {
            together::<L>(numbers);
        }
        let rest = parts.into_remainder();
        if !rest.is_empty() {
            let mut numbers = [0.5; TOGETHER];
            numbers[..rest.len()].copy_from_slice(rest);
            together::<L>(&mut numbers[..rest.len().next_multiple_of(VECTOR)]);
            rest.copy_from_slice(&numbers[..rest.len()]);
        }
    }
}

/// Whole vectors of numbers, at most [`TOGETHER`].
#[inline(always)]
fn together<L: Lanes>(numbers: &mut [f64]) {
    let mut shares = [0.5; TOGETHER];
    let shares = &mut shares[..numbers.len()];
    for (share, number) in shares.iter_mut().zip(&mut *numbers) {
        *share = *number + LEAST;
        let centered = *share - 0.5;
        *number = centered * CENTER.at(0.180_625 - centered * centered);
    }
    let (mut places, mut tails) = ([0; ROOM], [0.25; ROOM]);
    let count = L::outside(shares, 0.5, BORDER, &mut places, &mut tails);
    let tails = &mut tails[..count.next_multiple_of(VECTOR)];
    tails[count..].fill(0.25);
    let mut deepest = 0.0;
    let mut depths = [0.0; ROOM];
    for (depth, share) in depths.iter_mut().zip(&mut *tails) {
        let rare = if *share < 0.5 { *share } else { 1.0 - *share };
        *depth = (-logarithm(rare.max(LEAST))).sqrt();
        let size = TAIL.at(*depth - 1.6);
        *share = if *share < 0.5 { -size } else { size };
    }
    for depth in &depths[..count] {
        deepest = if *depth > deepest { *depth } else { deepest };
    }
    if deepest > FARTHEST {
        far(&depths[..count], tails);
    }
    for (place, size) in places[..count].iter().zip(tails) {
        numbers[*place as usize] = *size;
    }
}

/// Computes those again that lie beyond the tails.
#[cold]
fn far(depths: &[f64], numbers: &mut [f64]) {
    for (depth, number) in depths.iter().zip(numbers) {
        if *depth > FARTHEST {
            *number = FAR.at(*depth - FARTHEST).copysign(*number);
        }
    }
}

impl Ratio {
    #[inline(always)]
    fn at(&self, at: f64) -> f64 {
        polynomial(&self.0, at) / polynomial(&self.1, at)
    }
}

#[inline(always)]
fn polynomial(coefficients: &[f64], at: f64) -> f64 {
    coefficients[1..]
        .iter()
        .fold(coefficients[0], |value, coefficient| {
            value * at + coefficient
        })
}

/// The natural logarithm of a positive, normal number: the power of two apart, then the series of artanh.
#[inline(always)]
fn logarithm(number: f64) -> f64 {
    const HALF: u64 = 1022 << 52;
    const FRACTION: u64 = (1 << 52) - 1;
    /// 2^52: with it, the lowest bits of a number are those of an integer.
    const INTEGER: f64 = 4_503_599_627_370_496.0;
    let bits = number.to_bits();
    let mantissa = f64::from_bits(bits & FRACTION | HALF);
    let exponent = f64::from_bits(INTEGER.to_bits() | bits >> 52) - INTEGER - 1022.0;
    let small = mantissa < std::f64::consts::FRAC_1_SQRT_2;
    let mantissa = if small { mantissa * 2.0 } else { mantissa };
    let power = if small { exponent - 1.0 } else { exponent };
    let ratio = (mantissa - 1.0) / (mantissa + 1.0); // at most 0.1716 in size
    let series = polynomial(&ODD, ratio * ratio);
    power * std::f64::consts::LN_2 + 2.0 * ratio * series
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        // All over, in the tails and beyond them, and at their borders.
        #[test]
        fn many_are_the_same_as_each_with_every_instruction_set(
            units in prop::collection::vec(
                prop_oneof![
                    4 => 0_u64..1 << 53,
                    1 => 0_u64..100_000,
                    1 => (1_u64 << 53) - 100_000..1 << 53,
                    1 => (0_u64..5).prop_map(|next| (0.075 * 9_007_199_254_740_992.0) as u64 + next - 2),
                    1 => (0_u64..5).prop_map(|next| (0.925 * 9_007_199_254_740_992.0) as u64 + next - 2),
                    1 => Just(0),
                ],
                0..600,
            ),
        ) {
            let units: Vec<f64> = units.into_iter().map(|unit| unit as f64 / 9_007_199_254_740_992.0).collect();
            let expected: Vec<u64> = units.iter().map(|unit| of_unit(*unit).to_bits()).collect();
            for level in Level::available() {
                let mut numbers = units.clone();
                level.run(Center(&mut numbers));
                let found: Vec<u64> = numbers.into_iter().map(f64::to_bits).collect();
                prop_assert_eq!(&found, &expected, "{}", level.name());
            }
        }
    }
}
