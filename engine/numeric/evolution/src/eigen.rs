//! Eigenvalues and eigenvectors of symmetric matrices, in a written-down order of operations.
//!
//! Householder reflections make the matrix tridiagonal, implicit QL steps make it diagonal (Golub and Van Loan, "Matrix
//! computations", 4th edition, 8.3). The plane rotations of the latter turn the eigenvectors; how this is scheduled changes no bit.

use std::cell::RefCell;

use rayon::prelude::*;
use swarmwright_lanes::{Kernel, Lanes, Level};

use crate::linear::{add_rows, dot};

/// Steps for one eigenvalue; two are usual.
const STEPS: usize = 60;
/// Largest size for which all eigenvectors fit into a near cache.
const SMALL: usize = 128;
/// Rotations that are kept before they are applied.
const KEPT: usize = 1 << 14;
/// Products of rows and rotations from which on several threads are worth their start.
const MANY: usize = 1 << 25;
/// Columns that are rotated at a time.
const WIDE: usize = 16;

/// What a symmetric matrix is made of: the sum over i of `values[i]` times the product of row i of `vectors` with itself.
#[derive(Debug, Clone, PartialEq)]
pub struct Eigen {
    /// Eigenvalues, in no particular order.
    pub values: Vec<f64>,
    /// The eigenvector of each, row after row: orthogonal, of length 1.
    pub vectors: Vec<f64>,
}

/// The eigenvalues and eigenvectors of a symmetric matrix of `size` rows.
///
/// None when a number in it is not finite.
///
/// # Panics
///
/// When `matrix` has not `size` rows of `size` numbers.
#[must_use]
pub fn eigen(matrix: &[f64], size: usize) -> Option<Eigen> {
    assert_eq!(matrix.len(), size * size);
    if !matrix.iter().all(|value| value.is_finite()) {
        return None;
    }
    let largest = matrix
        .iter()
        .fold(0.0, |most: f64, value| most.max(value.abs()));
    // By a power of two, which changes no bit of the numbers: no square is too large or too small afterwards.
    let scale = power_of_two_near(largest);
    let matrix = matrix.iter().map(|value| value / scale).collect();
    let reduced = Level::best().run(Reduction { matrix, size });
    let (values, vectors) = if size <= SMALL {
        Level::best().run(Small(reduced))?
    } else {
        large(reduced)?
    };
    Some(Eigen {
        values: values.iter().map(|value| value * scale).collect(),
        vectors,
    })
}

struct Reduction {
    matrix: Vec<f64>,
    size: usize,
}

impl Kernel for Reduction {
    type Output = Reduced;

    #[inline(always)]
    fn run<L: Lanes>(mut self) -> Reduced {
        let tridiagonal = Tridiagonal::of(&mut self.matrix, self.size);
        let basis = tridiagonal.basis(&self.matrix);
        Reduced { tridiagonal, basis }
    }
}

struct Reduced {
    tridiagonal: Tridiagonal,
    /// The matrix is the tridiagonal one times this orthogonal one, from both sides.
    basis: Vec<f64>,
}

/// The rest for a small matrix: each rotation is applied at once, while the next one is computed.
struct Small(Reduced);

impl Kernel for Small {
    type Output = Option<(Vec<f64>, Vec<f64>)>;

    #[inline(always)]
    fn run<L: Lanes>(self) -> Self::Output {
        let Reduced {
            mut tridiagonal,
            basis,
        } = self.0;
        let size = tridiagonal.diagonal.len();
        let mut rows = vec![0.0; size * size];
        for (row, line) in basis.chunks_exact(size.max(1)).enumerate() {
            for (column, value) in line.iter().enumerate() {
                rows[column * size + row] = *value;
            }
        }
        tridiagonal.solve(
            |index, [cosine, sine]| {
                let (upper, lower) = rows[index * size..(index + 2) * size].split_at_mut(size);
                for (above, below) in upper.iter_mut().zip(lower) {
                    let (first, second) = (*above, *below);
                    *below = sine * first + cosine * second;
                    *above = cosine * first - sine * second;
                }
            },
            |_| (),
        )?;
        Some((tridiagonal.diagonal, rows))
    }
}

/// The rest for a large matrix: rotations are written down, and applied to a few columns at a time.
fn large(reduced: Reduced) -> Option<(Vec<f64>, Vec<f64>)> {
    let Reduced {
        mut tridiagonal,
        basis,
    } = reduced;
    let size = tridiagonal.diagonal.len();
    let mut panels = panels(&basis, size);
    let sweeps = RefCell::new(Sweeps::default());
    tridiagonal.solve(
        |_, rotation| sweeps.borrow_mut().rotations.push(rotation),
        |first| {
            let mut sweeps = sweeps.borrow_mut();
            sweeps.end(first);
            if sweeps.rotations.len() >= KEPT {
                sweeps.apply(&mut panels, size);
            }
        },
    )?;
    sweeps.into_inner().apply(&mut panels, size);
    Some((tridiagonal.diagonal, rows(&panels, size)))
}

fn power_of_two_near(value: f64) -> f64 {
    const EXPONENT: u64 = 0x7ff << 52;
    if value.is_normal() {
        f64::from_bits(value.to_bits() & EXPONENT)
    } else {
        1.0
    }
}

/// The columns of a matrix as rows, in panels of `WIDE` numbers of each, filled up with zeros.
#[inline(always)]
fn panels(matrix: &[f64], size: usize) -> Vec<f64> {
    let mut panels = vec![0.0; size * size.next_multiple_of(WIDE)];
    for (row, line) in matrix.chunks_exact(size.max(1)).enumerate() {
        let panel = &mut panels[row / WIDE * size * WIDE..];
        for (column, value) in line.iter().enumerate() {
            panel[column * WIDE + row % WIDE] = *value;
        }
    }
    panels
}

/// The rows of panels, one after another.
fn rows(panels: &[f64], size: usize) -> Vec<f64> {
    let mut rows = vec![0.0; size * size];
    for (index, panel) in panels.chunks_exact((size * WIDE).max(1)).enumerate() {
        let from = index * WIDE;
        let width = WIDE.min(size - from);
        for (row, part) in rows.chunks_exact_mut(size).zip(panel.chunks_exact(WIDE)) {
            row[from..from + width].copy_from_slice(&part[..width]);
        }
    }
    rows
}

struct Tridiagonal {
    diagonal: Vec<f64>,
    /// Beside the diagonal; the last number is 0.
    beside: Vec<f64>,
    /// Of the reflections I - factor v v^T; their vectors v are what is right of the diagonal of the matrix.
    factors: Vec<f64>,
}

impl Tridiagonal {
    /// Makes a matrix tridiagonal, row by row from the first.
    #[inline(always)]
    fn of(matrix: &mut [f64], size: usize) -> Self {
        let mut tridiagonal = Self {
            diagonal: vec![0.0; size],
            beside: vec![0.0; size],
            factors: vec![0.0; size],
        };
        let mut image = vec![0.0; size];
        for step in 0..size {
            let (above, below) = matrix.split_at_mut((step + 1) * size);
            let row = &mut above[step * size..];
            tridiagonal.diagonal[step] = row[step];
            let vector = &mut row[step + 1..];
            if vector.is_empty() {
                break;
            }
            let (beside, factor) = reflection(vector);
            (tridiagonal.beside[step], tridiagonal.factors[step]) = (beside, factor);
            if factor == 0.0 {
                continue;
            }
            let rest = size - step - 1;
            let image = &mut image[..rest];
            image.fill(0.0);
            add_rows(image, vector, |index| &below[index * size + step + 1..]);
            for value in &mut *image {
                *value *= factor;
            }
            let overlap = 0.5 * factor * dot(image, vector);
            for (value, along) in image.iter_mut().zip(&*vector) {
                *value -= overlap * along;
            }
            for (index, line) in below.chunks_exact_mut(size).enumerate() {
                let (along, of_image) = (vector[index], image[index]);
                let line = &mut line[step + 1..];
                for column in 0..rest {
                    line[column] -= along * image[column] + of_image * vector[column];
                }
            }
        }
        tridiagonal
    }

    /// The orthogonal matrix of all reflections.
    #[inline(always)]
    fn basis(&self, matrix: &[f64]) -> Vec<f64> {
        let size = self.diagonal.len();
        let stride = size;
        let mut product = vec![0.0; size * stride];
        for index in 0..size {
            product[index * stride + index] = 1.0;
        }
        let mut sums = vec![0.0; size];
        for step in (0..size.saturating_sub(1)).rev() {
            if self.factors[step] == 0.0 {
                continue;
            }
            let first = step + 1;
            let vector = &matrix[step * size + first..first * size];
            let sums = &mut sums[first..];
            sums.fill(0.0);
            add_rows(sums, vector, |index| {
                &product[(first + index) * stride + first..]
            });
            let rows = product[first * stride..].chunks_exact_mut(stride);
            for (row, along) in rows.zip(vector) {
                let share = self.factors[step] * along;
                for (value, sum) in row[first..].iter_mut().zip(&*sums) {
                    *value -= share * sum;
                }
            }
        }
        product
    }

    /// Makes the matrix diagonal. None when that does not end.
    ///
    /// `rotate` is given each rotation with the upper of its rows, and `end` the uppermost one after each step.
    #[inline(always)]
    fn solve(
        &mut self,
        mut rotate: impl FnMut(usize, Rotation),
        mut end: impl FnMut(usize),
    ) -> Option<()> {
        for first in 0..self.diagonal.len() {
            for step in 0.. {
                let last = self.end_of_block(first);
                if last == first {
                    break;
                }
                if step == STEPS {
                    return None;
                }
                end(self.step(first, last, &mut rotate));
            }
        }
        Some(())
    }

    /// The last index of the block that begins at `first`: what is beside the diagonal there is nothing.
    #[inline(always)]
    fn end_of_block(&self, first: usize) -> usize {
        let size = self.diagonal.len();
        let mut last = first;
        while last + 1 < size {
            let scale = self.diagonal[last].abs() + self.diagonal[last + 1].abs();
            if self.beside[last].abs() <= f64::EPSILON * scale {
                break;
            }
            last += 1;
        }
        last
    }

    /// An implicit QL step with Wilkinson's shift on a block; returns where it began to, `first` but by chance.
    #[inline(always)]
    fn step(
        &mut self,
        first: usize,
        last: usize,
        rotate: &mut impl FnMut(usize, Rotation),
    ) -> usize {
        let (diagonal, beside) = (&mut self.diagonal, &mut self.beside);
        let half = (diagonal[first + 1] - diagonal[first]) / (2.0 * beside[first]);
        let root = (half * half + 1.0).sqrt();
        let shift = half + if half < 0.0 { -root } else { root };
        let mut along = diagonal[last] - diagonal[first] + beside[first] / shift;
        let (mut cosine, mut sine, mut moved) = (1.0, 1.0, 0.0);
        for index in (first..last).rev() {
            let across = sine * beside[index];
            let straight = cosine * beside[index];
            let length = (across * across + along * along).sqrt();
            beside[index + 1] = length;
            if length == 0.0 {
                // The block falls apart here.
                diagonal[index + 1] -= moved;
                beside[last] = 0.0;
                return index + 1;
            }
            sine = across / length;
            cosine = along / length;
            let upper = diagonal[index + 1] - moved;
            let mixed = (diagonal[index] - upper) * sine + 2.0 * cosine * straight;
            moved = sine * mixed;
            diagonal[index + 1] = upper + moved;
            along = cosine * mixed - straight;
            rotate(index, [cosine, sine]);
        }
        diagonal[first] -= moved;
        beside[first] = along;
        beside[last] = 0.0;
        first
    }
}

/// Makes a vector that of the reflection that leaves nothing but its first number; returns this and the factor.
#[inline(always)]
fn reflection(vector: &mut [f64]) -> (f64, f64) {
    let first = vector[0];
    let rest = dot(&vector[1..], &vector[1..]);
    if rest == 0.0 {
        return (first, 0.0);
    }
    let length = (first * first + rest).sqrt();
    let left = if first > 0.0 { -length } else { length };
    vector[0] = first - left;
    (left, 2.0 / (vector[0] * vector[0] + rest))
}

/// The cosine and the sine of the angle between two rows that follow each other.
type Rotation = [f64; 2];

/// Rotations of neighbouring rows, sweep by sweep, that are still to be applied.
#[derive(Default)]
struct Sweeps {
    rotations: Vec<Rotation>,
    /// First row of each sweep, and the number of rotations up to its end. A sweep goes from the last row to the first.
    ends: Vec<(usize, usize)>,
}

impl Sweeps {
    /// Ends a sweep up to the row `first`.
    fn end(&mut self, first: usize) {
        self.ends.push((first, self.rotations.len()));
    }

    /// Turns the rows by all rotations, one after another, and forgets the rotations.
    fn apply(&mut self, panels: &mut [f64], size: usize) {
        let level = Level::best();
        let turn = |panel: &mut [f64]| {
            level.run(Turn {
                sweeps: self,
                panel,
            });
        };
        let each = (size * WIDE).max(1);
        if panels.len() * self.rotations.len() < MANY {
            panels.chunks_exact_mut(each).for_each(turn);
        } else {
            panels.par_chunks_exact_mut(each).for_each(turn);
        }
        self.rotations.clear();
        self.ends.clear();
    }
}

struct Turn<'a> {
    sweeps: &'a Sweeps,
    panel: &'a mut [f64],
}

impl Kernel for Turn<'_> {
    type Output = ();

    #[inline(always)]
    fn run<L: Lanes>(self) {
        let (rows, _) = self.panel.as_chunks_mut::<WIDE>();
        let mut from = 0;
        for (first, end) in &self.sweeps.ends {
            let rotations = &self.sweeps.rotations[from..*end];
            turn(rotations, &mut rows[*first..][..=rotations.len()]);
            from = *end;
        }
    }
}

/// Turns the last two rows of a panel, then the last but one and the one before it, and so on to the first.
#[inline(always)]
fn turn(rotations: &[Rotation], panel: &mut [[f64; WIDE]]) {
    let Some((last, rows)) = panel.split_last_mut() else {
        return;
    };
    let mut lower = *last;
    let mut target = last;
    for (upper, [cosine, sine]) in rows.iter_mut().rev().zip(rotations) {
        let before = *upper;
        for lane in 0..WIDE {
            target[lane] = sine * before[lane] + cosine * lower[lane];
        }
        for lane in 0..WIDE {
            lower[lane] = cosine * before[lane] - sine * lower[lane];
        }
        target = upper;
    }
    *target = lower;
}
