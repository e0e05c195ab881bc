//! EvoStick's network in lanes.

use swarmwright_lanes::Lanes;

use super::{Evostick, STEEPNESS};
use crate::OutputRange;
use crate::functions::lanes::sigmoid;
use crate::kinds::{Kind, LaneKind};
use crate::lanes::nodes::stretched;
use crate::lanes::sums::{Inputs, add_rows, split};

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
    let length = inputs.len() + 1;
    let mut rest = weights;
    let mut pairs = actuators.chunks_exact_mut(2);
    for pair in &mut pairs {
        outputs::<L, 2>(rest, inputs, pair);
        rest = &rest[2 * length..];
    }
    for last in pairs.into_remainder().chunks_exact_mut(1) {
        outputs::<L, 1>(rest, inputs, last);
    }
}

#[inline(always)]
fn outputs<L: Lanes, const N: usize>(rows: &[L], inputs: Inputs<'_, L>, actuators: &mut [L]) {
    let length = inputs.len() + 1;
    let sums = add_rows([L::splat(0.0); N], split::<L, N>(rows, length, 0), inputs);
    for node in 0..N {
        let sum = sums[node].add(rows[node * length + length - 1]);
        let output = sigmoid(L::splat(STEEPNESS).mul(sum));
        actuators[node] = stretched(OutputRange::UNIT, output);
    }
}
