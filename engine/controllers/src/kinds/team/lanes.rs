//! Teams in lanes: agents of a lane would have different controllers, so that no simulation runs them in lanes.

use swarmwright_lanes::Lanes;

use super::Team;
use crate::kinds::LaneKind;

impl LaneKind for Team {
    #[inline(always)]
    fn lane_weights(&self) -> usize {
        0
    }

    #[inline(always)]
    fn lane_state_length(&self) -> usize {
        0
    }

    #[inline(always)]
    fn lane_scratch_length(&self) -> usize {
        0
    }

    /// Not called: a team has no lanes.
    #[inline(always)]
    fn step_in_lanes<L: Lanes, const S: usize, const B: usize>(
        &self,
        _: (&[L], &[&[f32]]),
        _: &mut [L],
        _: &mut [L],
        _: [L; S],
        _: (L::Int, [u32; B]),
        _: &mut [L],
    ) {
    }
    /// Not called either.
    #[inline(always)]
    fn step_slice_in_lanes<L: Lanes>(
        &self,
        _: (&[L], &[&[f32]]),
        _: &mut [L],
        _: &mut [L],
        _: &[L],
        _: &mut [L],
    ) {
    }
}
