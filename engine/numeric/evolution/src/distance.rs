//! How different genomes are.

use swarmwright_lanes::{Kernel, Lanes, Level};

/// Genomes compared at once: their sums do not wait for one another.
const AT_ONCE: usize = 4;
/// Sums of [`nearly`].
const LANES: usize = 16;

/// The sum of absolute differences, added in the genome's order.
#[must_use]
pub fn distance(left: &[f32], right: &[f32]) -> f64 {
    left.iter()
        .zip(right)
        .fold(0.0, |sum, (left, right)| sum + difference(*left, *right))
}

/// The distance of one genome to each of several, see [`distance`].
///
/// # Panics
///
/// When there are fewer places in `distances` than `others`, or a genome is shorter than `genome`.
pub fn distances(genome: &[f32], others: &[&[f32]], distances: &mut [f64]) {
    assert!(others.len() <= distances.len());
    let mut places = distances.chunks_exact_mut(AT_ONCE);
    let mut groups = others.chunks_exact(AT_ONCE);
    for (group, places) in (&mut groups).zip(&mut places) {
        let rows: [&[f32]; AT_ONCE] = std::array::from_fn(|row| &group[row][..genome.len()]);
        let mut sums = [0.0; AT_ONCE];
        for (gene, value) in genome.iter().enumerate() {
            for (sum, row) in sums.iter_mut().zip(rows) {
                *sum += difference(*value, row[gene]);
            }
        }
        places.copy_from_slice(&sums);
    }
    let done = others.len() - groups.remainder().len();
    for (other, slot) in groups.remainder().iter().zip(&mut distances[done..]) {
        *slot = distance(genome, other);
    }
}

/// Finds the genome that is the most different from another one.
#[derive(Debug, Default, Clone)]
pub struct Farthest(Vec<f32>);

impl Farthest {
    /// The first of several genomes whose [`distance`] from `genome` is the largest; None without any.
    ///
    /// # Panics
    ///
    /// When a genome is shorter than `genome`.
    pub fn find<'a>(
        &mut self,
        genome: &[f32],
        others: impl ExactSizeIterator<Item = &'a [f32]> + Clone,
    ) -> Option<usize> {
        // Sums in binary32 are several times as fast and seldom leave a doubt: each operation is wrong by 2^-24 at most. Where they
        // leave one, or are too large for binary32, those that may be the largest are computed in binary64.
        #[expect(clippy::cast_precision_loss, reason = "a bound is meant")]
        let doubt = 2.0 * (genome.len() + LANES) as f32 * f32::EPSILON;
        self.0.clear();
        Level::best().run(Nearly {
            genome,
            others: others.clone(),
            distances: &mut self.0,
        });
        let largest = self.0.iter().copied().fold(0.0, f32::max);
        let certain = largest.is_finite() && doubt < 1.0;
        let least = if certain {
            largest * (1.0 - doubt)
        } else {
            0.0
        };
        let mut farthest: Option<(usize, &[f32], Option<f64>)> = None;
        for (index, other) in others.enumerate() {
            if self.0[index] < least {
                continue;
            }
            let Some((_, first, most)) = farthest else {
                farthest = Some((index, other, None));
                continue;
            };
            let (most, its) = (
                most.unwrap_or_else(|| distance(genome, first)),
                distance(genome, other),
            );
            farthest = if its > most {
                Some((index, other, Some(its)))
            } else {
                farthest.map(|(index, first, _)| (index, first, Some(most)))
            };
        }
        farthest.map(|(index, ..)| index)
    }
}

/// Adds the distance to each of several genomes, in binary32.
struct Nearly<'a, I> {
    genome: &'a [f32],
    others: I,
    distances: &'a mut Vec<f32>,
}

impl<'a, I: Iterator<Item = &'a [f32]>> Kernel for Nearly<'_, I> {
    type Output = ();

    #[inline(always)]
    fn run<L: Lanes>(self) {
        for other in self.others {
            self.distances.push(nearly(self.genome, other));
        }
    }
}

/// The distance in binary32, in sums of their own.
#[inline(always)]
fn nearly(left: &[f32], right: &[f32]) -> f32 {
    let (lefts, left_rest) = left.as_chunks::<LANES>();
    let (rights, right_rest) = right[..left.len()].as_chunks::<LANES>();
    let mut sums = [0.0; LANES];
    for (lefts, rights) in lefts.iter().zip(rights) {
        for lane in 0..LANES {
            sums[lane] += (lefts[lane] - rights[lane]).abs();
        }
    }
    let mut width = LANES / 2;
    while width > 0 {
        for lane in 0..width {
            sums[lane] += sums[lane + width];
        }
        width /= 2;
    }
    let mut sum = sums[0];
    for (left, right) in left_rest.iter().zip(right_rest) {
        sum += (left - right).abs();
    }
    sum
}

#[inline]
fn difference(left: f32, right: f32) -> f64 {
    (f64::from(left) - f64::from(right)).abs()
}
