//! Objects that robots hold.

use swarmwright_lanes::{Lanes, Mask, Number, number};

use super::Objects;
use super::gap::gap;
use super::touch::NEAR;

impl<L: Lanes> Objects<L> {
    /// A robot holds what it held, as far as that is still near, or else the nearest object within reach, in the lanes in
    /// which that is wanted; in others it lets go. `at`: where its middle is; its radius, and how far it reaches from that.
    #[inline(always)]
    pub(in super::super) fn grip(
        &mut self,
        robot: usize,
        (at, radius, reach): ([Number<L>; 2], f32, f32),
        wanted: L::Mask,
    ) {
        let count = self.things.len();
        if self.held.is_empty() {
            return;
        }
        let Self {
            things,
            moving,
            held,
            ..
        } = self;
        let held = &mut held[robot * count..][..count];
        let mut holds = L::Mask::from_bits(0);
        for object in 0..count {
            if held[object].any() {
                let gap = gap(&things[object], &moving[object], at, radius);
                held[object] = held[object].and(wanted).and(gap.lt(number(NEAR)));
                holds = holds.or(held[object]);
            }
        }
        let free = wanted.and_not(holds);
        if !free.any() {
            return;
        }
        let (mut nearest, mut which) = (number(reach), number(-1.0));
        for object in 0..count {
            let gap = gap(&things[object], &moving[object], at, radius);
            let nearer = gap.lt(nearest).and(free);
            nearest = gap.select(nearest, nearer);
            which = number::<L>(object as f32).select(which, nearer);
        }
        for object in 0..count {
            let this = number::<L>(object as f32);
            let same = which.le(this).and(this.le(which));
            held[object] = held[object].or(same.and(free));
        }
    }

    /// In which lanes a robot holds something.
    #[inline(always)]
    pub(in super::super) fn held_by(&self, robot: usize) -> L::Mask {
        let count = self.things.len();
        let mut holds = L::Mask::from_bits(0);
        if !self.held.is_empty() {
            for object in 0..count {
                holds = holds.or(self.held[robot * count + object]);
            }
        }
        holds
    }

    /// In which lanes robots hold an object.
    #[inline(always)]
    pub(in super::super) fn is_held(&self, object: usize) -> L::Mask {
        let mut holds = L::Mask::from_bits(0);
        let mut at = object;
        while at < self.held.len() {
            holds = holds.or(self.held[at]);
            at += self.things.len();
        }
        holds
    }
}
