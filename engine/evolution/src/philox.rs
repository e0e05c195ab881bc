//! Philox 4x64-10.

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

/// Lower and upper half of a product.
#[expect(
    clippy::cast_possible_truncation,
    reason = "the lower half is what is meant"
)]
#[inline(always)]
fn halves(one: u64, other: u64) -> (u64, u64) {
    let product = u128::from(one) * u128::from(other);
    (product as u64, (product >> 64) as u64)
}
