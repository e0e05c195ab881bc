//! Places in which each lane collects things of its own, so that work is done for as many as the fullest lane has instead of
//! for all that any lane has.

use swarmwright_lanes::{Lanes, Mask, Number, number};

/// `K` places for things of `N` numbers.
pub(crate) struct Slots<L: Lanes, const N: usize, const K: usize> {
    things: [[Number<L>; N]; K],
    /// Lanes that have nothing in a place; a lane fills them in order.
    empty: [L::Mask; K],
    /// Places that any lane has filled; what is in the others means nothing.
    used: usize,
    /// What a place holds in lanes that have nothing in it.
    nothing: [f32; N],
}

impl<L: Lanes, const N: usize, const K: usize> Slots<L, N, K> {
    /// Empty places; in lanes that have nothing in a place it holds `nothing`.
    #[inline(always)]
    pub(crate) fn new(nothing: [f32; N]) -> Self {
        Self {
            things: [[number(0.0); N]; K],
            empty: [L::Mask::from_bits(0); K],
            used: 0,
            nothing,
        }
    }

    /// Puts a thing into the first empty place of each of these lanes; returns the lanes that have none left.
    #[inline(always)]
    pub(crate) fn put(&mut self, thing: [Number<L>; N], mut lanes: L::Mask) -> L::Mask {
        let mut place = 0;
        while place < self.used {
            let taken = lanes.and(self.empty[place]);
            if taken.any() {
                let old = &mut self.things[place];
                for index in 0..N {
                    old[index] = thing[index].select(old[index], taken);
                }
                self.empty[place] = self.empty[place].and_not(taken);
                lanes = lanes.and_not(taken);
                if !lanes.any() {
                    return lanes;
                }
            }
            place += 1;
        }
        if place == K {
            return lanes;
        }
        let new = &mut self.things[place];
        for index in 0..N {
            new[index] = thing[index].select(number(self.nothing[index]), lanes);
        }
        self.empty[place] = L::Mask::from_bits(u64::MAX).and_not(lanes);
        self.used = place + 1;
        L::Mask::from_bits(0)
    }

    /// Empties all places.
    #[inline(always)]
    pub(crate) fn clear(&mut self) {
        self.used = 0;
    }

    /// Places that any lane has filled.
    #[inline(always)]
    pub(crate) fn used(&self) -> usize {
        self.used
    }

    /// What is in a place, and in which lanes there is nothing.
    #[inline(always)]
    pub(crate) fn get(&self, place: usize) -> ([Number<L>; N], L::Mask) {
        (self.things[place], self.empty[place])
    }
}
