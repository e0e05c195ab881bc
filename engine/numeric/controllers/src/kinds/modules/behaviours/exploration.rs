//! Straight ahead; an obstacle in front makes the robot turn on the spot for a random time.

use swarmwright_lanes::{Lanes, Mask};

use super::{Behaviour, Module};
use crate::kinds::modules::lanes::length;
use crate::kinds::modules::random::{LaneRandom, Random};
use crate::kinds::modules::{NEAR, STATE_LIMITS, Sensed, limited};

pub(super) const MODULE: Module = Module {
    name: "exploration",
    behaviour: Behaviour::Explore,
};

/// The speeds of both wheels. `turn`: how many more steps the robot turns, to the left above 0, to the right below.
pub(super) fn act(row: &[f32], sensed: &Sensed, turn: &mut f32, random: &Random<u32>) -> [f32; 2] {
    if *turn > 0.0 {
        *turn -= 1.0;
        return [-1.0, 1.0];
    }
    if *turn < 0.0 {
        *turn += 1.0;
        return [1.0, -1.0];
    }
    if sensed.obstacle_ahead() {
        // Not at all is as long as once.
        let steps = random.turn(limited(row[1], STATE_LIMITS[1]) as u32).max(1) as f32;
        *turn = if sensed.proximity[1] < 0.0 {
            steps
        } else {
            -steps
        };
    }
    [1.0, 1.0]
}

/// The same for the lanes that explore. `most`: for how long a robot turns at most.
#[inline(always)]
pub(super) fn act_in_lanes<L: Lanes>(
    explores: L::Mask,
    most: L,
    turn: &mut L,
    proximity: [L; 2],
    random: LaneRandom<L>,
) -> [L; 2] {
    #[expect(clippy::disallowed_names, reason = "the number 1")]
    let (zero, one) = (L::splat(0.0), L::splat(1.0));
    let (to_left, to_right) = (zero.lt(*turn), turn.lt(zero));
    let ahead = one.select(zero, explores);
    let left = one.neg().select(ahead, explores.and(to_left));
    let right = one.neg().select(ahead, explores.and(to_right));
    let close = L::splat(NEAR).le(length(proximity));
    let blocked = close.and(zero.le(proximity[0]));
    let begins = explores.and(blocked).and_not(to_left.or(to_right));
    if begins.any() {
        let steps = random.turn(most.floor());
        let steps = L::from_int(steps).at_least(one);
        let signed = steps.select(steps.neg(), proximity[1].lt(zero));
        *turn = signed.select(*turn, begins);
    }
    let turned = one.neg().select(one, to_right);
    let turned = turn.sub(turned);
    *turn = turned.select(*turn, explores.and(to_left.or(to_right)));
    [left, right]
}
