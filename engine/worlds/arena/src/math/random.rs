//! Random numbers of a tick, addressed by what they are for: nothing depends on what was drawn before.
//!
//! The generator is pcg4d (Jarzynski and Olano, "Hash Functions for GPU Rendering", JCGT 2020): four 32-bit words become
//! four random ones. The words are the key of the episode (two, from its seed by SplitMix64), the tick and the purpose, and
//! the robot.

use swarmwright_lanes::{Int, Lanes, Number, number};
use swarmwright_simulation::counter::splitmix;

/// What the numbers of a robot are for. Each purpose has four 32-bit words.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Purpose {
    /// Noise of both wheels of four robots, a word each.
    Wheels,
    /// Noise of eight proximity readings, 0 to 15 for the first, second, .. eight.
    Proximity(u32),
    /// Noise of eight light readings, in the same way.
    Light(u32),
    /// Noise of the ground readings (three halves), what EvoStick reads on grey (three halves), and the number that
    /// controllers get (a word).
    Ground,
    /// Noise of up to eight ground readings, for those that have more than three.
    Floor,
    /// Noise of the encoders.
    Encoders,
    /// Noise of the compass.
    Compass,
    /// Noise of the battery's reading.
    Battery,
}

impl Purpose {
    /// Below 64: at most 128 readings of each kind.
    const fn code(self) -> u32 {
        match self {
            Self::Wheels => 0,
            Self::Ground => 1,
            Self::Floor => 2,
            Self::Encoders => 4,
            Self::Compass => 5,
            Self::Battery => 6,
            Self::Proximity(block) => 16 + block,
            Self::Light(block) => 32 + block,
        }
    }
}

/// Most ticks of an episode, so that a tick and a block of links fit into 32 bits.
pub(crate) const MOST_TICKS: u32 = 1 << 18;
/// Links whose numbers come from one draw.
pub(crate) const LINKS: usize = 8;

/// The keys of the episodes in the lanes.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Keys<L: Lanes>([L::Int; 2]);

/// A step of a linear congruential generator.
const fn step(word: i32) -> i32 {
    word.wrapping_mul(1_664_525).wrapping_add(1_013_904_223)
}

/// The two words of an episode.
pub(crate) fn key(seed: u64) -> [i32; 2] {
    let bits = splitmix(splitmix(seed) ^ 0x0061_7265_6e61);
    [bits as i32, (bits >> 32) as i32]
}

impl<L: Lanes> Keys<L> {
    /// One key for each lane.
    #[inline(always)]
    pub(crate) fn new(mut of_lane: impl FnMut(usize) -> [i32; 2]) -> Self {
        let mut words = [[0; swarmwright_lanes::MOST_LANES]; 2];
        let [first, second] = &mut words;
        for (lane, (first, second)) in first.iter_mut().zip(second).enumerate().take(L::WIDTH) {
            let [a, b] = of_lane(lane);
            [*first, *second] = [step(a), step(b)];
        }
        Self([L::Int::load(&words[0]), L::Int::load(&words[1])])
    }

    /// Four random words for a robot in a tick.
    #[inline(always)]
    pub(crate) fn draw(self, tick: u32, robot: usize, purpose: Purpose) -> [L::Int; 4] {
        self.hash(tick, robot as u32 * 64 + purpose.code())
    }

    /// Numbers for the links to a robot from eight others, of which `block` says which.
    #[inline(always)]
    pub(crate) fn links(self, tick: u32, robot: usize, block: usize) -> [L::Int; 4] {
        self.hash(tick | (1 + block as u32) << 18, robot as u32)
    }

    /// Numbers for what a robot's camera sees of eight things, of which `block` says which.
    #[inline(always)]
    pub(crate) fn seen(self, tick: u32, robot: usize, block: usize) -> [L::Int; 4] {
        self.hash(tick | (1 + block as u32) << 18, robot as u32 | 1 << 31)
    }

    #[inline(always)]
    fn hash(self, z: u32, w: u32) -> [L::Int; 4] {
        // The step of the generator is done for the key in advance; one number for all lanes needs no vector.
        let [mut x, mut y] = self.0;
        let mut z = L::Int::splat(step(z as i32));
        let mut w = L::Int::splat(step(w as i32));
        for round in 0..2 {
            x = x.add(y.mul(w));
            y = y.add(z.mul(x));
            z = z.add(x.mul(y));
            w = w.add(y.mul(z));
            if round == 0 {
                let half = L::Int::splat(16);
                x = x.xor(x.shr(half));
                y = y.xor(y.shr(half));
                z = z.xor(z.shr(half));
                w = w.xor(w.shr(half));
            }
        }
        [x, y, z, w]
    }
}

/// An odd multiple of 2^-17 in 0..1 from 16 bits.
#[inline(always)]
fn unit<L: Lanes>(half: L::Int) -> Number<L> {
    Number(L::from_int(half)) * (1.0 / 65536.0) + 0.5 / 65536.0
}

/// Two numbers in 0..1, odd multiples of 2^-17, from the halves of a word.
#[inline(always)]
pub(crate) fn halves<L: Lanes>(word: L::Int) -> [Number<L>; 2] {
    [
        unit(word.and(L::Int::splat(0xFFFF))),
        unit(word.shr(L::Int::splat(16))),
    ]
}

/// A number in 0..1, a multiple of 2^-24.
#[inline(always)]
pub(crate) fn uniform<L: Lanes>(word: L::Int) -> Number<L> {
    Number(L::from_int(word.shr(L::Int::splat(8)))) * (1.0 / 16_777_216.0)
}

/// Uniform noise in -extent..extent from a number in 0..1.
#[inline(always)]
pub(crate) fn noise<L: Lanes>(unit: Number<L>, extent: f32) -> Number<L> {
    (unit + unit - number(1.0)) * extent
}
