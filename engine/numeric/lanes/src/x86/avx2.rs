//! AVX2: 8 lanes.

use std::arch::x86_64::*;

use crate::{Int, Lanes, Mask, in_order, level};

const WIDTH: usize = 8;

#[derive(Clone, Copy)]
pub struct F32s(__m256);

#[derive(Clone, Copy)]
pub struct I32s(__m256i);

/// All bits of a lane, or none.
#[derive(Clone, Copy)]
pub struct Conditions(__m256);

/// Calls an intrinsic. SAFETY: see the module above.
macro_rules! simd {
    ($call:expr) => {
        // SAFETY: the processor has the instruction set, see the module above.
        unsafe { $call }
    };
}

impl Lanes for F32s {
    const WIDTH: usize = WIDTH;
    type Mask = Conditions;
    type Int = I32s;

    #[inline(always)]
    fn apart<T>(part: impl FnOnce() -> T) -> T {
        simd!(level::avx2(part))
    }
    #[inline(always)]
    fn splat(value: f32) -> Self {
        Self(simd!(_mm256_set1_ps(value)))
    }
    #[inline(always)]
    fn load(from: &[f32]) -> Self {
        let from = &from[..WIDTH];
        Self(simd!(_mm256_loadu_ps(from.as_ptr())))
    }
    #[inline(always)]
    fn store(self, to: &mut [f32]) {
        let to = &mut to[..WIDTH];
        simd!(_mm256_storeu_ps(to.as_mut_ptr(), self.0));
    }
    #[inline(always)]
    fn numbers(&self) -> &[f32] {
        in_order::numbers(self)
    }
    #[inline(always)]
    fn numbers_mut(&mut self) -> &mut [f32] {
        in_order::numbers_mut(self)
    }
    #[inline(always)]
    fn add(self, other: Self) -> Self {
        Self(simd!(_mm256_add_ps(self.0, other.0)))
    }
    #[inline(always)]
    fn sub(self, other: Self) -> Self {
        Self(simd!(_mm256_sub_ps(self.0, other.0)))
    }
    #[inline(always)]
    fn mul(self, other: Self) -> Self {
        Self(simd!(_mm256_mul_ps(self.0, other.0)))
    }
    #[inline(always)]
    fn neg(self) -> Self {
        Self(simd!(_mm256_xor_ps(self.0, _mm256_set1_ps(-0.0))))
    }
    #[inline(always)]
    fn div(self, other: Self) -> Self {
        Self(simd!(_mm256_div_ps(self.0, other.0)))
    }
    #[inline(always)]
    fn sqrt(self) -> Self {
        Self(simd!(_mm256_sqrt_ps(self.0)))
    }
    #[inline(always)]
    fn at_most(self, limit: Self) -> Self {
        // MINPS is `first < second ? first : second`.
        Self(simd!(_mm256_min_ps(limit.0, self.0)))
    }
    #[inline(always)]
    fn at_least(self, limit: Self) -> Self {
        // MAXPS is `first > second ? first : second`.
        Self(simd!(_mm256_max_ps(limit.0, self.0)))
    }
    #[inline(always)]
    fn lt(self, other: Self) -> Conditions {
        Conditions(simd!(_mm256_cmp_ps::<_CMP_LT_OQ>(self.0, other.0)))
    }
    #[inline(always)]
    fn le(self, other: Self) -> Conditions {
        Conditions(simd!(_mm256_cmp_ps::<_CMP_LE_OQ>(self.0, other.0)))
    }
    #[inline(always)]
    fn is_nan(self) -> Conditions {
        Conditions(simd!(_mm256_cmp_ps::<_CMP_UNORD_Q>(self.0, self.0)))
    }
    #[inline(always)]
    fn select(self, other: Self, condition: Conditions) -> Self {
        Self(simd!(_mm256_blendv_ps(other.0, self.0, condition.0)))
    }
    #[inline(always)]
    fn floor(self) -> I32s {
        I32s(simd!(_mm256_cvttps_epi32(_mm256_floor_ps(self.0))))
    }
    #[inline(always)]
    fn from_int(int: I32s) -> Self {
        Self(simd!(_mm256_cvtepi32_ps(int.0)))
    }
    #[inline(always)]
    fn pattern(self) -> I32s {
        I32s(simd!(_mm256_castps_si256(self.0)))
    }
    #[inline(always)]
    fn from_pattern(pattern: I32s) -> Self {
        Self(simd!(_mm256_castsi256_ps(pattern.0)))
    }
}

impl Mask for Conditions {
    #[inline(always)]
    #[expect(clippy::cast_sign_loss, reason = "8 bits")]
    fn bits(self) -> u64 {
        simd!(_mm256_movemask_ps(self.0)) as u64
    }
    #[inline(always)]
    fn from_bits(bits: u64) -> Self {
        let bit = simd!(_mm256_setr_epi32(1, 2, 4, 8, 16, 32, 64, 128));
        let set = simd!(_mm256_and_si256(_mm256_set1_epi32(bits as i32), bit));
        Self(simd!(_mm256_castsi256_ps(_mm256_cmpeq_epi32(set, bit))))
    }
    #[inline(always)]
    fn and(self, other: Self) -> Self {
        Self(simd!(_mm256_and_ps(self.0, other.0)))
    }
    #[inline(always)]
    fn or(self, other: Self) -> Self {
        Self(simd!(_mm256_or_ps(self.0, other.0)))
    }
    #[inline(always)]
    fn and_not(self, other: Self) -> Self {
        Self(simd!(_mm256_andnot_ps(other.0, self.0)))
    }
}

impl I32s {
    #[inline(always)]
    #[expect(
        clippy::cast_sign_loss,
        reason = "a negative index lies outside of any table"
    )]
    fn assert_inside(self, table: &[i32]) {
        let mut indices = [0; WIDTH];
        self.store(&mut indices);
        assert!(
            indices
                .iter()
                .all(|&index| (index as u32 as usize) < table.len()),
            "an index lies outside of the table"
        );
    }

    #[inline(always)]
    #[expect(clippy::cast_possible_wrap, reason = "compared without a sign")]
    fn assert_inside_bytes(self, bytes: &[u8]) {
        let last = bytes
            .len()
            .checked_sub(4)
            .and_then(|last| u32::try_from(last).ok());
        let last = simd!(_mm256_set1_epi32(last.unwrap_or(0) as i32));
        let inside = simd!(_mm256_cmpeq_epi32(_mm256_min_epu32(self.0, last), self.0));
        assert!(
            bytes.len() >= 4 && simd!(_mm256_movemask_epi8(inside)) == -1,
            "an index lies outside of the bytes"
        );
    }
}

impl Int for I32s {
    type Mask = Conditions;

    #[inline(always)]
    fn splat(value: i32) -> Self {
        Self(simd!(_mm256_set1_epi32(value)))
    }
    #[inline(always)]
    fn load(from: &[i32]) -> Self {
        let from = &from[..WIDTH];
        Self(simd!(_mm256_loadu_si256(from.as_ptr().cast())))
    }
    #[inline(always)]
    fn store(self, to: &mut [i32]) {
        let to = &mut to[..WIDTH];
        simd!(_mm256_storeu_si256(to.as_mut_ptr().cast(), self.0));
    }
    #[inline(always)]
    fn add(self, other: Self) -> Self {
        Self(simd!(_mm256_add_epi32(self.0, other.0)))
    }
    #[inline(always)]
    fn sub(self, other: Self) -> Self {
        Self(simd!(_mm256_sub_epi32(self.0, other.0)))
    }
    #[inline(always)]
    fn mul(self, other: Self) -> Self {
        Self(simd!(_mm256_mullo_epi32(self.0, other.0)))
    }
    #[inline(always)]
    fn and(self, other: Self) -> Self {
        Self(simd!(_mm256_and_si256(self.0, other.0)))
    }
    #[inline(always)]
    fn or(self, other: Self) -> Self {
        Self(simd!(_mm256_or_si256(self.0, other.0)))
    }
    #[inline(always)]
    fn xor(self, other: Self) -> Self {
        Self(simd!(_mm256_xor_si256(self.0, other.0)))
    }
    #[inline(always)]
    fn shl(self, other: Self) -> Self {
        Self(simd!(_mm256_sllv_epi32(self.0, other.0)))
    }
    #[inline(always)]
    fn shr(self, other: Self) -> Self {
        Self(simd!(_mm256_srlv_epi32(self.0, other.0)))
    }
    #[inline(always)]
    fn shr_signed(self, other: Self) -> Self {
        Self(simd!(_mm256_srav_epi32(self.0, other.0)))
    }
    #[inline(always)]
    fn eq(self, other: Self) -> Conditions {
        Conditions(simd!(_mm256_castsi256_ps(_mm256_cmpeq_epi32(
            self.0, other.0
        ))))
    }
    #[inline(always)]
    fn lt(self, other: Self) -> Conditions {
        Conditions(simd!(_mm256_castsi256_ps(_mm256_cmpgt_epi32(
            other.0, self.0
        ))))
    }
    #[inline(always)]
    fn select(self, other: Self, condition: Conditions) -> Self {
        let mask = simd!(_mm256_castps_si256(condition.0));
        Self(simd!(_mm256_blendv_epi8(other.0, self.0, mask)))
    }
    #[inline(always)]
    fn lookup_eight(self, table: &[i32; 8]) -> Self {
        Self(simd!(_mm256_permutevar8x32_epi32(
            _mm256_loadu_si256(table.as_ptr().cast()),
            self.0
        )))
    }
    #[inline(always)]
    fn lookup(self, table: &[i32]) -> Self {
        self.assert_inside(table);
        // SAFETY: every lane's index lies within the table, as asserted.
        Self(unsafe { _mm256_i32gather_epi32::<4>(table.as_ptr(), self.0) })
    }
    #[inline(always)]
    fn lookup_where(self, table: &[i32], other: Self, condition: Conditions) -> Self {
        self.assert_inside(table);
        // SAFETY: every lane's index lies within the table, as asserted.
        Self(unsafe {
            let mask = _mm256_castps_si256(condition.0);
            _mm256_mask_i32gather_epi32::<4>(other.0, table.as_ptr(), self.0, mask)
        })
    }
    #[inline(always)]
    fn lookup_bytes(self, bytes: &[u8]) -> Self {
        self.assert_inside_bytes(bytes);
        // SAFETY: every lane's four bytes lie within, as asserted.
        Self(unsafe { _mm256_i32gather_epi32::<1>(bytes.as_ptr().cast(), self.0) })
    }
    #[inline(always)]
    fn lookup_bytes_where(self, bytes: &[u8], other: Self, condition: Conditions) -> Self {
        self.assert_inside_bytes(bytes);
        // SAFETY: every lane's four bytes lie within, as asserted.
        Self(unsafe {
            let mask = _mm256_castps_si256(condition.0);
            _mm256_mask_i32gather_epi32::<1>(other.0, bytes.as_ptr().cast(), self.0, mask)
        })
    }
}
