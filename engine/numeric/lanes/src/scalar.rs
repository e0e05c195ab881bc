//! One lane: the plain numbers of Rust, for code that is written for lanes and runs one episode.

use crate::level::{self, Level};
use crate::{Int, Lanes, Mask};

/// Does a part of a kernel in a function of its own.
#[inline(never)]
fn portable<T>(part: impl FnOnce() -> T) -> T {
    part()
}

impl Lanes for f32 {
    const WIDTH: usize = 1;
    type Mask = bool;
    type Int = i32;

    /// With AVX2 where the processor has it: the compiler puts side by side what it can, and has more instructions for the rest.
    #[inline(always)]
    #[cfg_attr(target_arch = "x86_64", allow(unsafe_code))]
    fn apart<T>(part: impl FnOnce() -> T) -> T {
        #[cfg(target_arch = "x86_64")]
        if Level::best() >= Level::Avx2 {
            // SAFETY: the processor has the features that the function enables; `best` has only what it has.
            return unsafe { level::avx2(part) };
        }
        portable(part)
    }
    #[inline(always)]
    fn splat(value: f32) -> Self {
        value
    }
    #[inline(always)]
    fn load(from: &[f32]) -> Self {
        from[0]
    }
    #[inline(always)]
    fn store(self, to: &mut [f32]) {
        to[0] = self;
    }
    #[inline(always)]
    fn numbers(&self) -> &[f32] {
        std::slice::from_ref(self)
    }
    #[inline(always)]
    fn numbers_mut(&mut self) -> &mut [f32] {
        std::slice::from_mut(self)
    }
    #[inline(always)]
    fn add(self, other: Self) -> Self {
        self + other
    }
    #[inline(always)]
    fn sub(self, other: Self) -> Self {
        self - other
    }
    #[inline(always)]
    fn mul(self, other: Self) -> Self {
        self * other
    }
    #[inline(always)]
    fn neg(self) -> Self {
        -self
    }
    #[inline(always)]
    fn div(self, other: Self) -> Self {
        self / other
    }
    #[inline(always)]
    fn sqrt(self) -> Self {
        f32::sqrt(self)
    }
    #[inline(always)]
    fn at_most(self, limit: Self) -> Self {
        if self > limit { limit } else { self }
    }
    #[inline(always)]
    fn at_least(self, limit: Self) -> Self {
        if self < limit { limit } else { self }
    }
    #[inline(always)]
    fn lt(self, other: Self) -> bool {
        self < other
    }
    #[inline(always)]
    fn le(self, other: Self) -> bool {
        self <= other
    }
    #[inline(always)]
    fn is_nan(self) -> bool {
        f32::is_nan(self)
    }
    #[inline(always)]
    fn select(self, other: Self, condition: bool) -> Self {
        if condition { self } else { other }
    }
    #[inline(always)]
    fn floor(self) -> i32 {
        f32::floor(self) as i32
    }
    #[inline(always)]
    fn from_int(int: i32) -> Self {
        int as f32
    }
    #[inline(always)]
    #[expect(clippy::cast_possible_wrap, reason = "bits")]
    fn pattern(self) -> i32 {
        self.to_bits() as i32
    }
    #[inline(always)]
    #[expect(clippy::cast_sign_loss, reason = "bits")]
    fn from_pattern(pattern: i32) -> Self {
        f32::from_bits(pattern as u32)
    }
}

impl Mask for bool {
    #[inline(always)]
    fn bits(self) -> u64 {
        u64::from(self)
    }
    #[inline(always)]
    fn from_bits(bits: u64) -> Self {
        bits & 1 == 1
    }
    #[inline(always)]
    fn and(self, other: Self) -> Self {
        self & other
    }
    #[inline(always)]
    fn or(self, other: Self) -> Self {
        self | other
    }
    #[inline(always)]
    fn and_not(self, other: Self) -> Self {
        self & !other
    }
}

#[expect(
    clippy::cast_sign_loss,
    clippy::cast_possible_wrap,
    reason = "bits; a negative index lies outside of any table"
)]
impl Int for i32 {
    type Mask = bool;

    #[inline(always)]
    fn splat(value: i32) -> Self {
        value
    }
    #[inline(always)]
    fn load(from: &[i32]) -> Self {
        from[0]
    }
    #[inline(always)]
    fn store(self, to: &mut [i32]) {
        to[0] = self;
    }
    #[inline(always)]
    fn add(self, other: Self) -> Self {
        self.wrapping_add(other)
    }
    #[inline(always)]
    fn sub(self, other: Self) -> Self {
        self.wrapping_sub(other)
    }
    #[inline(always)]
    fn mul(self, other: Self) -> Self {
        self.wrapping_mul(other)
    }
    #[inline(always)]
    fn and(self, other: Self) -> Self {
        self & other
    }
    #[inline(always)]
    fn or(self, other: Self) -> Self {
        self | other
    }
    #[inline(always)]
    fn xor(self, other: Self) -> Self {
        self ^ other
    }
    #[inline(always)]
    fn shl(self, other: Self) -> Self {
        self << (other & 31)
    }
    #[inline(always)]
    fn shr(self, other: Self) -> Self {
        (self as u32 >> (other & 31)) as i32
    }
    #[inline(always)]
    fn shr_signed(self, other: Self) -> Self {
        self >> (other & 31)
    }
    #[inline(always)]
    fn eq(self, other: Self) -> bool {
        self == other
    }
    #[inline(always)]
    fn lt(self, other: Self) -> bool {
        self < other
    }
    #[inline(always)]
    fn select(self, other: Self, condition: bool) -> Self {
        if condition { self } else { other }
    }
    #[inline(always)]
    fn lookup_eight(self, table: &[i32; 8]) -> Self {
        table[(self & 7) as usize]
    }
    #[inline(always)]
    fn lookup(self, table: &[i32]) -> Self {
        table[self as usize]
    }
    #[inline(always)]
    fn lookup_bytes(self, bytes: &[u8]) -> Self {
        let four = &bytes[self as usize..][..4];
        i32::from_le_bytes([four[0], four[1], four[2], four[3]])
    }
}
