//! Layered networks in lanes.

use swarmwright_lanes::Lanes;

use super::Layered;
use crate::Activation;
use crate::kinds::{Kind, LaneKind};
use crate::lanes::nodes::{apply, stretched};
use crate::lanes::sums::{Inputs, add_row, add_rows, split};

impl LaneKind for Layered {
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
        self.scratch_length()
    }

    #[inline(always)]
    fn step_in_lanes<L: Lanes, const S: usize, const B: usize>(
        &self,
        (weights, _): (&[L], &[&[f32]]),
        _state: &mut [L],
        scratch: &mut [L],
        numbers: [L; S],
        (bits, order): (L::Int, [u32; B]),
        actuators: &mut [L],
    ) {
        // A copy, since networks read sensors in a loop, while other kinds may keep them in registers.
        let copy = numbers;
        let inputs = Inputs::new(&copy, bits, &order);
        self.forward(weights, scratch, inputs, actuators);
    }

    #[inline(always)]
    fn step_slice_in_lanes<L: Lanes>(
        &self,
        (weights, _): (&[L], &[&[f32]]),
        _state: &mut [L],
        scratch: &mut [L],
        sensors: &[L],
        actuators: &mut [L],
    ) {
        self.forward(weights, scratch, Inputs::of_numbers(sensors), actuators);
    }
}

impl Layered {
    #[inline(always)]
    fn forward<L: Lanes>(
        &self,
        weights: &[L],
        scratch: &mut [L],
        sensors: Inputs<'_, L>,
        actuators: &mut [L],
    ) {
        let (mut below, mut above) = scratch.split_at_mut(scratch.len() / 2);
        let mut width = self.sensors;
        let mut rest = weights;
        let mut inputs = sensors;
        for (nodes, activation) in self.layers() {
            let (rows, behind) = rest.split_at(nodes * (width + 1));
            layer(activation, rows, inputs, &mut above[..nodes]);
            (below, above) = (above, below);
            (width, rest) = (nodes, behind);
            inputs = Inputs::of_numbers(&below[..width]);
        }
        for (actuator, output) in actuators.iter_mut().zip(inputs.numbers) {
            *actuator = stretched(self.output_range, *output);
        }
    }
}

/// A layer of nodes: the sum of the products, then the bias, then the function.
#[inline(always)]
fn layer<L: Lanes>(activation: Activation, rows: &[L], inputs: Inputs<'_, L>, outputs: &mut [L]) {
    let length = inputs.len() + 1;
    let mut fours = outputs.chunks_exact_mut(4);
    let mut rest = rows;
    for four in &mut fours {
        let sums = add_rows([L::splat(0.0); 4], split::<L, 4>(rest, length, 1), inputs);
        for node in 0..4 {
            four[node] = rest[node * length].add(sums[node]);
        }
        rest = &rest[4 * length..];
    }
    for output in fours.into_remainder() {
        *output = rest[0].add(add_row(L::splat(0.0), &rest[1..length], inputs));
        rest = &rest[length..];
    }
    // Afterwards, so that functions are compiled once, and not for each of the nodes above.
    for output in outputs {
        *output = apply(activation, *output);
    }
}
