//! Objects that robots hold.

use swarmwright_lanes::{Lanes, Mask, Number, number};

use super::super::bodies::Objects;
use super::gap::gap;
use super::objects::NEAR;

impl<L: Lanes> Objects<L> {
    /// Updates which object a robot holds, in the lanes in `grips`; in the others, the robot lets go.
    ///
    /// A robot keeps its object while that is near; otherwise it takes the nearest object within reach. The tuple holds
    /// the position of its middle, its radius, and its reach from the rim.
    #[inline(always)]
    pub fn grip(
        &mut self,
        robot: usize,
        (at, radius, reach): ([Number<L>; 2], f32, f32),
        grips: L::Mask,
    ) {
        let count = self.things.len();
        if self.held.is_empty() {
            return;
        }
        let Self {
            things: items,
            moving,
            held,
            ..
        } = self;
        let held = &mut held[robot * count..][..count];
        let mut holds = L::Mask::from_bits(0);
        for object in 0..count {
            if held[object].any() {
                let gap = gap(&items[object], &moving[object], at, radius);
                held[object] = held[object].and(grips).and(gap.lt(number(NEAR)));
                holds = holds.or(held[object]);
            }
        }
        let free = grips.and_not(holds);
        if !free.any() {
            return;
        }
        let (mut nearest, mut chosen) = (number(reach), number(-1.0));
        for object in 0..count {
            let gap = gap(&items[object], &moving[object], at, radius);
            let nearer = gap.lt(nearest).and(free);
            nearest = gap.select(nearest, nearer);
            chosen = number::<L>(object as f32).select(chosen, nearer);
        }
        for object in 0..count {
            let this = number::<L>(object as f32);
            let same = chosen.le(this).and(this.le(chosen));
            held[object] = held[object].or(same.and(free));
        }
    }
}
