//! Normally distributed numbers, the same bits on every machine.

use swarmwright_controllers::functions::lanes::normal_pair;
use swarmwright_lanes::{Int, Kernel, Lanes, Level, MOST_LANES_UNPAIRED as VECTOR};

/// 2^-31.
const UNIT: f32 = 1.0 / 2_147_483_648.0;

/// Two numbers of the standard normal distribution for each random word, |z| <= 6.7 (Box and Muller 1958).
///
/// In binary32: length = (a + 0.5) * 2^-31, of a the upper 31 of the lower 32 bits, and turn = b * 2^-31, of b the upper 32 bits as
/// a signed integer; both integers are rounded first. The numbers are r cos(pi turn) and r sin(pi turn), r = sqrt(-2 ln length), by
/// the functions of controllers (docs/decisions/002-arithmetic.md).
///
/// # Panics
///
/// When there are not two numbers for each word.
#[inline(always)]
pub(crate) fn of_words<L: Lanes>(words: &[u64], numbers: &mut [f32]) {
    assert_eq!(numbers.len(), 2 * words.len());
    let (whole, rest) = words.as_chunks::<VECTOR>();
    let (places, others) = numbers.as_chunks_mut::<{ 2 * VECTOR }>();
    for (words, numbers) in whole.iter().zip(places) {
        of_vector::<L>(words, numbers);
    }
    if !rest.is_empty() {
        let (mut words, mut numbers) = ([0; VECTOR], [0.0; 2 * VECTOR]);
        words[..rest.len()].copy_from_slice(rest);
        of_vector::<L>(&words, &mut numbers);
        others.copy_from_slice(&numbers[..2 * rest.len()]);
    }
}

#[expect(
    clippy::cast_possible_truncation,
    clippy::cast_possible_wrap,
    reason = "the halves of a word are what is meant"
)]
#[inline(always)]
fn of_vector<L: Lanes>(words: &[u64; VECTOR], numbers: &mut [f32; 2 * VECTOR]) {
    let (mut lengths, mut turns) = ([0; VECTOR], [0; VECTOR]);
    for lane in 0..VECTOR {
        lengths[lane] = (words[lane] as u32 >> 1) as i32;
        turns[lane] = (words[lane] >> 32) as i32;
    }
    let (mut firsts, mut seconds) = ([0.0; VECTOR], [0.0; VECTOR]);
    for lane in (0..VECTOR).step_by(L::WIDTH) {
        let length = L::from_int(L::Int::load(&lengths[lane..]));
        let length = length.add(L::splat(0.5)).mul(L::splat(UNIT));
        let turn = L::from_int(L::Int::load(&turns[lane..])).mul(L::splat(UNIT));
        let [first, second] = normal_pair(length, turn);
        first.store(&mut firsts[lane..]);
        second.store(&mut seconds[lane..]);
    }
    for lane in 0..VECTOR {
        numbers[2 * lane] = firsts[lane];
        numbers[2 * lane + 1] = seconds[lane];
    }
}

/// [`of_words`] with the best instruction set.
struct Normals<'a> {
    words: &'a [u64],
    numbers: &'a mut [f32],
}

impl Kernel for Normals<'_> {
    type Output = ();

    #[inline(always)]
    fn run<L: Lanes>(self) {
        of_words::<L>(self.words, self.numbers);
    }
}

/// See [`of_words`].
pub(crate) fn normals(words: &[u64], numbers: &mut [f32]) {
    Level::best().run(Normals { words, numbers });
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        // All over, and where one half is all ones or zeros.
        #[test]
        fn bits_are_the_same_with_every_instruction_set(
            words in prop::collection::vec(
                prop_oneof![any::<u64>(), any::<u64>().prop_map(|word| word >> 32), any::<u64>().prop_map(|word| !(word << 32))],
                0..100,
            ),
        ) {
            let mut all = Level::available().into_iter().map(|level| {
                let mut numbers = vec![f32::NAN; 2 * words.len()];
                level.run(Normals { words: &words, numbers: &mut numbers });
                numbers
            });
            let expected = all.next().unwrap();
            prop_assert!(expected.iter().all(|number| number.abs() <= 6.7), "{expected:?}");
            for found in all {
                prop_assert_eq!(&found, &expected);
            }
        }
    }
}
