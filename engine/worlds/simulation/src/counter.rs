//! Random numbers that depend on a counter alone, never on what was drawn before.

/// SplitMix64 (Steele, Lea and Flood 2014): the output for the state `x`.
#[must_use]
pub fn splitmix(x: u64) -> u64 {
    let z = x.wrapping_add(0x9E37_79B9_7F4A_7C15);
    let z = (z ^ (z >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
    let z = (z ^ (z >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
    z ^ (z >> 31)
}

/// A binary32 in 0..1, a multiple of 2^-24: the upper 24 bits of
/// splitmix(splitmix(splitmix(seed) ^ stream) ^ index).
#[must_use]
pub fn uniform(seed: u64, stream: u64, index: u64) -> f32 {
    let bits = splitmix(splitmix(splitmix(seed) ^ stream) ^ index);
    // 24 bits and the power of two are exact in binary32.
    (bits >> 40) as f32 / 16_777_216.0
}
