//! Random numbers that depend on nothing but a seed and a place: removing one disturbance of a schedule leaves the
//! numbers of all others as they were.

/// The finalizer of SplitMix64 (Steele, Lea, Flood: Fast splittable pseudorandom number generators, OOPSLA 2014).
fn scramble(mut z: u64) -> u64 {
    z = (z ^ (z >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
    z = (z ^ (z >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
    z ^ (z >> 31)
}

/// One number for several.
#[must_use]
pub fn mix(numbers: &[u64]) -> u64 {
    numbers
        .iter()
        .fold(0x9E37_79B9_7F4A_7C15, |state, &number| {
            scramble(state.wrapping_add(scramble(number.wrapping_add(0x9E37_79B9_7F4A_7C15))))
        })
}

/// A stream of random numbers: SplitMix64.
pub struct Random(u64);

impl Random {
    /// The stream of a seed.
    #[must_use]
    pub fn new(seed: u64) -> Self {
        Self(mix(&[seed]))
    }

    /// The next 64 bits.
    pub fn bits(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9E37_79B9_7F4A_7C15);
        scramble(self.0)
    }

    /// A number of `0..limit`; 0 for a limit of 0.
    pub fn below(&mut self, limit: u64) -> u64 {
        self.bits().checked_rem(limit).unwrap_or(0)
    }

    /// A number of `low..=high`.
    pub fn between(&mut self, low: u64, high: u64) -> u64 {
        low + self.below(high - low + 1)
    }

    /// An index of `0..limit`.
    pub fn index(&mut self, limit: usize) -> usize {
        usize::try_from(self.below(limit as u64)).unwrap_or(0)
    }

    /// True in `percent` of 100 cases.
    pub fn chance(&mut self, percent: u64) -> bool {
        self.below(100) < percent
    }

    /// A number of `low..high` of which every order of magnitude is as likely.
    pub fn magnitude(&mut self, low: u64, high: u64) -> u64 {
        #[expect(clippy::cast_precision_loss, reason = "any number nearby will do")]
        let (low, high) = (low.max(1) as f64, high.max(2) as f64);
        #[expect(
            clippy::cast_precision_loss,
            reason = "53 of 64 random bits are enough"
        )]
        let share = (self.bits() >> 11) as f64 / (1u64 << 53) as f64;
        #[expect(
            clippy::cast_possible_truncation,
            clippy::cast_sign_loss,
            reason = "between two integers"
        )]
        let number = (low * (high / low).powf(share)) as u64;
        number
    }
}
