//! Four lanes in plain Rust; the compiler turns them into SSE2 or NEON.

use crate::{Int, Lanes, Mask};

const WIDTH: usize = 4;

#[derive(Clone, Copy)]
#[repr(align(16))]
pub struct F32s([f32; WIDTH]);

#[derive(Clone, Copy)]
#[repr(align(16))]
pub struct I32s([i32; WIDTH]);

#[derive(Clone, Copy)]
pub struct Conditions([bool; WIDTH]);

#[inline(always)]
fn each<A: Copy, B: Copy, C>(a: [A; WIDTH], b: [B; WIDTH], f: impl Fn(A, B) -> C) -> [C; WIDTH] {
    std::array::from_fn(|lane| f(a[lane], b[lane]))
}

#[inline(always)]
fn choose<A: Copy>(yes: [A; WIDTH], no: [A; WIDTH], condition: Conditions) -> [A; WIDTH] {
    std::array::from_fn(|lane| {
        if condition.0[lane] {
            yes[lane]
        } else {
            no[lane]
        }
    })
}

impl Lanes for F32s {
    const WIDTH: usize = WIDTH;
    type Mask = Conditions;
    type Int = I32s;

    #[inline(always)]
    fn splat(value: f32) -> Self {
        Self([value; WIDTH])
    }
    #[inline(always)]
    fn load(from: &[f32]) -> Self {
        Self(std::array::from_fn(|lane| from[..WIDTH][lane]))
    }
    #[inline(always)]
    fn store(self, to: &mut [f32]) {
        to[..WIDTH].copy_from_slice(&self.0);
    }
    fn numbers(&self) -> &[f32] {
        &self.0
    }
    fn numbers_mut(&mut self) -> &mut [f32] {
        &mut self.0
    }
    #[inline(always)]
    fn add(self, other: Self) -> Self {
        Self(each(self.0, other.0, |a, b| a + b))
    }
    #[inline(always)]
    fn sub(self, other: Self) -> Self {
        Self(each(self.0, other.0, |a, b| a - b))
    }
    #[inline(always)]
    fn mul(self, other: Self) -> Self {
        Self(each(self.0, other.0, |a, b| a * b))
    }
    #[inline(always)]
    fn neg(self) -> Self {
        Self(self.0.map(|a| -a))
    }
    #[inline(always)]
    fn div(self, other: Self) -> Self {
        Self(each(self.0, other.0, |a, b| a / b))
    }
    #[inline(always)]
    fn sqrt(self) -> Self {
        Self(self.0.map(f32::sqrt))
    }
    #[inline(always)]
    fn at_most(self, limit: Self) -> Self {
        Self(each(self.0, limit.0, |a, b| if a > b { b } else { a }))
    }
    #[inline(always)]
    fn at_least(self, limit: Self) -> Self {
        Self(each(self.0, limit.0, |a, b| if a < b { b } else { a }))
    }
    #[inline(always)]
    fn lt(self, other: Self) -> Conditions {
        Conditions(each(self.0, other.0, |a, b| a < b))
    }
    #[inline(always)]
    fn le(self, other: Self) -> Conditions {
        Conditions(each(self.0, other.0, |a, b| a <= b))
    }
    #[inline(always)]
    fn is_nan(self) -> Conditions {
        Conditions(self.0.map(f32::is_nan))
    }
    #[inline(always)]
    fn select(self, other: Self, condition: Conditions) -> Self {
        Self(choose(self.0, other.0, condition))
    }
    #[inline(always)]
    #[expect(
        clippy::cast_possible_truncation,
        reason = "lanes lie well within 32 bits"
    )]
    fn floor(self) -> I32s {
        I32s(self.0.map(|a| a.floor() as i32))
    }
    #[inline(always)]
    #[expect(
        clippy::cast_precision_loss,
        reason = "rounded to nearest, as by the other instruction sets"
    )]
    fn from_int(int: I32s) -> Self {
        Self(int.0.map(|a| a as f32))
    }
    #[inline(always)]
    #[expect(clippy::cast_possible_wrap, reason = "bits")]
    fn pattern(self) -> I32s {
        I32s(self.0.map(|a| a.to_bits() as i32))
    }
    #[inline(always)]
    #[expect(clippy::cast_sign_loss, reason = "bits")]
    fn from_pattern(pattern: I32s) -> Self {
        Self(pattern.0.map(|a| f32::from_bits(a as u32)))
    }
}

impl Mask for Conditions {
    #[inline(always)]
    fn bits(self) -> u64 {
        (0..WIDTH).fold(0, |bits, lane| bits | u64::from(self.0[lane]) << lane)
    }
    #[inline(always)]
    fn from_bits(bits: u64) -> Self {
        Self(std::array::from_fn(|lane| bits >> lane & 1 == 1))
    }
    #[inline(always)]
    fn and(self, other: Self) -> Self {
        Self(each(self.0, other.0, |a, b| a & b))
    }
    #[inline(always)]
    fn or(self, other: Self) -> Self {
        Self(each(self.0, other.0, |a, b| a | b))
    }
    #[inline(always)]
    fn and_not(self, other: Self) -> Self {
        Self(each(self.0, other.0, |a, b| a & !b))
    }
}

impl Int for I32s {
    type Mask = Conditions;

    #[inline(always)]
    fn splat(value: i32) -> Self {
        Self([value; WIDTH])
    }
    #[inline(always)]
    fn load(from: &[i32]) -> Self {
        Self(std::array::from_fn(|lane| from[..WIDTH][lane]))
    }
    #[inline(always)]
    fn store(self, to: &mut [i32]) {
        to[..WIDTH].copy_from_slice(&self.0);
    }
    #[inline(always)]
    fn add(self, other: Self) -> Self {
        Self(each(self.0, other.0, i32::wrapping_add))
    }
    #[inline(always)]
    fn sub(self, other: Self) -> Self {
        Self(each(self.0, other.0, i32::wrapping_sub))
    }
    #[inline(always)]
    fn mul(self, other: Self) -> Self {
        Self(each(self.0, other.0, i32::wrapping_mul))
    }
    #[inline(always)]
    fn and(self, other: Self) -> Self {
        Self(each(self.0, other.0, |a, b| a & b))
    }
    #[inline(always)]
    fn or(self, other: Self) -> Self {
        Self(each(self.0, other.0, |a, b| a | b))
    }
    #[inline(always)]
    fn xor(self, other: Self) -> Self {
        Self(each(self.0, other.0, |a, b| a ^ b))
    }
    #[inline(always)]
    fn shl(self, other: Self) -> Self {
        Self(each(self.0, other.0, |a, b| a << (b & 31)))
    }
    #[inline(always)]
    #[expect(clippy::cast_sign_loss, clippy::cast_possible_wrap, reason = "bits")]
    fn shr(self, other: Self) -> Self {
        Self(each(self.0, other.0, |a, b| (a as u32 >> (b & 31)) as i32))
    }
    #[inline(always)]
    fn shr_signed(self, other: Self) -> Self {
        Self(each(self.0, other.0, |a, b| a >> (b & 31)))
    }
    #[inline(always)]
    fn eq(self, other: Self) -> Conditions {
        Conditions(each(self.0, other.0, |a, b| a == b))
    }
    #[inline(always)]
    fn lt(self, other: Self) -> Conditions {
        Conditions(each(self.0, other.0, |a, b| a < b))
    }
    #[inline(always)]
    fn select(self, other: Self, condition: Conditions) -> Self {
        Self(choose(self.0, other.0, condition))
    }
    #[inline(always)]
    #[expect(clippy::cast_sign_loss, reason = "three bits")]
    fn lookup_eight(self, table: &[i32; 8]) -> Self {
        Self(self.0.map(|index| table[(index & 7) as usize]))
    }
    #[inline(always)]
    #[expect(
        clippy::cast_sign_loss,
        reason = "a negative index lies outside of any table"
    )]
    fn lookup(self, table: &[i32]) -> Self {
        Self(self.0.map(|index| table[index as usize]))
    }
    #[inline(always)]
    #[expect(clippy::cast_sign_loss, reason = "as above")]
    fn lookup_bytes(self, bytes: &[u8]) -> Self {
        Self(self.0.map(|index| {
            let four = &bytes[index as usize..][..4];
            i32::from_le_bytes([four[0], four[1], four[2], four[3]])
        }))
    }
}
