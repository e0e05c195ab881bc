//! Philox 4x64-10.

use swarmwright_lanes::{Kernel, Lanes, Level};

const MULTIPLIERS: [u64; 2] = [0xD2E7_470E_E14C_6C93, 0xCA5A_8263_9512_1157];
const WEYL: [u64; 2] = [0x9E37_79B9_7F4A_7C15, 0xBB67_AE85_84CA_A73B];
const ROUNDS: usize = 10;

/// The four random words of a counter under a key.
///
/// Salmon et al., "Parallel random numbers: as easy as 1, 2, 3", SC 2011.
#[must_use]
pub fn philox(counter: [u64; 4], key: [u64; 2]) -> [u64; 4] {
    words(counter, key)
}

/// See [`philox`]. Called and not inlined, it would take almost twice the time.
#[inline(always)]
pub(crate) fn words(counter: [u64; 4], key: [u64; 2]) -> [u64; 4] {
    let (mut counter, mut key) = (counter, key);
    for _ in 0..ROUNDS {
        let (low, high) = halves(counter[0], MULTIPLIERS[0]);
        let (other_low, other_high) = halves(counter[2], MULTIPLIERS[1]);
        counter = [
            other_high ^ counter[1] ^ key[0],
            other_low,
            high ^ counter[3] ^ key[1],
            low,
        ];
        key = [key[0].wrapping_add(WEYL[0]), key[1].wrapping_add(WEYL[1])];
    }
    counter
}

/// Blocks that are computed side by side: two vectors of 512 bits for each word, as one operation waits for the other.
pub(crate) const SIDE: usize = 16;
/// Fewer blocks than these take less time one by one.
const FEW: usize = 5;
const LOWER: u64 = u32::MAX as u64;

/// Whether [`side_by_side`] is faster than [`words`] on these lanes: it has some fifteen operations for a product of 64 bits, which is
/// too many for fewer lanes than eight.
#[inline(always)]
pub(crate) fn are_wide<L: Lanes>() -> bool {
    L::WIDTH >= Level::Avx512.width()
}

/// The words of blocks whose counters differ in the first number alone: it grows by 1 from each to the next.
pub(crate) fn blocks(first: [u64; 4], key: [u64; 2], blocks: &mut [[u64; 4]]) {
    Level::best().run(Blocks { first, key, blocks });
}

struct Blocks<'a> {
    first: [u64; 4],
    key: [u64; 2],
    blocks: &'a mut [[u64; 4]],
}

impl Kernel for Blocks<'_> {
    type Output = ();

    #[inline(always)]
    fn run<L: Lanes>(self) {
        let Self { first, key, blocks } = self;
        let [mut next, second, third, fourth] = first;
        for part in blocks.chunks_mut(SIDE) {
            if are_wide::<L>() && part.len() >= FEW {
                let mut counters = [next; SIDE];
                for (lane, counter) in counters.iter_mut().enumerate() {
                    *counter = counter.wrapping_add(lane as u64);
                }
                let rest = [second, third, fourth].map(|counter| [counter; SIDE]);
                let words = side_by_side(counters, rest, key);
                for (lane, block) in part.iter_mut().enumerate() {
                    *block = [
                        words[0][lane],
                        words[1][lane],
                        words[2][lane],
                        words[3][lane],
                    ];
                }
                next = next.wrapping_add(SIDE as u64);
            } else {
                for block in part {
                    *block = words([next, second, third, fourth], key);
                    next = next.wrapping_add(1);
                }
            }
        }
    }
}

/// The words of as many blocks, all first ones, all second ones, ...
#[inline(always)]
pub(crate) fn side_by_side(
    mut first: [u64; SIDE],
    [mut second, mut third, mut fourth]: [[u64; SIDE]; 3],
    mut key: [u64; 2],
) -> [[u64; SIDE]; 4] {
    for _ in 0..ROUNDS {
        for lane in 0..SIDE {
            let (low, high) = halves_of_32(first[lane], MULTIPLIERS[0]);
            let (other_low, other_high) = halves_of_32(third[lane], MULTIPLIERS[1]);
            first[lane] = other_high ^ second[lane] ^ key[0];
            second[lane] = other_low;
            third[lane] = high ^ fourth[lane] ^ key[1];
            fourth[lane] = low;
        }
        key = [key[0].wrapping_add(WEYL[0]), key[1].wrapping_add(WEYL[1])];
    }
    [first, second, third, fourth]
}

/// As [`halves`], of products of 32 bits, which vectors have.
#[inline(always)]
fn halves_of_32(left: u64, right: u64) -> (u64, u64) {
    let (left_low, left_high) = (left & LOWER, left >> 32);
    let (right_low, right_high) = (right & LOWER, right >> 32);
    let low = left_low * right_low;
    let middle = left_high * right_low + (low >> 32);
    let rest = left_low * right_high + (middle & LOWER);
    let high = left_high * right_high + (middle >> 32) + (rest >> 32);
    (rest << 32 | low & LOWER, high)
}

/// Lower and upper half of a product.
#[expect(
    clippy::cast_possible_truncation,
    reason = "the lower half is what is meant"
)]
#[inline(always)]
fn halves(left: u64, right: u64) -> (u64, u64) {
    let product = u128::from(left) * u128::from(right);
    (product as u64, (product >> 64) as u64)
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn blocks_are_the_same_one_by_one_and_side_by_side(
            first in any::<[u64; 4]>(), key in any::<[u64; 2]>(), count in 0usize..40,
        ) {
            let expected: Vec<[u64; 4]> = (0..count as u64)
                .map(|block| words([first[0].wrapping_add(block), first[1], first[2], first[3]], key))
                .collect();
            for level in Level::available() {
                let mut found = vec![[0; 4]; count];
                level.run(Blocks { first, key, blocks: &mut found });
                prop_assert_eq!(&found, &expected, "{}", level.name());
            }
        }
    }
}
