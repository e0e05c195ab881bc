//! Streams of random numbers, each with an address of its own.

use std::ops::Range;

use rayon::prelude::*;
use sha2::{Digest, Sha256};
use swarmwright_lanes::{Kernel, Lanes, Level};

use crate::normal::{normals, of_words};
pub(crate) use crate::philox::SIDE;
use crate::philox::{are_wide, blocks, side_by_side, words};

const WORDS: usize = 4;
/// Numbers that are made in little more time than another thread takes to begin.
const FEW: usize = 1 << 14;
/// Words of rows that are drawn together: they and their numbers fit into the nearest cache.
const TOGETHER: usize = 1024;
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
    /// Words of the next block that are passed over; 0 where this block is not used up.
    passed: usize,
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
            passed: 0,
        }
    }

    /// The streams of candidates that follow each other, as [`new`](Self::new) makes them; where that is faster, their first blocks
    /// are drawn together.
    pub(crate) fn of_each(
        seed: u64,
        purpose: u64,
        generation: u64,
        candidates: Range<u64>,
    ) -> Vec<Self> {
        let mut streams: Vec<Self> = candidates
            .map(|candidate| Self::new(seed, purpose, generation, candidate))
            .collect();
        Level::best().run(FirstBlocks(&mut streams));
        streams
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
        let (head, mut body) = words.split_at_mut(rest);
        head.copy_from_slice(&self.block[self.used..self.used + rest]);
        self.used += rest;
        if self.passed == 0 {
            let whole = body.len() / (SIDE * WORDS) * SIDE;
            let (blocks, others) = body.split_at_mut(whole * WORDS);
            self.draw_blocks(blocks.as_chunks_mut().0);
            body = others;
        }
        // What is left may begin and end within a block: all of these are drawn side by side.
        let mut blocks = [[0; WORDS]; SIDE];
        while !body.is_empty() {
            let count = (self.passed + body.len()).div_ceil(WORDS).min(SIDE);
            self.draw_blocks(&mut blocks[..count]);
            let drawn = &blocks[..count].as_flattened()[self.passed..];
            let amount = drawn.len().min(body.len());
            let (places, others) = body.split_at_mut(amount);
            places.copy_from_slice(&drawn[..amount]);
            if amount < drawn.len() {
                self.block = blocks[count - 1];
                self.used = WORDS - (drawn.len() - amount);
            }
            self.passed = 0;
            body = others;
        }
    }

    /// The next blocks; this one is used up.
    fn draw_blocks(&mut self, places: &mut [[u64; WORDS]]) {
        let first = self.blocks.wrapping_add(1);
        blocks(
            [first, self.candidate, self.generation, 0],
            self.key,
            places,
        );
        self.blocks = self.blocks.wrapping_add(places.len() as u64);
    }

    /// Goes past words without drawing them.
    pub fn skip(&mut self, words: usize) {
        let rest = WORDS - self.used;
        if words < rest {
            self.used += words;
            return;
        }
        let beyond = self.passed + words - rest;
        self.blocks = self.blocks.wrapping_add((beyond / WORDS) as u64);
        (self.used, self.passed) = (WORDS, beyond % WORDS);
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

    /// As many numbers of the standard normal distribution as there are places, |z| <= 6.7: two for each word, of which the last one
    /// is lost where they are odd; see [`of_words`](crate::normal::of_words).
    pub fn normals<T: From<f32>>(&mut self, numbers: &mut [T]) {
        let mut words = vec![0; numbers.len().div_ceil(2)];
        self.fill(&mut words);
        let mut pairs = vec![0.0; 2 * words.len()];
        normals(&words, &mut pairs);
        for (slot, number) in numbers.iter_mut().zip(pairs) {
            *slot = T::from(number);
        }
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
        for slot in integers {
            *slot = loop {
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
        (self.used, self.passed) = (self.passed, 0);
    }

    #[inline]
    fn at(&self, block: u64) -> [u64; WORDS] {
        words([block, self.candidate, self.generation, 0], self.key)
    }
}

/// Draws the first blocks of streams whose addresses differ in the candidate alone.
struct FirstBlocks<'a>(&'a mut [Stream]);

impl Kernel for FirstBlocks<'_> {
    type Output = ();

    #[inline(always)]
    fn run<L: Lanes>(self) {
        if !are_wide::<L>() {
            return; // each when it is wanted
        }
        for streams in self.0.as_chunks_mut::<SIDE>().0 {
            let mut candidates = [0; SIDE];
            for (candidate, stream) in candidates.iter_mut().zip(&*streams) {
                *candidate = stream.candidate;
            }
            let rest = [candidates, [streams[0].generation; SIDE], [0; SIDE]];
            let words = side_by_side([1; SIDE], rest, streams[0].key);
            for (lane, stream) in streams.iter_mut().enumerate() {
                stream.block = [
                    words[0][lane],
                    words[1][lane],
                    words[2][lane],
                    words[3][lane],
                ];
                stream.blocks = 1;
                stream.used = 0;
            }
        }
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
    numbers: &mut [f32],
) {
    let streams = Streams {
        seed,
        purpose,
        generation,
        first,
    };
    Level::best().run(NormalRows {
        streams,
        length,
        numbers,
    });
}

/// A row of `length` normal numbers from each stream; as [`Stream::normals`] for each, and faster where streams begin with these and
/// belong to candidates that follow each other.
pub(crate) fn normals_of_each(streams: &mut [Stream], length: usize, numbers: &mut [f64]) {
    let Some(first) = streams.first().cloned() else {
        return;
    };
    let is_next = |(candidate, stream): (u64, &Stream)| {
        stream.candidate == first.candidate.wrapping_add(candidate)
            && (stream.key, stream.generation) == (first.key, first.generation)
            && (stream.blocks, stream.used, stream.passed) == (0, WORDS, 0)
    };
    if streams.len() < SIDE || !(0..).zip(&*streams).all(is_next) {
        for (stream, row) in streams.iter_mut().zip(numbers.chunks_exact_mut(length)) {
            stream.normals(row);
        }
        return;
    }
    let [seed, purpose] = first.key;
    Level::best().run(NormalRows {
        streams: Streams {
            seed,
            purpose,
            generation: first.generation,
            first: first.candidate,
        },
        length,
        numbers: &mut numbers[..streams.len() * length],
    });
    for stream in streams {
        stream.skip(length.div_ceil(2));
    }
}

/// About as many rows of `length` numbers as have `numbers`, at least one: short ones are drawn fastest in sixteens.
pub(crate) fn rows_of(numbers: usize, length: usize) -> usize {
    let rows = (numbers / length.max(1)).max(1);
    if rows < SIDE / 2 {
        return rows;
    }
    rows.next_multiple_of(SIDE)
}

/// Rows of normal numbers, each from the stream of its own candidate.
struct NormalRows<'a, T> {
    streams: Streams,
    length: usize,
    numbers: &'a mut [T],
}

impl<T: From<f32>> Kernel for NormalRows<'_, T> {
    type Output = ();

    #[inline(always)]
    fn run<L: Lanes>(self) {
        let Self {
            streams,
            length,
            numbers,
        } = self;
        let length = length.max(1);
        let width = length.div_ceil(2);
        let rows = rows_of(TOGETHER, width);
        let most = (rows * width).min(numbers.len().div_ceil(length) * width);
        let (mut words, mut pairs) = (vec![0; most], vec![0.0; 2 * most]);
        for (part, numbers) in numbers.chunks_mut(rows * length).enumerate() {
            let drawn = numbers.len().div_ceil(length) * width;
            let (words, pairs) = (&mut words[..drawn], &mut pairs[..2 * drawn]);
            streams.fill_all::<L>(part * rows, width, words);
            of_words::<L>(words, pairs);
            let rows = numbers.chunks_mut(length);
            for (row, pairs) in rows.zip(pairs.chunks_exact(2 * width)) {
                for (slot, number) in row.iter_mut().zip(pairs) {
                    *slot = T::from(*number);
                }
            }
        }
    }
}

/// Streams of candidates that follow each other.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Streams {
    pub(crate) seed: u64,
    /// See [`purpose_key`].
    pub(crate) purpose: u64,
    pub(crate) generation: u64,
    /// The first candidate.
    pub(crate) first: u64,
}

impl Streams {
    /// The stream of a candidate, counted from the first one.
    pub(crate) fn of(&self, candidate: usize) -> Stream {
        let candidate = self.first.wrapping_add(candidate as u64);
        Stream::new(self.seed, self.purpose, self.generation, candidate)
    }

    /// Draws the first words of as many streams as there are rows of `length` words, from `candidate` on.
    #[inline(always)]
    fn fill_all<L: Lanes>(&self, candidate: usize, length: usize, words: &mut [u64]) {
        let whole = words.len() / (SIDE * length) * SIDE;
        let (rows, rest) = words.split_at_mut(whole * length);
        for (part, rows) in rows.chunks_exact_mut(SIDE * length).enumerate() {
            self.fill_rows::<L>(candidate + part * SIDE, length, rows);
        }
        if are_wide::<L>() {
            let first = self.first.wrapping_add((candidate + whole) as u64);
            blocks_side_by_side(Self { first, ..*self }, length, rest);
        } else {
            self.fill_rows::<L>(candidate + whole, length, rest);
        }
    }

    /// As [`fill_all`](Self::fill_all), at most [`SIDE`] rows.
    #[inline(always)]
    pub(crate) fn fill_rows<L: Lanes>(&self, candidate: usize, length: usize, words: &mut [u64]) {
        if !are_wide::<L>() || words.len() < SIDE * length {
            for (row, words) in words.chunks_exact_mut(length).enumerate() {
                self.of(candidate + row).fill(words);
            }
            return;
        }
        let first = self.first.wrapping_add(candidate as u64);
        let candidates = std::array::from_fn(|row| first.wrapping_add(row as u64));
        let rest = [candidates, [self.generation; SIDE], [0; SIDE]];
        for start in (0..length).step_by(WORDS) {
            let counter = [1 + (start / WORDS) as u64; SIDE];
            let block = side_by_side(counter, rest, [self.seed, self.purpose]);
            if start + WORDS <= length {
                L::words_of_rows(&block, &mut words[start..], length);
                continue;
            }
            for (row, words) in words.chunks_exact_mut(length).enumerate() {
                for (slot, column) in words[start..].iter_mut().zip(&block) {
                    *slot = column[row];
                }
            }
        }
    }
}

/// Blocks of several rows side by side: what is left of a row fills no vector.
#[inline(always)]
fn blocks_side_by_side(streams: Streams, length: usize, words: &mut [u64]) {
    let (mut candidate, mut row, mut block) = (streams.first, 0, 0);
    while row < words.len() {
        let (mut counters, mut candidates) = ([0; SIDE], [0; SIDE]);
        let mut places = [(0, 0); SIDE];
        for lane in 0..SIDE {
            let start = row + WORDS * block;
            let end = (start + WORDS).min(row + length).min(words.len());
            (counters[lane], candidates[lane]) = (1 + block as u64, candidate);
            places[lane] = (start.min(end), end);
            block += 1;
            if block * WORDS >= length {
                (row, block) = (row + length, 0);
                candidate = candidate.wrapping_add(1);
            }
        }
        let rest = [candidates, [streams.generation; SIDE], [0; SIDE]];
        let drawn = side_by_side(counters, rest, [streams.seed, streams.purpose]);
        for (lane, (start, end)) in places.into_iter().enumerate() {
            for (slot, drawn) in words[start..end].iter_mut().zip(&drawn) {
                *slot = drawn[lane];
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

/// Makes a row of `length` numbers with each stream; many rows are made on all processors.
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
/// `few`: numbers that are made in little more time than another thread takes to begin. `scratch` makes what `make` works in,
/// once for each thread.
pub(crate) fn rows_of_two<T: Send, U: Send, R>(
    streams: &mut [Stream],
    (lefts, rights): (&mut [T], &mut [U]),
    length: usize,
    few: usize,
    scratch: impl Fn() -> R + Send + Sync,
    make: impl Fn(&mut R, usize, &mut Stream, &mut [T], &mut [U]) + Sync,
) {
    let length = length.max(1);
    if lefts.len() < 2 * few {
        let mut scratch = scratch();
        let both = lefts
            .chunks_exact_mut(length)
            .zip(rights.chunks_exact_mut(length));
        for (index, (stream, (left, right))) in streams.iter_mut().zip(both).enumerate() {
            make(&mut scratch, index, stream, left, right);
        }
        return;
    }
    streams
        .par_iter_mut()
        .zip(lefts.par_chunks_exact_mut(length))
        .zip(rights.par_chunks_exact_mut(length))
        .with_min_len(few.div_ceil(length))
        .enumerate()
        .for_each_init(scratch, |scratch, (index, ((stream, left), right))| {
            make(scratch, index, stream, left, right);
        });
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn streams_that_begin_together_are_those_that_begin_alone(
            seed in any::<u64>(), purpose in any::<u64>(), generation in any::<u64>(), first in 0..u64::MAX / 2,
            count in 0u64..70, words in 0usize..30, skipped in 0usize..9,
        ) {
            let together = Stream::of_each(seed, purpose, generation, first..first + count);
            prop_assert_eq!(together.len() as u64, count);
            for (candidate, mut stream) in (first..).zip(together) {
                let mut alone = Stream::new(seed, purpose, generation, candidate);
                stream.skip(skipped);
                alone.skip(skipped);
                let (mut found, mut expected) = (vec![0; words], vec![0; words]);
                stream.fill(&mut found);
                alone.fill(&mut expected);
                prop_assert_eq!(found, expected);
                prop_assert_eq!(stream.word(), alone.word());
            }
        }

        #[test]
        fn rows_of_streams_are_what_each_gives(
            seed in any::<u64>(), first in any::<u64>(), count in 0u64..50, length in 1usize..70, skipped in 0usize..3,
            odd in 0usize..60,
        ) {
            let mut streams: Vec<Stream> =
                (0..count).map(|candidate| Stream::new(seed, 1, 2, first.wrapping_add(candidate))).collect();
            // One that is not like the others, now and then.
            if let Some(stream) = streams.get_mut(odd) {
                stream.skip(skipped);
            }
            let mut others = streams.clone();
            let mut found = vec![0.0; streams.len() * length];
            normals_of_each(&mut streams, length, &mut found);
            for ((stream, other), row) in streams.iter_mut().zip(&mut others).zip(found.chunks_exact(length)) {
                let mut expected = vec![0.0; length];
                other.normals(&mut expected);
                prop_assert_eq!(row, expected);
                prop_assert_eq!(stream.word(), other.word());
            }
        }

        #[test]
        fn rows_are_the_numbers_of_their_streams_with_every_instruction_set(
            seed in any::<u64>(), purpose in any::<u64>(), generation in any::<u64>(), first in any::<u64>(),
            length in 1usize..70, rows in 0usize..50, cut in 0usize..70,
        ) {
            let mut expected = vec![0.0; (rows * length).saturating_sub(cut)];
            for (candidate, row) in expected.chunks_mut(length).enumerate() {
                let candidate = first.wrapping_add(candidate as u64);
                Stream::new(seed, purpose, generation, candidate).normals(row);
            }
            let streams = Streams { seed, purpose, generation, first };
            for level in Level::available() {
                let mut numbers = vec![f32::NAN; expected.len()];
                level.run(NormalRows { streams, length, numbers: &mut numbers });
                prop_assert_eq!(&numbers, &expected, "{}", level.name());
            }
        }
    }
}
