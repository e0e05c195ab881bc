//! EvoStick's ground readings on a grey floor: random draws from measured values of the e-puck's three ground sensors.

use swarmwright_lanes::{Int, Lanes, Mask, Number, number};

/// Number of quantiles in a table, with both ends.
const KNOTS: usize = 65;

/// Quantiles of the measured values of each sensor (left, middle, right) at multiples of 1/64; draws are interpolated
/// between them.
///
/// From the tables of the NEAT controllers for ARGoS, whose means are 0.407, 0.342, 0.423 and standard deviations
/// 0.184, 0.119, 0.179. The draws have means 0.407, 0.344, 0.424 and standard deviations 0.182, 0.125, 0.181, because
/// the outer intervals are interpolated as well.
// The values only look like ln(2) by chance.
#[allow(clippy::approx_constant)]
#[rustfmt::skip]
const QUANTILES: [[f32; KNOTS]; 3] = [
    [
        0.0000, 0.0452, 0.1246, 0.1735, 0.2049, 0.2277, 0.2354, 0.2428, 0.2501, 0.2576, 0.2651, 0.2724, 0.2784,
        0.2837, 0.2879, 0.2921, 0.2963, 0.3010, 0.3044, 0.3057, 0.3105, 0.3162, 0.3215, 0.3275, 0.3339, 0.3372,
        0.3406, 0.3441, 0.3480, 0.3519, 0.3553, 0.3600, 0.3654, 0.3703, 0.3755, 0.3811, 0.3862, 0.3913, 0.3965,
        0.4039, 0.4130, 0.4204, 0.4291, 0.4399, 0.4521, 0.4646, 0.4778, 0.4906, 0.5032, 0.5136, 0.5231, 0.5313,
        0.5393, 0.5480, 0.5594, 0.5696, 0.5790, 0.5874, 0.5971, 0.6089, 0.7644, 0.9192, 0.9274, 0.9305, 1.0000,
    ],
    [
        0.0000, 0.0586, 0.1213, 0.1655, 0.1891, 0.2063, 0.2161, 0.2245, 0.2320, 0.2378, 0.2442, 0.2518, 0.2569,
        0.2616, 0.2670, 0.2715, 0.2754, 0.2788, 0.2818, 0.2842, 0.2875, 0.2908, 0.2935, 0.2962, 0.2989, 0.3020,
        0.3065, 0.3132, 0.3191, 0.3246, 0.3285, 0.3323, 0.3360, 0.3394, 0.3430, 0.3467, 0.3518, 0.3571, 0.3620,
        0.3671, 0.3723, 0.3740, 0.3763, 0.3792, 0.3820, 0.3848, 0.3877, 0.3906, 0.3934, 0.3990, 0.4055, 0.4132,
        0.4186, 0.4238, 0.4300, 0.4394, 0.4509, 0.4578, 0.4658, 0.4755, 0.5396, 0.6141, 0.6592, 0.6929, 0.9373,
    ],
    [
        0.0000, 0.0628, 0.1274, 0.1726, 0.2063, 0.2329, 0.2465, 0.2587, 0.2701, 0.2762, 0.2824, 0.2888, 0.2934,
        0.2976, 0.3018, 0.3051, 0.3079, 0.3121, 0.3177, 0.3252, 0.3324, 0.3393, 0.3456, 0.3511, 0.3560, 0.3607,
        0.3647, 0.3679, 0.3712, 0.3744, 0.3766, 0.3789, 0.3813, 0.3836, 0.3865, 0.3906, 0.3952, 0.3999, 0.4050,
        0.4095, 0.4136, 0.4178, 0.4220, 0.4259, 0.4312, 0.4390, 0.4561, 0.4851, 0.5222, 0.5389, 0.5556, 0.5723,
        0.5940, 0.6156, 0.6310, 0.6509, 0.6739, 0.6933, 0.7199, 0.7573, 0.7823, 0.8044, 0.8206, 0.8493, 1.0000,
    ],
];

/// Each quantile in the lower half of a word and the next one in the upper half, in units of 1e-4, for lookup by
/// vectors.
static PAIRS: [[i32; KNOTS - 1]; 3] = {
    let mut pairs = [[0; KNOTS - 1]; 3];
    let mut sensor = 0;
    while sensor < 3 {
        let mut knot = 0;
        while knot + 1 < KNOTS {
            let low = (QUANTILES[sensor][knot] * 1e4 + 0.5) as i32;
            let high = (QUANTILES[sensor][knot + 1] * 1e4 + 0.5) as i32;
            pairs[sensor][knot] = low | high << 16;
            knot += 1;
        }
        sensor += 1;
    }
    pairs
};

/// Returns the inputs for a filtered colour: 0 on black, 1 on white, random draws on grey.
#[inline(always)]
pub fn drawn<L: Lanes>(color: Number<L>, units: [Number<L>; 3]) -> [Number<L>; 3] {
    let grey = number(0.25).lt(color).and(color.lt(number(0.75)));
    let mut inputs = [color; 3];
    if grey.any() {
        for (sensor, input) in inputs.iter_mut().enumerate() {
            let position = units[sensor] * (KNOTS - 1) as f32;
            let whole = position.0.floor();
            let pair = whole.lookup(&PAIRS[sensor]);
            let low = Number(L::from_int(pair.and(L::Int::splat(0xFFFF))));
            let high = Number(L::from_int(pair.shr(L::Int::splat(16))));
            let part = position - Number(L::from_int(whole));
            let between = (low + (high - low) * part) * 1e-4;
            *input = between.select(*input, grey);
        }
    }
    inputs
}
