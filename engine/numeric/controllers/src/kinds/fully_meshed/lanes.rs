//! Fully meshed networks in lanes.

use std::hint::black_box;

use swarmwright_lanes::Lanes;

use super::FullyMeshed;
use crate::kinds::{Kind, LaneKind};
use crate::lanes::nodes::{apply, apply_to, stretched};
use crate::lanes::sums::{Inputs, add_row, add_rows, split};

impl LaneKind for FullyMeshed {
    #[inline(always)]
    fn lane_weights(&self) -> usize {
        self.weight_count().unwrap_or(usize::MAX)
    }

    /// The outputs of all nodes except sensors.
    #[inline(always)]
    fn lane_state_length(&self) -> usize {
        self.hidden + self.actuators
    }

    #[inline(always)]
    fn lane_scratch_length(&self) -> usize {
        2 * (self.hidden + self.actuators)
    }

    #[inline(always)]
    fn step_in_lanes<L: Lanes, const S: usize, const B: usize>(
        &self,
        (weights, _): (&[L], &[&[f32]]),
        state: &mut [L],
        scratch: &mut [L],
        numbers: [L; S],
        (bits, order): (L::Int, [u32; B]),
        actuators: &mut [L],
    ) {
        // A handful of nodes, as in the built-in examples, stay in registers from iteration to iteration.
        match self.hidden + self.actuators {
            3 => small::<L, 3>(self, weights, state, Inputs::new(&numbers, bits, &order)),
            4 => small::<L, 4>(self, weights, state, Inputs::new(&numbers, bits, &order)),
            _ => {
                // A copy, since these go through sensors in a loop: the others may keep theirs in registers.
                let copy = numbers;
                let sensors = Inputs::new(&copy, bits, &order);
                large(self, weights, state, scratch, sensors);
            }
        }
        self.actuate(state, actuators);
    }

    #[inline(always)]
    fn step_slice_in_lanes<L: Lanes>(
        &self,
        (weights, _): (&[L], &[&[f32]]),
        state: &mut [L],
        scratch: &mut [L],
        sensors: &[L],
        actuators: &mut [L],
    ) {
        large(self, weights, state, scratch, Inputs::of_numbers(sensors));
        self.actuate(state, actuators);
    }
}

impl FullyMeshed {
    #[inline(always)]
    fn actuate<L: Lanes>(&self, state: &[L], actuators: &mut [L]) {
        for (actuator, output) in actuators.iter_mut().zip(&state[self.hidden..]) {
            *actuator = stretched(self.output_range, *output);
        }
    }
}

/// A fully meshed network of `N` nodes besides sensors.
///
/// Sensors come first in every sum and do not change within a step, so their part of it is the same in every
/// iteration, to the bit.
#[inline(always)]
fn small<L: Lanes, const N: usize>(
    net: &FullyMeshed,
    weights: &[L],
    state: &mut [L],
    sensors: Inputs<'_, L>,
) {
    let length = sensors.len() + N + 1;
    let weights = &weights[..N * length];
    let heard = add_rows(
        [L::splat(0.0); N],
        split::<L, N>(weights, length, 1),
        sensors,
    );
    let mut outputs = [L::splat(0.0); N];
    outputs.copy_from_slice(&state[..N]);
    for _ in 0..net.iterations {
        // The compiler shall not know that these are the same weights each time: it would load them all before the
        // first iteration, into more registers than there are, and so copy them to the stack.
        let weights = &black_box(weights)[..N * length];
        let rows = split::<L, N>(weights, length, 1 + sensors.len());
        let mut sums = add_rows(heard, rows, Inputs::of_numbers(&outputs));
        for node in 0..N {
            sums[node] = weights[node * length].add(sums[node]);
        }
        outputs = apply_to(net.activation, sums);
    }
    state[..N].copy_from_slice(&outputs);
}

/// A fully meshed network of any size.
#[inline(always)]
fn large<L: Lanes>(
    net: &FullyMeshed,
    weights: &[L],
    state: &mut [L],
    scratch: &mut [L],
    sensors: Inputs<'_, L>,
) {
    let active = net.hidden + net.actuators;
    let length = net.nodes() + 1;
    let (heard, next) = scratch[..2 * active].split_at_mut(active);
    for (heard, row) in heard.iter_mut().zip(weights.chunks_exact(length)) {
        *heard = add_row(L::splat(0.0), &row[1..], sensors);
    }
    for _ in 0..net.iterations {
        for ((next, heard), row) in next
            .iter_mut()
            .zip(heard.iter())
            .zip(weights.chunks_exact(length))
        {
            *next = apply(
                net.activation,
                row[0].add(add_row(
                    *heard,
                    &row[1 + net.sensors..],
                    Inputs::of_numbers(&state[..active]),
                )),
            );
        }
        state[..active].copy_from_slice(next);
    }
}
