//! e^x in binary64, to the bit as FREVO's NEAT computes it.

use std::f64::consts::{LN_2, LOG2_E};
use std::sync::LazyLock;

const LN_2_HIGH: f64 = 6.931_471_803_691_238e-1;
const LN_2_LOW: f64 = 1.908_214_929_270_587_7e-10;
const P: [f64; 5] = [
    1.666_666_666_666_660_2e-1,
    -2.777_777_777_701_559_3e-3,
    6.613_756_321_437_934e-5,
    -1.653_390_220_546_525_2e-6,
    4.138_136_797_057_238_5e-8,
];

/// Steps of the fraction for which e^x is in a table.
const STEPS: i32 = 1024;
/// From here on e^x is infinite, and below the other one 0.
const OVERFLOW: f64 = 709.782_712_893_384;
const UNDERFLOW: f64 = -745.133_219_101_941_1;
const LEAST: i32 = -745;
/// Below, e^x is computed 2^54 times as large, so that nothing is subnormal but the result.
const SMALL: i32 = -705;

/// e to the whole numbers from [`LEAST`] on.
static WHOLE: LazyLock<[f64; 1455]> = LazyLock::new(|| {
    std::array::from_fn(|index| {
        let whole = LEAST + index as i32;
        let shift = if whole < SMALL { 54.0 * LN_2 } else { 0.0 };
        exactly(shift + f64::from(whole))
    })
});
/// e to the fractions from -1 to 1.
static FRACTIONS: LazyLock<[f64; 2049]> = LazyLock::new(|| {
    std::array::from_fn(|index| exactly(f64::from(index as i32 - STEPS) / f64::from(STEPS)))
});

/// e^x as the class FastMath of jodk 1.2 computes it, which FREVO has: the product of e to the whole part, e to the fraction in steps
/// of 1/1024, and the first five terms of the series for the rest. The first two are fdlibm's.
pub fn exp(x: f64) -> f64 {
    if x > OVERFLOW {
        return f64::INFINITY;
    }
    if x < UNDERFLOW {
        return 0.0;
    }
    if x.is_nan() {
        return x;
    }
    let number = (x * f64::from(STEPS)) as i32;
    let (whole, step) = (number / STEPS, number % STEPS);
    let rest = (x - f64::from(whole)) - f64::from(step) * (1.0 / f64::from(STEPS));
    let series = 1.0 + rest * (1.0 + rest * (0.5 + rest * (1.0 / 6.0 + rest * (1.0 / 24.0))));
    let fraction = FRACTIONS[(step + STEPS) as usize] * series;
    let product = WHOLE[(whole - LEAST) as usize] * fraction;
    if whole < SMALL {
        product * power_of_two(-54)
    } else {
        product
    }
}

/// fdlibm's e^x (Sun Microsystems, e_exp.c), for -708 < x < 709.7.
fn exactly(x: f64) -> f64 {
    let power = (LOG2_E * x + 0.5_f64.copysign(x)).trunc();
    let (high, low) = (x - power * LN_2_HIGH, power * LN_2_LOW);
    let r = high - low;
    let t = r * r;
    let c = r - t * (P[0] + t * (P[1] + t * (P[2] + t * (P[3] + t * P[4]))));
    let y = 1.0 - ((low - (r * c) / (2.0 - c)) - high);
    y * power_of_two(power as i64)
}

/// 2^power for a power in -1022..=1023.
fn power_of_two(power: i64) -> f64 {
    f64::from_bits(((1023 + power) as u64) << 52)
}
