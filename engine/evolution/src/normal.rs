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
    if centered.abs() <= 0.425 {
        return centered * CENTER.at(0.180_625 - centered * centered);
    }
    let rare = if centered < 0.0 { share } else { 1.0 - share };
    let depth = (-logarithm(rare.max(LEAST))).sqrt();
    let size = if depth <= 5.0 {
        TAIL.at(depth - 1.6)
    } else {
        FAR.at(depth - 5.0)
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

struct Center<'a>(&'a mut [f64]);

impl Kernel for Center<'_> {
    type Output = ();

    #[inline(always)]
    fn run<L: Lanes>(self) {
        for numbers in self.0.chunks_mut(TOGETHER) {
            let mut shares = [0.5; TOGETHER];
            for (share, number) in shares.iter_mut().zip(&*numbers) {
                *share = number + LEAST;
            }
            let mut drawn = [0.0; TOGETHER];
            for (number, share) in drawn.iter_mut().zip(&shares) {
                let centered = share - 0.5;
                *number = centered * CENTER.at(0.180_625 - centered * centered);
            }
            numbers.copy_from_slice(&drawn[..numbers.len()]);
            tails(&shares, numbers);
        }
    }
}

/// Computes the numbers again that do not lie in the center.
#[inline(always)]
fn tails(shares: &[f64; TOGETHER], numbers: &mut [f64]) {
    let mut places = [0; TOGETHER];
    let mut count = 0;
    for (index, share) in shares.iter().enumerate() {
        places[count] = index;
        count += usize::from((share - 0.5).abs() > 0.425);
    }
    let mut depths = [1.0; TOGETHER];
    for (depth, place) in depths.iter_mut().zip(&places[..count]) {
        let share = shares[*place];
        *depth = if share < 0.5 { share } else { 1.0 - share };
    }
    let mut sizes = [0.0; TOGETHER];
    let together = count.next_multiple_of(8);
    for (size, depth) in sizes[..together].iter_mut().zip(&mut depths[..together]) {
        *depth = (-logarithm(depth.max(LEAST))).sqrt();
        *size = TAIL.at(*depth - 1.6);
    }
    for index in 0..count {
        let (place, depth) = (places[index], depths[index]);
        let size = if depth <= 5.0 {
            sizes[index]
        } else {
            FAR.at(depth - 5.0)
        };
        numbers[place] = if shares[place] < 0.5 { -size } else { size };
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
