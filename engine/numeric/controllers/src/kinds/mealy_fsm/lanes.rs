//! Mealy machines in lanes.

use swarmwright_lanes::{Int, Lanes, MOST_LANES};

use super::MealyFsm;
use crate::kinds::LaneKind;

impl LaneKind for MealyFsm {
    #[inline(always)]
    fn step_slice_in_lanes<L: Lanes>(
        &self,
        (_, genomes): (&[L], &[&[f32]]),
        state: &mut [L],
        _scratch: &mut [L],
        sensors: &[L],
        actuators: &mut [L],
    ) {
        let state = &mut state[0];
        #[expect(clippy::disallowed_names, reason = "the number 1")]
        let (zero, one) = (L::Int::splat(0), L::Int::splat(1));
        let mut row = state.floor();
        for (sensor, thresholds) in sensors.iter().zip(&self.thresholds) {
            // A specification has at most a million weights, so no row comes near 2^31.
            row = row.mul(L::Int::splat(thresholds.len() as i32 + 1));
            for threshold in thresholds {
                row = row.add(one.select(zero, L::splat(*threshold).lt(*sensor)));
            }
        }
        let mut at = [0; MOST_LANES];
        row.mul(L::Int::splat(self.row_length() as i32))
            .store(&mut at);
        let mut column = [0.0; MOST_LANES];
        let mut gather = |offset: usize| {
            for lane in 0..L::WIDTH {
                column[lane] = genomes[lane][at[lane] as usize + offset];
            }
            L::load(&column)
        };
        for (index, actuator) in actuators.iter_mut().enumerate() {
            *actuator = gather(1 + index)
                .at_most(L::splat(1.0))
                .at_least(L::splat(-1.0));
        }
        let next = gather(0)
            .at_least(L::splat(0.0))
            .at_most(L::splat(self.last_state()));
        *state = L::from_int(next.floor());
    }
}
