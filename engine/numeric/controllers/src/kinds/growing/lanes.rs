//! Networks that grow in lanes: each lane has a network of its own shape, and these are computed one after the other.

use swarmwright_lanes::Lanes;

use super::{Cells, Growing};
use crate::kinds::{Kind, LaneKind};
use crate::lanes::nodes::stretched;

/// One lane: its sensors, and what it keeps.
struct Lane<'a, L>(usize, &'a [L], &'a mut [L]);

impl<L: Lanes> Cells for Lane<'_, L> {
    #[inline(always)]
    fn sensor(&self, index: usize) -> f32 {
        self.1[index].numbers()[self.0]
    }

    #[inline(always)]
    fn kept(&self, index: usize) -> f32 {
        self.2[index].numbers()[self.0]
    }

    #[inline(always)]
    fn keep(&mut self, index: usize, value: f32) {
        self.2[index].numbers_mut()[self.0] = value;
    }
}

impl LaneKind for Growing {
    /// Each lane takes the weights from its genome.
    #[inline(always)]
    fn lane_weights(&self) -> usize {
        0
    }

    #[inline(always)]
    fn lane_state_length(&self) -> usize {
        self.state_length()
    }

    /// Sensors and actuators.
    #[inline(always)]
    fn lane_scratch_length(&self) -> usize {
        self.sensors + self.actuators
    }

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
