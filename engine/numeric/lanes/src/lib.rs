//! Vectors of lanes: one kernel, every instruction set, the same bits.
//!
//! A lane is an episode of a candidate. A kernel is written once over [`Lanes`] and compiled for every [`Level`]; the
//! best one that the processor has is chosen at run time. Every operation is one IEEE 754 binary32 operation per lane
//! in the order of the source: nothing is fused, nothing is summed across lanes (docs/decisions/002-arithmetic.md).
//!
//! ```
//! use swarmwright_lanes::{Kernel, Lanes, Level};
//!
//! struct Square<'a>(&'a mut [f32]);
//! impl Kernel for Square<'_> {
//!     type Output = ();
//!     #[inline(always)]
//!     fn run<L: Lanes>(self) {
//!         for part in self.0.chunks_exact_mut(L::WIDTH) {
//!             let x = L::load(part);
//!             x.mul(x).store(part);
//!         }
//!     }
//! }
//! let mut numbers = [3.0; 16];
//! Level::best().run(Square(&mut numbers));
//! assert_eq!(numbers, [9.0; 16]);
//! ```

mod in_order;
mod level;
mod number;
mod pair;
mod portable;
mod scalar;
#[cfg(target_arch = "x86_64")]
mod x86;

pub use level::{INSTRUCTIONS, IS_FOR_PORTABLE, Kernel, Level};
pub use number::{Number, number};
pub use pair::{Pair, PairInt, PairMask};

/// Most lanes of a vector of any instruction set that is not a [`Pair`].
pub const MOST_LANES_UNPAIRED: usize = 16;

/// Most lanes of any vector, pairs of pairs included.
pub const MOST_LANES: usize = 4 * MOST_LANES_UNPAIRED;

/// A vector of binary32, one number per lane, and its companions: integers and conditions.
///
/// Implementations for instruction sets that not every processor has are to be used only inside [`Level::run`], which
/// is why no other crate can name them.
pub trait Lanes: Copy {
    /// Number of lanes.
    const WIDTH: usize;
    /// One condition per lane.
    type Mask: Mask;
    /// One 32-bit integer per lane.
    type Int: Int<Mask = Self::Mask>;

    /// Does a part of a kernel in a function of its own, compiled for the same instruction set. The compiler's time grows
    /// faster than the length of a function, so large kernels are divided where a call costs nothing, beside what it
    /// does. The closure is to be marked `#[inline(always)]`, as all that it calls.
    #[inline(never)]
    fn apart<T>(part: impl FnOnce() -> T) -> T {
        part()
    }

    /// The same number in every lane.
    fn splat(value: f32) -> Self;
    /// The first `WIDTH` numbers of a slice. Panics when there are fewer.
    fn load(from: &[f32]) -> Self;
    /// Into the first `WIDTH` places of a slice. Panics when there are fewer.
    fn store(self, to: &mut [f32]);
    /// The numbers of all lanes, where they are: for work on single lanes.
    fn numbers(&self) -> &[f32];
    /// The same, to change them.
    fn numbers_mut(&mut self) -> &mut [f32];
    /// self + other
    fn add(self, other: Self) -> Self;
    /// self + other where the condition holds, else self: self + other * (1 or 0) without the product.
    #[inline(always)]
    fn add_where(self, other: Self, condition: Self::Mask) -> Self {
        // Whatever is added to -0 stays what it is, to the sign of zeros.
        self.add(other.select(Self::splat(-0.0), condition))
    }
    /// self - other
    fn sub(self, other: Self) -> Self;
    /// self * other
    fn mul(self, other: Self) -> Self;
    /// The opposite sign, of zeros and NaN too.
    fn neg(self) -> Self;
    /// self / other
    fn div(self, other: Self) -> Self;
    /// The correctly rounded square root.
    fn sqrt(self) -> Self;
    /// `if self > limit { limit } else { self }`: a NaN passes.
    fn at_most(self, limit: Self) -> Self;
    /// `if self < limit { limit } else { self }`: a NaN passes.
    fn at_least(self, limit: Self) -> Self;
    /// self < other; false for NaN.
    fn lt(self, other: Self) -> Self::Mask;
    /// self <= other; false for NaN.
    fn le(self, other: Self) -> Self::Mask;
    /// Whether a lane is NaN.
    fn is_nan(self) -> Self::Mask;
    /// self where the condition holds, else other.
    fn select(self, other: Self, condition: Self::Mask) -> Self;
    /// The largest integer that is not greater, as an integer; lanes must lie well within 32 bits.
    fn floor(self) -> Self::Int;
    /// The integers as binary32.
    fn from_int(int: Self::Int) -> Self;
    /// The bits of the numbers as integers.
    fn pattern(self) -> Self::Int;
    /// The numbers with these bits.
    fn from_pattern(pattern: Self::Int) -> Self;
    /// Numbers that lie in rows, one for each lane, from the index `from` on: lane l of `columns[i]` becomes
    /// `rows[l][from + i]`. Panics when there are fewer rows than lanes or a row is too short.
    #[inline(always)]
    fn transpose(rows: &[&[f32]], from: usize, columns: &mut [Self]) {
        let mut lanes = [0.0; MOST_LANES_UNPAIRED];
        for (index, column) in columns.iter_mut().enumerate() {
            for lane in 0..Self::WIDTH {
                lanes[lane] = rows[lane][from + index];
            }
            *column = Self::load(&lanes);
        }
    }
    /// Four columns of sixteen words into rows that begin `stride` apart, `columns[i][row]` into `rows[row * stride + i]`. Panics when
    /// the last place lies outside.
    #[inline(always)]
    fn words_of_rows(columns: &[[u64; 16]; 4], rows: &mut [u64], stride: usize) {
        for row in 0..16 {
            let to = &mut rows[row * stride..][..4];
            for (slot, column) in to.iter_mut().zip(columns) {
                *slot = column[row];
            }
        }
    }
}

/// The number of a lane, which is below `WIDTH`. The compiler then knows that, so that work on the lane checks nothing.
#[inline(always)]
#[must_use]
pub const fn lane_of<L: Lanes>(number: u32) -> usize {
    number as usize % L::WIDTH
}

/// Has items brought into the nearest cache where the processor can do that.
#[inline(always)]
pub fn prefetch<T>(items: &[T]) {
    const CACHE_LINE: usize = 64;
    for _offset in (0..size_of_val(items)).step_by(CACHE_LINE) {
        #[cfg(target_arch = "x86_64")]
        x86::prefetch_line(items.as_ptr().cast::<u8>().wrapping_add(_offset));
    }
}

/// One condition per lane.
pub trait Mask: Copy {
    /// Bit i is the condition of lane i.
    fn bits(self) -> u64;
    /// The conditions in the lowest bits; those above do not count.
    fn from_bits(bits: u64) -> Self;
    /// Both hold.
    fn and(self, other: Self) -> Self;
    /// At least one holds.
    fn or(self, other: Self) -> Self;
    /// This holds and the other does not.
    fn and_not(self, other: Self) -> Self;
    /// Whether it holds in any lane.
    #[inline(always)]
    fn any(self) -> bool {
        self.bits() != 0
    }
}

/// One 32-bit integer per lane.
pub trait Int: Copy {
    /// One condition per lane.
    type Mask: Mask;
    /// The same integer in every lane.
    fn splat(value: i32) -> Self;
    /// The first `WIDTH` integers of a slice. Panics when there are fewer.
    fn load(from: &[i32]) -> Self;
    /// Into the first `WIDTH` places of a slice. Panics when there are fewer.
    fn store(self, to: &mut [i32]);
    /// self + other, wrapping.
    fn add(self, other: Self) -> Self;
    /// self - other, wrapping.
    fn sub(self, other: Self) -> Self;
    /// The low 32 bits of the product.
    fn mul(self, other: Self) -> Self;
    /// Bitwise and.
    fn and(self, other: Self) -> Self;
    /// Bitwise or.
    fn or(self, other: Self) -> Self;
    /// Bitwise exclusive or.
    fn xor(self, other: Self) -> Self;
    /// self shifted left by the other, 0 to 31.
    fn shl(self, other: Self) -> Self;
    /// self shifted right by the other, 0 to 31, zeros coming in.
    fn shr(self, other: Self) -> Self;
    /// self shifted right by the other, 0 to 31, copies of the sign coming in.
    fn shr_signed(self, other: Self) -> Self;
    /// self == other
    fn eq(self, other: Self) -> Self::Mask;
    /// self < other, signed.
    fn lt(self, other: Self) -> Self::Mask;
    /// self where the condition holds, else other.
    fn select(self, other: Self, condition: Self::Mask) -> Self;
    /// `table[self & 7]` per lane, without a look at memory.
    fn lookup_eight(self, table: &[i32; 8]) -> Self;
    /// `table[self]` per lane. Panics when a lane lies outside of the table.
    fn lookup(self, table: &[i32]) -> Self;
    /// `table[self]` where the condition holds, else `other`; memory is read only for those lanes if the processor can
    /// do that. Panics when any lane lies outside of the table.
    #[inline(always)]
    fn lookup_where(self, table: &[i32], other: Self, condition: Self::Mask) -> Self {
        self.lookup(table).select(other, condition)
    }
    /// The four bytes from `bytes[self]` on, the first one lowest, per lane. Panics when one of them lies outside.
    fn lookup_bytes(self, bytes: &[u8]) -> Self;
    /// As [`lookup_bytes`](Self::lookup_bytes) where the condition holds, else `other`: memory is read for those lanes alone
    /// where the processor can do that. Panics when the bytes of any lane lie outside.
    #[inline(always)]
    fn lookup_bytes_where(self, bytes: &[u8], other: Self, condition: Self::Mask) -> Self {
        self.lookup_bytes(bytes).select(other, condition)
    }
}
