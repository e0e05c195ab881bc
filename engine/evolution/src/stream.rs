//! Streams of random numbers, each with an address of its own.

use rayon::prelude::*;
use sha2::{Digest, Sha256};
use swarmwright_lanes::{Kernel, Lanes, Level};

use crate::normal::{of_unit, of_units};
use crate::philox::{SIDE, are_wide, blocks, side_by_side, words};

const WORDS: usize = 4;
/// Numbers that are made in little more time than another thread takes to begin.
const FEW: usize = 1 << 14;
/// Numbers of rows that are computed together: they fit into the nearest cache.
const TOGETHER: usize = 2048;
/// 2^-53, the distance of two neighbouring units.
const UNIT: f64 = 1.0 / 9_007_199_254_740_992.0;

/// The 64-bit key of a purpose: the first eight bytes, little-endian, of its name's SHA-256.
#[must_use]
pub fn purpose_key(purpose: &str) -> u64 {
    let mut first = [0; 8];
    first.copy_from_slice(&Sha256::digest(purpose)[..8]);
    u64::from_le_bytes(first)
}

/// An endless sequence of random numbers.
///
/// Its words are those of Philox 4x64-10 with key = (seed, purpose) and counter = (block, candidate, generation, 0);
/// blocks are counted from 1.
#[derive(Debug, Clone)]
pub struct Stream {
    key: [u64; 2],
    candidate: u64,
    generation: u64,
    /// Blocks drawn.
    blocks: u64,
    block: [u64; WORDS],
    /// Words of the block that are used up.
    used: usize,
}

impl Stream {
    /// `purpose`: see [`purpose_key`].
    #[must_use]
    pub fn new(seed: u64, purpose: u64, generation: u64, candidate: u64) -> Self {
        Self {
            key: [seed, purpose],
            candidate,
            generation,
            blocks: 0,
            block: [0; WORDS],
            used: WORDS,
        }
    }

    /// The next 64 random bits.
    #[inline]
    pub fn word(&mut self) -> u64 {
        if self.used == WORDS {
            self.draw();
        }
        let word = self.block[self.used];
        self.used += 1;
        word
    }

    /// As many words as there are places.
    pub fn fill(&mut self, words: &mut [u64]) {
        let rest = (WORDS - self.used).min(words.len());
        let (head, body) = words.split_at_mut(rest);
        head.copy_from_slice(&self.block[self.used..self.used + rest]);
        self.used += rest;
        let (whole, rest) = body.as_chunks_mut::<WORDS>();
        let first = self.blocks.wrapping_add(1);
        blocks([first, self.candidate, self.generation, 0], self.key, whole);
        self.blocks = self.blocks.wrapping_add(whole.len() as u64);
        for place in rest {
            *place = self.word();
        }
    }

    /// Goes past words without drawing them.
    pub fn skip(&mut self, words: usize) {
        let rest = WORDS - self.used;
        if words <= rest {
            self.used += words;
            return;
        }
        let beyond = words - rest;
        self.blocks = self.blocks.wrapping_add((beyond / WORDS) as u64);
        self.used = WORDS;
        if !beyond.is_multiple_of(WORDS) {
            self.draw();
            self.used = beyond % WORDS;
        }
    }

    /// The next multiple of 2^-53, uniform in 0 .. 1 without 1.
    #[inline]
    pub fn unit(&mut self) -> f64 {
        unit(self.word())
    }

    /// A number uniform in -border .. border.
    #[inline]
    pub fn uniform(&mut self, border: f64) -> f64 {
        uniform(self.word(), border)
    }

    /// The next number of the standard normal distribution, |z| <= 8.3; see [`normal_at`](crate::normal_at).
    #[inline]
    pub fn normal(&mut self) -> f64 {
        of_unit(self.unit())
    }

    /// As many normal numbers as there are places; as [`normal`](Self::normal), and faster for many.
    pub fn normals(&mut self, numbers: &mut [f64]) {
        self.units(numbers);
        of_units(numbers);
    }

    /// As many units as there are places.
    pub fn units(&mut self, numbers: &mut [f64]) {
        let mut words = [0; 16 * WORDS];
        for part in numbers.chunks_mut(words.len()) {
            let words = &mut words[..part.len()];
            self.fill(words);
            for (number, word) in part.iter_mut().zip(words) {
                *number = unit(*word);
            }
        }
    }

    /// An integer, uniform in 0 .. below, without bias; words that would favour some are drawn in vain.
    ///
    /// 0 counts as 2^64.
    #[inline]
    pub fn integer(&mut self, below: u64) -> u64 {
        let mut drawn = [0];
        self.integers(below, &mut drawn);
        drawn[0]
    }

    /// As many integers as there are places, see [`Stream::integer`].
    #[inline]
    pub fn integers(&mut self, below: u64, integers: &mut [u64]) {
        if below == 0 {
            return self.fill(integers);
        }
        // 2^64 mod below: so many words at the upper end favour the small integers.
        let excess = below.wrapping_neg() % below;
        for place in integers {
            *place = loop {
                let word = self.word();
                if word <= u64::MAX - excess {
                    break word % below;
                }
            };
        }
    }

    #[inline]
    fn draw(&mut self) {
        self.blocks = self.blocks.wrapping_add(1);
        self.block = self.at(self.blocks);
        self.used = 0;
    }

    #[inline]
    fn at(&self, block: u64) -> [u64; WORDS] {
        words([block, self.candidate, self.generation, 0], self.key)
    }
}

/// Rows of `length` normal numbers, each from the stream of its own candidate: `first`, `first + 1`, ...
///
/// As [`Stream::normals`] for each, and faster, as short rows are computed together.
pub fn normal_rows(
    seed: u64,
    purpose: u64,
    generation: u64,
    first: u64,
    length: usize,
    numbers: &mut [f64],
) {
    let length = length.max(1);
    let together = (TOGETHER / length).max(1) * length;
    let mut candidate = first;
    for part in numbers.chunks_mut(together) {
        let rows = Rows {
            key: [seed, purpose],
            generation,
            first: candidate,
            length,
            numbers: &mut *part,
        };
        Level::best().run(rows);
        candidate = candidate.wrapping_add((together / length) as u64);
        of_units(part);
    }
}

/// Rows of units, each from the stream of its own candidate.
struct Rows<'a> {
    key: [u64; 2],
    generation: u64,
    first: u64,
    length: usize,
    numbers: &'a mut [f64],
}

impl Kernel for Rows<'_> {
    type Output = ();

    #[inline(always)]
    fn run<L: Lanes>(self) {
        let Self {
            key: [seed, purpose],
            generation,
            first,
            length,
            numbers,
        } = self;
        if !are_wide::<L>() {
            for (candidate, row) in numbers.chunks_mut(length).enumerate() {
                let candidate = first.wrapping_add(candidate as u64);
                Stream::new(seed, purpose, generation, candidate).units(row);
            }
            return;
        }
        // Blocks of several rows side by side: what is left of a row fills no vector.
        let (mut candidate, mut row, mut block) = (first, 0, 0);
        while row < numbers.len() {
            let (mut counters, mut candidates) = ([0; SIDE], [0; SIDE]);
            let mut places = [(0, 0); SIDE];
            for lane in 0..SIDE {
                let start = row + WORDS * block;
                let end = (start + WORDS).min(row + length).min(numbers.len());
                (counters[lane], candidates[lane]) = (1 + block as u64, candidate);
                places[lane] = (start.min(end), end);
                block += 1;
                if block * WORDS >= length {
                    (row, block) = (row + length, 0);
                    candidate = candidate.wrapping_add(1);
                }
            }
            let rest = [candidates, [generation; SIDE], [0; SIDE]];
            let words = side_by_side(counters, rest, [seed, purpose]);
            let mut units = [[0.0; WORDS]; SIDE];
            for (place, words) in words.iter().enumerate() {
                for lane in 0..SIDE {
                    units[lane][place] = unit(words[lane]);
                }
            }
            for (units, (start, end)) in units.iter().zip(places) {
                match numbers
                    .get_mut(start..start + WORDS)
                    .filter(|_| end - start == WORDS)
                {
                    Some(whole) => whole.copy_from_slice(units),
                    None => numbers[start..end].copy_from_slice(&units[..end - start]),
                }
            }
        }
    }
}

/// The upper 53 bits of a word as a multiple of 2^-53.
#[expect(clippy::cast_precision_loss, reason = "53 bits are exact")]
#[inline]
pub(crate) fn unit(word: u64) -> f64 {
    (word >> 11) as f64 * UNIT
}

/// A word as a number uniform in -border .. border.
#[inline]
pub(crate) fn uniform(word: u64, border: f64) -> f64 {
    (unit(word) * 2.0 - 1.0) * border
}

/// Makes a row of `length` numbers with each stream; many of them on all processors.
///
/// `make` takes the row's index, its stream and its place.
pub fn rows<T: Send>(
    streams: &mut [Stream],
    numbers: &mut [T],
    length: usize,
    make: impl Fn(usize, &mut Stream, &mut [T]) + Sync,
) {
    let mut none = vec![(); numbers.len()];
    let make = |(): &mut (), index, stream: &mut Stream, row: &mut [T], _: &mut [()]| {
        make(index, stream, row);
    };
    rows_of_two(streams, (numbers, &mut none), length, FEW, || (), make);
}

/// Makes two rows of `length` numbers with each stream; see [`rows`].
///
/// `few`: numbers that are made in little more time than another thread takes to begin. `room`: what `make` works in.
pub(crate) fn rows_of_two<T: Send, U: Send, R>(
    streams: &mut [Stream],
    (ones, others): (&mut [T], &mut [U]),
    length: usize,
    few: usize,
    room: impl Fn() -> R + Send + Sync,
    make: impl Fn(&mut R, usize, &mut Stream, &mut [T], &mut [U]) + Sync,
) {
    let length = length.max(1);
    if ones.len() < 2 * few {
        let mut room = room();
        let both = ones
            .chunks_exact_mut(length)
            .zip(others.chunks_exact_mut(length));
        for (index, (stream, (one, other))) in streams.iter_mut().zip(both).enumerate() {
            make(&mut room, index, stream, one, other);
        }
        return;
    }
    streams
        .par_iter_mut()
        .zip(ones.par_chunks_exact_mut(length))
        .zip(others.par_chunks_exact_mut(length))
        .with_min_len(few.div_ceil(length))
        .enumerate()
        .for_each_init(room, |room, (index, ((stream, one), other))| {
            make(room, index, stream, one, other);
        });
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn rows_are_the_units_of_their_streams_with_every_instruction_set(
            seed in any::<u64>(), purpose in any::<u64>(), generation in any::<u64>(), first in any::<u64>(),
            length in 1usize..70, rows in 0usize..9, cut in 0usize..70,
        ) {
            let mut expected = vec![0.0; (rows * length).saturating_sub(cut)];
            for (candidate, row) in expected.chunks_mut(length).enumerate() {
                let candidate = first.wrapping_add(candidate as u64);
                Stream::new(seed, purpose, generation, candidate).units(row);
            }
            for level in Level::available() {
                let mut numbers = vec![f64::NAN; expected.len()];
                let key = [seed, purpose];
                level.run(Rows { key, generation, first, length, numbers: &mut numbers });
                prop_assert_eq!(&numbers, &expected, "{}", level.name());
            }
        }
    }
}
