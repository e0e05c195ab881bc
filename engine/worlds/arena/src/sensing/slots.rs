//! Slots in which each lane collects its own things. The work is then proportional to the number of things in the
//! fullest lane instead of the number in all lanes.

use swarmwright_lanes::{Lanes, Mask, Number, number};

/// `K` slots for things of `N` numbers.
pub struct Slots<L: Lanes, const N: usize, const K: usize> {
    things: [[Number<L>; N]; K],
    /// Lanes with an empty slot, by slot; a lane fills its slots in order.
    empty: [L::Mask; K],
    /// Number of slots that any lane has filled; the content of the others is undefined.
    used: usize,
    /// Content of a slot in lanes where it is empty.
    nothing: [f32; N],
}

impl<L: Lanes, const N: usize, const K: usize> Slots<L, N, K> {
    /// Creates empty slots; `nothing` is the content of empty lanes.
    #[inline(always)]
    pub fn new(nothing: [f32; N]) -> Self {
        Self {
            things: [[number(0.0); N]; K],
            empty: [L::Mask::from_bits(0); K],
            used: 0,
            nothing,
        }
    }

    /// Puts a thing into the first empty slot of each of these lanes, and returns the lanes that have no empty slot.
    #[inline(always)]
    pub fn put(&mut self, item: [Number<L>; N], mut lanes: L::Mask) -> L::Mask {
        let mut slot = 0;
        while slot < self.used {
            let fits = lanes.and(self.empty[slot]);
            if fits.any() {
                let old = &mut self.things[slot];
                for index in 0..N {
                    old[index] = item[index].select(old[index], fits);
                }
                self.empty[slot] = self.empty[slot].and_not(fits);
                lanes = lanes.and_not(fits);
                if !lanes.any() {
                    return lanes;
                }
            }
            slot += 1;
        }
        if slot == K {
            return lanes;
        }
        let new = &mut self.things[slot];
        for index in 0..N {
            new[index] = item[index].select(number(self.nothing[index]), lanes);
        }
        self.empty[slot] = L::Mask::from_bits(u64::MAX).and_not(lanes);
        self.used = slot + 1;
        L::Mask::from_bits(0)
    }

    /// Empties all slots.
    #[inline(always)]
    pub fn clear(&mut self) {
        self.used = 0;
    }

    /// Returns the number of slots that any lane has filled.
    #[inline(always)]
    pub fn used(&self) -> usize {
        self.used
    }

    /// Returns the content of a slot, and the lanes in which it is empty.
    #[inline(always)]
    pub fn get(&self, slot: usize) -> ([Number<L>; N], L::Mask) {
        (self.things[slot], self.empty[slot])
    }
}
