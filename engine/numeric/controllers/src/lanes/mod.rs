//! Inference in lanes: many controllers of one architecture at once, bit for bit as one at a time.
//!
//! The operations and their order are those of [`crate::Controller`]; lanes do not depend on each other.

pub(crate) mod nodes;
pub(crate) mod sums;
mod swarm;

use swarmwright_lanes::{Int, Lanes, Mask};

use crate::Architecture;
use crate::kinds::{LaneKind, of_kind};
pub use swarm::{LaneControllers, LaneGroup};

/// As many controllers as there are lanes, with their weights; the state of each agent is kept by the caller.
pub struct LaneController<'a, L> {
    architecture: &'a Architecture,
    /// One vector per weight; empty for a kind that looks weights up.
    weights: Vec<L>,
    /// The weights of each lane, for a kind that looks them up.
    genomes: Vec<&'a [f32]>,
    scratch: Vec<L>,
}

impl<'a, L: Lanes> LaneController<'a, L> {
    /// Controllers without weights; `load` gives them some.
    #[inline(always)]
    pub fn new(architecture: &'a Architecture) -> Self {
        let (weights, scratch) =
            of_kind!(architecture, kind => (kind.lane_weights(), kind.lane_scratch_length()));
        Self {
            architecture,
            weights: vec![L::splat(0.0); weights],
            genomes: Vec::new(),
            scratch: vec![L::splat(0.0); scratch],
        }
    }

    /// Gives each lane the weights of a genome; `genomes` holds one per lane, each as long as the weight count.
    #[inline(always)]
    pub fn load(&mut self, genomes: &[&'a [f32]]) {
        if self.weights.is_empty() {
            self.genomes.clear();
            self.genomes.extend_from_slice(genomes);
        } else {
            L::transpose(genomes, 0, &mut self.weights);
            let weights = &mut self.weights;
            of_kind!(self.architecture, kind => kind.prepare(weights));
        }
    }

    /// Vectors of state that one agent needs; all 0 at the start of an episode.
    #[inline(always)]
    pub fn state_length(&self) -> usize {
        of_kind!(self.architecture, kind => kind.lane_state_length())
    }

    /// One step of one agent with its state, as long as `state_length`.
    #[inline(always)]
    pub fn step<const S: usize>(&mut self, state: &mut [L], sensors: [L; S], actuators: &mut [L]) {
        self.step_with_bits(state, sensors, (L::Int::splat(0), []), actuators);
        for actuator in actuators {
            *actuator = limited(*actuator);
        }
    }

    /// The same for a number of sensors that is known only at run time, as the specification says it.
    #[inline(always)]
    pub fn step_slice(&mut self, state: &mut [L], sensors: &[L], actuators: &mut [L]) {
        debug_assert_eq!(sensors.len(), self.architecture.sensors());
        let (weights, scratch) = (self.weights.as_slice(), self.scratch.as_mut_slice());
        let weights = (weights, self.genomes.as_slice());
        L::apart(
            #[inline(always)]
            || {
                of_kind!(self.architecture, kind => kind.step_slice_in_lanes(weights, state, scratch, sensors, actuators));
                for actuator in actuators {
                    *actuator = limited(*actuator);
                }
            },
        );
    }

    /// As [`step`](Self::step), where the last sensors are 1 or 0: 1 where a bit of `bits` is not set; `order` says which bits, the
    /// lowest one being 0. That takes half the operations for them.
    ///
    /// Actuators are as the network gives them: not limited to -1..1, and NaN not replaced by 0. That is less work, and
    /// enough for a caller that only compares them with a number.
    #[inline(always)]
    pub fn step_with_bits<const S: usize, const B: usize>(
        &mut self,
        state: &mut [L],
        numbers: [L; S],
        bits: (L::Int, [u32; B]),
        actuators: &mut [L],
    ) {
        let (weights, scratch) = (self.weights.as_slice(), self.scratch.as_mut_slice());
        let weights = (weights, self.genomes.as_slice());
        of_kind!(self.architecture, kind => kind.step_in_lanes(weights, state, scratch, numbers, bits, actuators));
    }
}

/// The last operations of `OutputRange::actuator`.
#[inline(always)]
fn limited<L: Lanes>(a: L) -> L {
    let nan = a.is_nan();
    let a = if nan.any() {
        L::splat(0.0).select(a, nan)
    } else {
        a
    };
    a.at_most(L::splat(1.0)).at_least(L::splat(-1.0))
}
