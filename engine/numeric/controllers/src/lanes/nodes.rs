//! Activation functions and output ranges, in lanes.

use swarmwright_lanes::Lanes;

use crate::functions::lanes as functions;
use crate::{Activation, OutputRange};

/// The activation function. It is selected anew for each node, and always the same one: the processor predicts the branch,
/// and the code stays small, which matters since all of it is compiled for every instruction set.
#[inline(always)]
pub(crate) fn apply<L: Lanes>(activation: Activation, a: L) -> L {
    match activation {
        Activation::Tanh => functions::tanh(a),
        Activation::Sigmoid => functions::sigmoid(a),
        Activation::Relu => relu(a),
        Activation::Clamp => clamp(a),
        Activation::Linear => a,
    }
}

#[inline(always)]
fn relu<L: Lanes>(a: L) -> L {
    a.at_least(L::splat(0.0))
}

#[inline(always)]
fn clamp<L: Lanes>(a: L) -> L {
    a.at_least(L::splat(0.0)).at_most(L::splat(1.0))
}

/// The same for the sums of several nodes: one selection for all.
#[inline(always)]
pub(crate) fn apply_to<L: Lanes, const N: usize>(
    activation: Activation,
    mut sums: [L; N],
) -> [L; N] {
    macro_rules! each {
        ($function:expr) => {
            for sum in &mut sums {
                *sum = $function(*sum);
            }
        };
    }
    match activation {
        Activation::Tanh => each!(functions::tanh),
        Activation::Sigmoid => each!(functions::sigmoid),
        Activation::Relu => each!(relu),
        Activation::Clamp => each!(clamp),
        Activation::Linear => {}
    }
    sums
}

/// An output of the range as an actuator; what lies outside of the range stays outside.
#[inline(always)]
pub(crate) fn stretched<L: Lanes>(range: OutputRange, output: L) -> L {
    #[expect(clippy::disallowed_names, reason = "the number 1")]
    let (one, two) = (L::splat(1.0), L::splat(2.0));
    if range == OutputRange::SYMMETRIC {
        output
    } else if range == OutputRange::UNIT {
        two.mul(output).sub(one)
    } else {
        let (low, high) = range.bounds();
        output
            .sub(L::splat(low))
            .div(L::splat(high - low))
            .mul(two)
            .sub(one)
    }
}
