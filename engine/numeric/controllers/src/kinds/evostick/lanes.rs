//! EvoStick's network in lanes.

use swarmwright_lanes::Lanes;

use super::{Evostick, STEEPNESS};
use crate::OutputRange;
use crate::functions::lanes::sigmoid;
use crate::kinds::{Kind, LaneKind};
use crate::lanes::nodes::stretched;
use crate::lanes::sums::{Inputs, is_one};

impl LaneKind for Evostick {
    #[inline(always)]
    fn lane_weights(&self) -> usize {
        self.weight_count().unwrap_or(usize::MAX)
    }

    #[inline(always)]
    fn lane_state_length(&self) -> usize {
        0
    }

    #[inline(always)]
    fn lane_scratch_length(&self) -> usize {
        0
    }

    #[inline(always)]
    fn step_in_lanes<L: Lanes, const S: usize, const B: usize>(
        &self,
        (weights, _): (&[L], &[&[f32]]),
        _state: &mut [L],
        _scratch: &mut [L],
        numbers: [L; S],
        (bits, order): (L::Int, [u32; B]),
        actuators: &mut [L],
    ) {
        let copy = numbers;
        forward(weights, Inputs::new(&copy, bits, &order), actuators);
    }

    #[inline(always)]
    fn step_slice_in_lanes<L: Lanes>(
        &self,
        (weights, _): (&[L], &[&[f32]]),
        _state: &mut [L],
        _scratch: &mut [L],
        sensors: &[L],
        actuators: &mut [L],
    ) {
        forward(weights, Inputs::of_numbers(sensors), actuators);
    }
}

/// Two outputs at a time, as wheels come in pairs: their sums do not wait for each other.
#[inline(always)]
fn forward<L: Lanes>(weights: &[L], inputs: Inputs<'_, L>, actuators: &mut [L]) {
    let count = actuators.len();
    let mut first = 0;
    while first + 1 < count {
        outputs::<L, 2>(weights, first, inputs, actuators);
        first += 2;
    }
    if first < count {
        outputs::<L, 1>(weights, first, inputs, actuators);
    }
}

#[inline(always)]
fn outputs<L: Lanes, const N: usize>(
    weights: &[L],
    first: usize,
    inputs: Inputs<'_, L>,
    actuators: &mut [L],
) {
    let mut rows = weights.chunks_exact(actuators.len());
    let mut sums = [L::splat(0.0); N];
    for (input, row) in inputs.numbers.iter().zip(&mut rows) {
        let row = &row[first..][..N];
        for node in 0..N {
            sums[node] = sums[node].add(row[node].mul(*input));
        }
    }
    for (bit, row) in inputs.order.iter().zip(&mut rows) {
        let (is_one, row) = (is_one::<L>(inputs.bits, *bit), &row[first..][..N]);
        for node in 0..N {
            sums[node] = sums[node].add_where(row[node], is_one);
        }
    }
    let biases = &weights[weights.len() - actuators.len() + first..][..N];
    for node in 0..N {
        let output = sigmoid(L::splat(STEEPNESS).mul(sums[node].add(biases[node])));
        actuators[first + node] = stretched(OutputRange::UNIT, output);
    }
}
