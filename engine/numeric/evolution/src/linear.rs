//! Sums over rows of numbers in a written-down order that compilers can vectorise without changing a bit.

use swarmwright_lanes::{Kernel, Lanes};

/// Partial sums of a dot product.
const PARTS: usize = 8;

/// The dot product: term i goes into partial sum i mod 8, and these are added in pairs.
#[inline(always)]
pub(crate) fn dot(left: &[f64], right: &[f64]) -> f64 {
    let mut sums = [0.0; PARTS];
    let (lefts, rights) = (left.chunks_exact(PARTS), right.chunks_exact(PARTS));
    let rest = lefts.remainder().iter().zip(rights.remainder());
    for (chunk, other) in lefts.zip(rights) {
        for part in 0..PARTS {
            sums[part] += chunk[part] * other[part];
        }
    }
    for (sum, (factor, other)) in sums.iter_mut().zip(rest) {
        *sum += factor * other;
    }
    let [a, b, c, d, e, f, g, h] = sums;
    ((a + e) + (c + g)) + ((b + f) + (d + h))
}

/// Adds rows times their factors to `sum`, row after row.
///
/// `row(i)` is the i-th of as many rows as there are factors, each as long as `sum`.
#[inline(always)]
pub(crate) fn add_rows<'a>(sum: &mut [f64], factors: &[f64], row: impl Fn(usize) -> &'a [f64]) {
    let size = sum.len();
    let mut blocks = factors.chunks_exact(4);
    let mut at = 0;
    // Four rows at a time: each sum is loaded and stored once for them, and the order stays.
    for block in &mut blocks {
        let (first, second) = (&row(at)[..size], &row(at + 1)[..size]);
        let (third, fourth) = (&row(at + 2)[..size], &row(at + 3)[..size]);
        for index in 0..size {
            let mut value = sum[index];
            value += block[0] * first[index];
            value += block[1] * second[index];
            value += block[2] * third[index];
            value += block[3] * fourth[index];
            sum[index] = value;
        }
        at += 4;
    }
    for factor in blocks.remainder() {
        let values = &row(at)[..size];
        for index in 0..size {
            sum[index] += factor * values[index];
        }
        at += 1;
    }
}

/// Adds to each row of `sums` the product of a row of `left` and `right`, a square matrix; row after row of the latter.
#[inline(always)]
pub(crate) fn add_product(left: &[f64], right: &[f64], size: usize, sums: &mut [f64]) {
    if size == 0 {
        return;
    }
    // Rows of the matrix stay in the nearest cache for all rows of `left`.
    for (block, rows) in right.chunks(4 * size).enumerate() {
        let factors = 4 * block..4 * block + rows.len() / size;
        for (row, sum) in left.chunks_exact(size).zip(sums.chunks_exact_mut(size)) {
            add_rows(sum, &row[factors.clone()], |index| {
                &rows[index * size..(index + 1) * size]
            });
        }
    }
}

/// [`add_product`] with the best instructions of the processor.
pub(crate) struct Product<'a> {
    pub left: &'a [f64],
    pub right: &'a [f64],
    pub size: usize,
    pub sums: &'a mut [f64],
}

impl Kernel for Product<'_> {
    type Output = ();

    #[inline(always)]
    fn run<L: Lanes>(self) {
        add_product(self.left, self.right, self.size, self.sums);
    }
}
