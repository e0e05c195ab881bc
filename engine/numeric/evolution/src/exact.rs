//! Sums that are rounded once, and the figures that are made of them.

use swarmwright_lanes::{Kernel, Lanes, Level};

/// The sum, rounded once, with the same bits in any order. `None` if it overflows on the way.
///
/// Shewchuk, "Adaptive precision floating-point arithmetic", Discrete & Computational Geometry 18, 1997. Numbers must be finite.
#[must_use]
pub fn exact_sum(numbers: impl IntoIterator<Item = f64>) -> Option<f64> {
    // Numbers that do not overlap, ascending, with the same sum.
    let mut parts: Vec<f64> = Vec::new();
    for number in numbers {
        let (mut sum, mut filled) = (number, 0);
        for index in 0..parts.len() {
            let (high, low) = two_sum(sum, parts[index]);
            if low != 0.0 {
                parts[filled] = low;
                filled += 1;
            }
            sum = high;
        }
        parts.truncate(filled);
        if !sum.is_finite() {
            return None;
        }
        if sum != 0.0 {
            parts.push(sum);
        }
    }
    let mut high = parts.pop().unwrap_or_default();
    let mut low = 0.0;
    while low == 0.0 {
        let Some(part) = parts.pop() else {
            return Some(high);
        };
        (high, low) = two_sum(high, part);
    }
    // Half-way between two numbers the parts that are left decide.
    let next = parts.last().copied().unwrap_or_default();
    if (low < 0.0 && next < 0.0) || (low > 0.0 && next > 0.0) {
        let twice = low * 2.0;
        let other = high + twice;
        if other - high == twice {
            high = other;
        }
    }
    Some(high)
}

/// Number of values that are summed side by side.
const SIDE: usize = 8;
/// Parts into which each number is cut.
const PARTS: usize = 3;
/// Fewer numbers than these are not summed faster in parts; more do not leave enough bits for each.
const FEW: usize = 32;
const MOST: usize = 1 << 20;
/// Sizes between which nothing overflows and nothing is lost below the least numbers.
const LEAST_SIZE: f64 = 1e-200;
const MOST_SIZE: f64 = 1e200;

/// [`exact_sum`] of many numbers that do not differ too much in size, in vectors: each is cut into three parts that are multiples
/// of so much that sums of many of them are exact, in any order. None where a number has more bits than these have.
///
/// Demmel and Nguyen, "Fast reproducible floating-point summation", ARITH 21, 2013.
fn sum_in_parts(numbers: &[f64]) -> Option<f64> {
    if numbers.len() < FEW || numbers.len() > MOST {
        return None;
    }
    Level::best().run(InParts(numbers))
}

struct InParts<'a>(&'a [f64]);

impl Kernel for InParts<'_> {
    type Output = Option<f64>;

    #[inline(always)]
    fn run<L: Lanes>(self) -> Option<f64> {
        let Self(numbers) = self;
        let (whole, rest) = numbers.as_chunks::<SIDE>();
        let mut last = [0.0; SIDE];
        last[..rest.len()].copy_from_slice(rest);
        let mut sizes = [0.0_f64; SIDE];
        for numbers in whole.iter().chain([&last]) {
            for (size, number) in sizes.iter_mut().zip(numbers) {
                *size = if number.abs() > *size {
                    number.abs()
                } else {
                    *size
                };
            }
        }
        let size = sizes.into_iter().fold(0.0, f64::max);
        if !(LEAST_SIZE..=MOST_SIZE).contains(&size) {
            return None;
        }
        // What a number of this size has one bit of, added and subtracted, leaves multiples of its last bit.
        let count = power_above(count(numbers.len()));
        let mut cuts = [3.0 * count * power_above(size); PARTS];
        for part in 1..PARTS {
            cuts[part] = cuts[part - 1] * count * f64::EPSILON;
        }
        let (mut sums, mut left) = ([[0.0; SIDE]; PARTS], [0.0_f64; SIDE]);
        for numbers in whole.iter().chain([&last]) {
            let mut numbers = *numbers;
            for (sums, cut) in sums.iter_mut().zip(cuts) {
                for (number, sum) in numbers.iter_mut().zip(sums) {
                    let part = (*number + cut) - cut;
                    *sum += part;
                    *number -= part;
                }
            }
            for (left, number) in left.iter_mut().zip(numbers) {
                *left = if number == 0.0 { *left } else { 1.0 };
            }
        }
        if left != [0.0; SIDE] {
            return None;
        }
        exact_sum(sums.into_iter().flatten())
    }
}

/// The smallest power of two above a positive number.
fn power_above(number: f64) -> f64 {
    const EXPONENT: u64 = 0x7FF << 52;
    2.0 * f64::from_bits(number.to_bits() & EXPONENT)
}

/// A sum, rounded, and its rounding error.
fn two_sum(left: f64, right: f64) -> (f64, f64) {
    let (large, small) = if left.abs() < right.abs() {
        (right, left)
    } else {
        (left, right)
    };
    let sum = large + small;
    (sum, small - (sum - large))
}

/// How the results of several episodes become one number.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Aggregate {
    /// Their mean.
    Mean,
    /// Their sum.
    Sum,
    /// Their median.
    Median,
    /// The least of them.
    Worst,
    /// What this share of them does not exceed.
    Quantile(f64),
    /// The mean of this share of them, the worst.
    WorstShare(f64),
}

impl Aggregate {
    /// The number for some results, at least one; NaN where one of them or the number is not finite. Zero has no sign.
    #[must_use]
    pub fn of(self, results: &[f64]) -> f64 {
        if !results.iter().all(|result| result.is_finite()) {
            return f64::NAN;
        }
        let number = match (self, results) {
            // Whatever the aggregate of one number, it is the number.
            (_, [single]) if !matches!(self, Self::WorstShare(_)) => *single,
            (Self::Mean, _) => mean(results),
            (Self::Sum, _) => sum(results),
            (Self::Median, _) => {
                let ordered = ordered(results);
                let middle = ordered.len() / 2;
                if ordered.len() % 2 == 1 {
                    ordered[middle]
                } else {
                    ordered[middle - 1] / 2.0 + ordered[middle] / 2.0
                }
            }
            (Self::Worst, _) => results.iter().copied().fold(f64::INFINITY, f64::min),
            (Self::Quantile(share), _) => quantile(&ordered(results), share),
            (Self::WorstShare(share), _) => worst_share(&ordered(results), share),
        };
        if number.is_finite() {
            number + 0.0
        } else {
            f64::NAN
        }
    }

    /// The same for each row of `length` results, at least one; where that is possible, in their place.
    #[must_use]
    pub fn of_rows(self, mut results: Vec<f64>, length: usize) -> Vec<f64> {
        if length != 1 || matches!(self, Self::WorstShare(_)) {
            return results
                .chunks_exact(length)
                .map(|row| self.of(row))
                .collect();
        }
        for result in &mut results {
            *result = if result.is_finite() {
                *result + 0.0
            } else {
                f64::NAN
            };
        }
        results
    }
}

/// A power of two: sums of fewer numbers than its reciprocal, each times it, do not overflow.
const SMALLER: f64 = 1.0 / (1_u128 << 64) as f64;

/// The sum, infinite where it overflows.
fn sum(numbers: &[f64]) -> f64 {
    let sum = sum_in_parts(numbers).or_else(|| exact_sum(numbers.iter().copied()));
    sum.unwrap_or_else(|| smaller_sum(numbers) / SMALLER)
}

/// The sum times [`SMALLER`].
fn smaller_sum(numbers: &[f64]) -> f64 {
    exact_sum(numbers.iter().map(|number| number * SMALLER)).unwrap_or(f64::NAN)
}

/// The mean of some numbers, also where their sum overflows.
fn mean(numbers: &[f64]) -> f64 {
    let sum = sum(numbers);
    if sum.is_finite() {
        return sum / count(numbers.len());
    }
    let mean = smaller_sum(numbers) / count(numbers.len()) / SMALLER;
    // Rounding may put a mean beyond all numbers by its last bit: here, where it is scaled, beyond the largest number that there is.
    let (least, most) = numbers.iter().fold(
        (f64::INFINITY, f64::NEG_INFINITY),
        |(least, most), number| (number.min(least), number.max(most)),
    );
    mean.max(least).min(most)
}

/// The mean of the worst share of ascending numbers, also where their sum overflows; the last one counts in part.
fn worst_share(ordered: &[f64], share: f64) -> f64 {
    let mass = share * count(ordered.len());
    let whole = floor(mass);
    let part = ordered
        .get(whole)
        .map(|value| value * (mass - count(whole)));
    let whole = &ordered[..whole.min(ordered.len())];
    let worst = whole.iter().copied().chain(part);
    if let Some(sum) = exact_sum(worst.clone()) {
        return sum / mass;
    }
    let sum = exact_sum(worst.map(|number| number * SMALLER)).unwrap_or(f64::NAN);
    let last = ordered[whole.len().min(ordered.len() - 1)];
    (sum / mass / SMALLER).max(ordered[0]).min(last)
}

/// Interpolated between neighbours: definition 7 of Hyndman and Fan, The American Statistician 50, 1996. NaN of none.
fn quantile(ordered: &[f64], share: f64) -> f64 {
    let Some(last) = ordered.len().checked_sub(1) else {
        return f64::NAN;
    };
    let position = share * count(last);
    let low = floor(position);
    let (high, part) = ((low + 1).min(last), position - count(low));
    ordered[low] * (1.0 - part) + ordered[high] * part
}

/// What the fitness of a population looks like; failed members, NaN, are left out, and without others all is NaN.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Figures {
    /// The largest.
    pub best: f64,
    /// Also where the sum overflows.
    pub mean: f64,
    /// A quarter is not above it.
    pub lower_quartile: f64,
    /// Half are not above it.
    pub median: f64,
    /// Value that three quarters of the values do not exceed.
    pub upper_quartile: f64,
}

impl Figures {
    /// The figures of a population.
    #[must_use]
    pub fn of(fitness: &[f64]) -> Self {
        let finite = fitness.iter().copied().filter(|value| value.is_finite());
        let mut ordered: Vec<f64> = finite.collect();
        let mean = match ordered.len() {
            0 => f64::NAN,
            _ => mean(&ordered),
        };
        let best = ordered.iter().copied().max_by(f64::total_cmp);
        put_quartiles(&mut ordered);
        Self {
            best: best.unwrap_or(f64::NAN),
            mean,
            lower_quartile: quantile(&ordered, 0.25),
            median: quantile(&ordered, 0.5),
            upper_quartile: quantile(&ordered, 0.75),
        }
    }
}

/// Brings the numbers that quartiles are made of to where they are in ascending order: faster than ordering all.
fn put_quartiles(numbers: &mut [f64]) {
    let Some(last) = numbers.len().checked_sub(1) else {
        return;
    };
    // Those that are in their places have only smaller ones before them and larger ones behind them.
    let mut placed: Vec<usize> = Vec::with_capacity(6);
    for share in [0.5, 0.25, 0.75] {
        let low = floor(share * count(last));
        for rank in [low, (low + 1).min(last)] {
            let at = placed.partition_point(|other| *other < rank);
            if placed.get(at) == Some(&rank) {
                continue;
            }
            let start = if at == 0 { 0 } else { placed[at - 1] + 1 };
            let end = placed.get(at).copied().unwrap_or(numbers.len());
            numbers[start..end].select_nth_unstable_by(rank - start, f64::total_cmp);
            placed.insert(at, rank);
        }
    }
}

/// The best candidate of a generation, and the number of failures.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Outcome {
    /// The best candidate, of equals the first; 0 where all failed.
    pub leader: usize,
    /// Candidates without fitness: NaN.
    pub failed: usize,
}

impl Outcome {
    /// Of the fitness of a generation's candidates.
    #[must_use]
    pub fn of(fitness: &[f64]) -> Self {
        let (mut leader, mut most, mut failed) = (0, f64::NAN, 0);
        for (index, value) in fitness.iter().enumerate() {
            if value.is_nan() {
                failed += 1;
            } else if most.is_nan() || *value > most {
                (leader, most) = (index, *value);
            }
        }
        Self { leader, failed }
    }
}

fn ordered(numbers: &[f64]) -> Vec<f64> {
    let mut ordered = numbers.to_vec();
    ordered.sort_unstable_by(f64::total_cmp);
    ordered
}

#[expect(clippy::cast_precision_loss, reason = "numbers of results are small")]
fn count(number: usize) -> f64 {
    number as f64
}

#[expect(
    clippy::cast_possible_truncation,
    clippy::cast_sign_loss,
    reason = "a share of a number of results"
)]
fn floor(number: f64) -> usize {
    number.floor() as usize
}
