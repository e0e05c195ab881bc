//! Networks that grow in lanes: each lane has a network of its own shape, and these are computed one after the other.

use swarmwright_lanes::Lanes;

use super::{Cells, Growing};
use crate::kinds::LaneKind;
use crate::lanes::nodes::stretched;

/// One lane: its sensors, and its outputs.
struct Lane<'a, L>(usize, &'a [L], &'a mut [L]);

impl<L: Lanes> Cells for Lane<'_, L> {
    #[inline(always)]
    fn sensor(&self, index: usize) -> f32 {
        self.1[index].numbers()[self.0]
    }

    #[inline(always)]
    fn output(&self, index: usize) -> f32 {
        self.2[index].numbers()[self.0]
    }

    #[inline(always)]
    fn set_output(&mut self, index: usize, value: f32) {
        self.2[index].numbers_mut()[self.0] = value;
    }
}

impl LaneKind for Growing {
    #[inline(always)]
    fn step_slice_in_lanes<L: Lanes>(
        &self,
        (_, genomes): (&[L], &[&[f32]]),
        state: &mut [L],
        _scratch: &mut [L],
        sensors: &[L],
        actuators: &mut [L],
    ) {
        for (lane, genome) in genomes.iter().enumerate() {
            self.update(genome, &mut Lane(lane, sensors, state));
        }
        for (actuator, output) in actuators.iter_mut().zip(&*state) {
            *actuator = stretched(self.output_range, *output);
        }
    }
}
