//! The generator of java.util.Random, which FREVO's random fields are drawn with.

/// 48-bit linear congruential generator (documentation of java.util.Random; Knuth, The Art of Computer Programming,
/// volume 2, section 3.2.1).
#[derive(Debug, Clone)]
pub(super) struct JavaRandom {
    state: u64,
}

const MULTIPLIER: u64 = 0x5_DEEC_E66D;
const INCREMENT: u64 = 0xB;
const MASK: u64 = (1 << 48) - 1;

impl JavaRandom {
    /// `seed` is Java's long, as its 64 bits.
    pub(super) fn new(seed: u64) -> Self {
        Self {
            state: (seed ^ MULTIPLIER) & MASK,
        }
    }

    /// 31 random bits.
    fn next(&mut self) -> u32 {
        self.state = self.state.wrapping_mul(MULTIPLIER).wrapping_add(INCREMENT) & MASK;
        (self.state >> 17) as u32
    }

    /// Uniform in 0..bound, `bound` from 1 to 2^31 - 1.
    pub(super) fn below(&mut self, bound: u32) -> u32 {
        let bits = self.next();
        if bound.is_power_of_two() {
            // The upper bits are the better ones.
            return ((u64::from(bound) * u64::from(bits)) >> 31) as u32;
        }
        let mut bits = bits;
        loop {
            let value = bits % bound;
            // The last, incomplete run of `bound` numbers below 2^31 would favour small values.
            if bits - value + (bound - 1) < 1 << 31 {
                return value;
            }
            bits = self.next();
        }
    }
}

#[cfg(test)]
mod tests {
    use super::JavaRandom;

    fn draws(seed: i64, bound: u32) -> Vec<u32> {
        let mut random = JavaRandom::new(seed.cast_unsigned());
        (0..8).map(|_| random.below(bound)).collect()
    }

    #[test]
    fn draws_are_those_of_java() {
        // Any bound, a power of two, and one for which about half of all numbers are drawn again; from Java 17.
        for (seed, bound, expected) in [
            (0, 20, [0, 8, 9, 7, 15, 13, 11, 1]),
            (0, 16, [11, 13, 3, 9, 10, 4, 8, 1]),
            (-7, 20, [2, 17, 10, 7, 18, 7, 11, 16]),
            (1_234_567_890_123, 16, [15, 8, 12, 13, 12, 11, 12, 15]),
            (
                -7,
                (1 << 30) + 1,
                [
                    577_934_662,
                    314_447_087,
                    677_675_436,
                    184_135_245,
                    425_474_944,
                    988_357_177,
                    370_061_409,
                    272_470_848,
                ],
            ),
        ] {
            assert_eq!(draws(seed, bound), expected, "seed {seed}, bound {bound}");
        }
        assert_eq!(draws(3, 1), [0; 8]);
    }
}
