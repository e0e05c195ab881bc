//! Random numbers of a tick, addressed by their purpose: no number depends on earlier draws.
//!
//! The generator is pcg4d (Jarzynski and Olano, "Hash Functions for GPU Rendering", JCGT 2020), which maps four 32-bit
//! words to four random words. The input words are the key of the episode (two words, from its seed by SplitMix64), the
//! tick, and the robot with the purpose.

use swarmwright_lanes::{Int, Lanes, Number, number};
use swarmwright_simulation::counter::splitmix;

/// The use of a robot's random numbers. Each purpose has four 32-bit words.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Purpose {
    /// Noise of both wheels of four robots, one word per robot.
    Wheels,
    /// Noise of eight proximity readings; block 0 to 15 has the first eight, the next eight, and so on.
    Proximity(u32),
    /// Noise of eight light readings, in the same blocks.
    Light(u32),
    /// Noise of the ground readings (three halves of words), EvoStick's readings on grey floor (three halves), and the
    /// random number given to controllers (one word).
    Ground,
    /// Noise of up to eight ground readings, for robots with more than three.
    Floor,
    /// Noise of the encoders.
    Encoders,
    /// Noise of the compass.
    Compass,
    /// Noise of the battery's reading.
    Battery,
}

impl Purpose {
    /// Returns the code of the purpose, below 64, which allows at most 128 readings of each kind.
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

/// Maximum number of ticks in an episode, so that a tick and a block of links fit into 32 bits.
pub const MOST_TICKS: u32 = 1 << 18;
/// Number of links that share one draw.
pub const LINKS: usize = 8;

/// Keys of the episodes in the lanes.
#[derive(Debug, Clone, Copy)]
pub struct Keys<L: Lanes>([L::Int; 2]);

/// Computes one step of a linear congruential generator.
#[inline]
const fn step(word: i32) -> i32 {
    word.wrapping_mul(1_664_525).wrapping_add(1_013_904_223)
}

/// Returns the key of an episode.
#[inline]
pub fn key(seed: u64) -> [i32; 2] {
    let bits = splitmix(splitmix(seed) ^ 0x0061_7265_6e61);
    [bits as i32, (bits >> 32) as i32]
}

impl<L: Lanes> Keys<L> {
    /// Creates the keys; `of_lane` returns the key of each lane.
    #[inline(always)]
    pub fn new(mut of_lane: impl FnMut(usize) -> [i32; 2]) -> Self {
        let mut words = [[0; swarmwright_lanes::MOST_LANES]; 2];
        let [first, second] = &mut words;
        for (lane, (first, second)) in first.iter_mut().zip(second).enumerate().take(L::WIDTH) {
            let [a, b] = of_lane(lane);
            [*first, *second] = [step(a), step(b)];
        }
        Self([L::Int::load(&words[0]), L::Int::load(&words[1])])
    }

    /// Draws four random words for a robot in a tick.
    #[inline(always)]
    pub fn draw(self, tick: u32, robot: usize, purpose: Purpose) -> [L::Int; 4] {
        self.hash(tick, robot as u32 * 64 + purpose.code())
    }

    /// Draws random words for the links to a robot from the eight other robots of a block.
    #[inline(always)]
    pub fn links(self, tick: u32, robot: usize, block: usize) -> [L::Int; 4] {
        self.hash(tick | (1 + block as u32) << 18, robot as u32)
    }

    /// Draws random words for eight things that a robot's camera may see, those of a block.
    #[inline(always)]
    pub fn seen(self, tick: u32, robot: usize, block: usize) -> [L::Int; 4] {
        self.hash(tick | (1 + block as u32) << 18, robot as u32 | 1 << 31)
    }

    #[inline(always)]
    fn hash(self, z: u32, w: u32) -> [L::Int; 4] {
        // The key's step of the generator was done in advance; the other words are the same in all lanes and step as
        // scalars.
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

/// Returns a number in 0..1, an odd multiple of 2^-17, from 16 bits.
#[inline(always)]
fn unit<L: Lanes>(half: L::Int) -> Number<L> {
    Number(L::from_int(half)) * (1.0 / 65536.0) + 0.5 / 65536.0
}

/// Returns two numbers in 0..1, odd multiples of 2^-17, from the halves of a word.
#[inline(always)]
pub fn halves<L: Lanes>(word: L::Int) -> [Number<L>; 2] {
    [
        unit(word.and(L::Int::splat(0xFFFF))),
        unit(word.shr(L::Int::splat(16))),
    ]
}

/// Returns a number in 0..1, a multiple of 2^-24.
#[inline(always)]
pub fn uniform<L: Lanes>(word: L::Int) -> Number<L> {
    Number(L::from_int(word.shr(L::Int::splat(8)))) * (1.0 / 16_777_216.0)
}

/// Returns uniform noise in -extent..extent from a number in 0..1.
#[inline(always)]
pub fn noise<L: Lanes>(unit: Number<L>, extent: f32) -> Number<L> {
    (unit + unit - number(1.0)) * extent
}
