//! Random numbers of a step, all of them made from one sensor.
//!
//! Its 24 bits are hashed to four words of 32 bits by pcg4d (M. Jarzynski and M. Olano, "Hash functions for GPU rendering",
//! Journal of Computer Graphics Techniques 9(3), 2020).

use swarmwright_lanes::{Int, Lanes};

/// Distance of two neighbouring numbers of 24 bits in 0..1.
pub(super) const UNIT: f32 = 1.0 / 16_777_216.0;
const MULTIPLIER: u32 = 1_664_525;
const INCREMENT: u32 = 1_013_904_223;
/// What stands beside the 24 bits.
const BESIDE: [u32; 3] = [1, 2, 3];

/// Random numbers of one step.
#[derive(Debug, Clone, Copy)]
pub(super) struct Random<T>([T; 4]);

impl Random<u32> {
    /// From a number in 0..1; others count as its ends.
    #[inline]
    pub(super) fn new(sensor: f32) -> Self {
        let low = if sensor < 0.0 { 0.0 } else { sensor };
        let within = if low > 1.0 - UNIT { 1.0 - UNIT } else { low };
        Self(hashed((within * 16_777_216.0) as u32))
    }

    /// A multiple of 2^-24, for the transition with this number.
    #[inline]
    pub(super) fn unit(&self, transition: usize) -> f32 {
        (self.0[transition] >> 8) as f32 * UNIT
    }

    /// A number below `count`, which is at most 2^16, for how long a robot turns.
    #[inline]
    pub(super) fn turn(&self, count: u32) -> u32 {
        below(self.0[0], self.0[1], count)
    }

    /// The same, for which transition is made.
    #[inline]
    pub(super) fn choice(&self, count: u32) -> u32 {
        below(self.0[2], self.0[3], count)
    }
}

/// Sixteen bits that `unit` does not look at, as a number below `count`.
#[inline]
fn below(low: u32, high: u32, count: u32) -> u32 {
    ((low & 255 | (high & 255) << 8) * count) >> 16
}

#[inline]
fn hashed(bits: u32) -> [u32; 4] {
    let start = |v: u32| v.wrapping_mul(MULTIPLIER).wrapping_add(INCREMENT);
    let mut v = [bits, BESIDE[0], BESIDE[1], BESIDE[2]].map(start);
    mix(&mut v);
    for word in &mut v {
        *word ^= *word >> 16;
    }
    mix(&mut v);
    v
}

#[inline]
fn mix(v: &mut [u32; 4]) {
    v[0] = v[0].wrapping_add(v[1].wrapping_mul(v[3]));
    v[1] = v[1].wrapping_add(v[2].wrapping_mul(v[0]));
    v[2] = v[2].wrapping_add(v[0].wrapping_mul(v[1]));
    v[3] = v[3].wrapping_add(v[1].wrapping_mul(v[2]));
}

/// The same in lanes.
#[derive(Clone, Copy)]
pub(super) struct LaneRandom<L: Lanes>([L::Int; 4]);

impl<L: Lanes> LaneRandom<L> {
    #[inline(always)]
    pub(super) fn new(sensor: L) -> Self {
        let within = sensor.at_least(L::splat(0.0)).at_most(L::splat(1.0 - UNIT));
        let bits = within.mul(L::splat(16_777_216.0)).floor();
        let start =
            |v: u32| L::Int::splat(v.wrapping_mul(MULTIPLIER).wrapping_add(INCREMENT) as i32);
        let mut v = [
            bits.mul(L::Int::splat(MULTIPLIER as i32))
                .add(L::Int::splat(INCREMENT as i32)),
            start(BESIDE[0]),
            start(BESIDE[1]),
            start(BESIDE[2]),
        ];
        Self::mix(&mut v);
        for word in &mut v {
            *word = word.xor(word.shr(L::Int::splat(16)));
        }
        Self::mix(&mut v);
        Self(v)
    }

    #[inline(always)]
    fn mix(v: &mut [L::Int; 4]) {
        v[0] = v[0].add(v[1].mul(v[3]));
        v[1] = v[1].add(v[2].mul(v[0]));
        v[2] = v[2].add(v[0].mul(v[1]));
        v[3] = v[3].add(v[1].mul(v[2]));
    }

    #[inline(always)]
    pub(super) fn unit(&self, transition: usize) -> L {
        L::from_int(self.0[transition].shr(L::Int::splat(8))).mul(L::splat(UNIT))
    }

    #[inline(always)]
    pub(super) fn turn(&self, count: L::Int) -> L::Int {
        Self::below(self.0[0], self.0[1], count)
    }

    #[inline(always)]
    pub(super) fn choice(&self, count: L::Int) -> L::Int {
        Self::below(self.0[2], self.0[3], count)
    }

    #[inline(always)]
    fn below(low: L::Int, high: L::Int, count: L::Int) -> L::Int {
        let byte = L::Int::splat(255);
        let high = high.and(byte).shl(L::Int::splat(8));
        low.and(byte).or(high).mul(count).shr(L::Int::splat(16))
    }
}
