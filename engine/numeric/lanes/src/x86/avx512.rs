//! AVX-512: 16 lanes.

use std::arch::x86_64::*;

use crate::{Int, Lanes, Mask, in_order, level};

const WIDTH: usize = 16;

#[derive(Clone, Copy)]
pub struct F32s(__m512);

#[derive(Clone, Copy)]
pub struct I32s(__m512i);

#[derive(Clone, Copy)]
pub struct Conditions(__mmask16);

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
        simd!(level::avx512(part))
    }
    #[inline(always)]
    fn splat(value: f32) -> Self {
        Self(simd!(_mm512_set1_ps(value)))
    }
    #[inline(always)]
    fn load(from: &[f32]) -> Self {
        let from = &from[..WIDTH];
        Self(simd!(_mm512_loadu_ps(from.as_ptr())))
    }
    #[inline(always)]
    fn store(self, to: &mut [f32]) {
        let to = &mut to[..WIDTH];
        simd!(_mm512_storeu_ps(to.as_mut_ptr(), self.0));
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
        Self(simd!(_mm512_add_ps(self.0, other.0)))
    }
    #[inline(always)]
    fn add_where(self, other: Self, condition: Conditions) -> Self {
        Self(simd!(_mm512_mask_add_ps(
            self.0,
            condition.0,
            self.0,
            other.0
        )))
    }
    #[inline(always)]
    fn sub(self, other: Self) -> Self {
        Self(simd!(_mm512_sub_ps(self.0, other.0)))
    }
    #[inline(always)]
    fn mul(self, other: Self) -> Self {
        Self(simd!(_mm512_mul_ps(self.0, other.0)))
    }
    #[inline(always)]
    fn neg(self) -> Self {
        Self(simd!(_mm512_xor_ps(self.0, _mm512_set1_ps(-0.0))))
    }
    #[inline(always)]
    fn div(self, other: Self) -> Self {
        Self(simd!(_mm512_div_ps(self.0, other.0)))
    }
    #[inline(always)]
    fn sqrt(self) -> Self {
        Self(simd!(_mm512_sqrt_ps(self.0)))
    }
    #[inline(always)]
    fn at_most(self, limit: Self) -> Self {
        // MINPS is `first < second ? first : second`.
        Self(simd!(_mm512_min_ps(limit.0, self.0)))
    }
    #[inline(always)]
    fn at_least(self, limit: Self) -> Self {
        // MAXPS is `first > second ? first : second`.
        Self(simd!(_mm512_max_ps(limit.0, self.0)))
    }
    #[inline(always)]
    fn lt(self, other: Self) -> Conditions {
        Conditions(simd!(_mm512_cmp_ps_mask::<_CMP_LT_OQ>(self.0, other.0)))
    }
    #[inline(always)]
    fn le(self, other: Self) -> Conditions {
        Conditions(simd!(_mm512_cmp_ps_mask::<_CMP_LE_OQ>(self.0, other.0)))
    }
    #[inline(always)]
    fn is_nan(self) -> Conditions {
        Conditions(simd!(_mm512_cmp_ps_mask::<_CMP_UNORD_Q>(self.0, self.0)))
    }
    #[inline(always)]
    fn select(self, other: Self, condition: Conditions) -> Self {
        Self(simd!(_mm512_mask_blend_ps(condition.0, other.0, self.0)))
    }
    #[inline(always)]
    fn floor(self) -> I32s {
        let floor = simd!(_mm512_roundscale_ps::<
            { _MM_FROUND_TO_NEG_INF | _MM_FROUND_NO_EXC },
        >(self.0));
        I32s(simd!(_mm512_cvttps_epi32(floor)))
    }
    #[inline(always)]
    fn from_int(int: I32s) -> Self {
        Self(simd!(_mm512_cvtepi32_ps(int.0)))
    }
    #[inline(always)]
    fn pattern(self) -> I32s {
        I32s(simd!(_mm512_castps_si512(self.0)))
    }
    #[inline(always)]
    fn from_pattern(pattern: I32s) -> Self {
        Self(simd!(_mm512_castsi512_ps(pattern.0)))
    }
    #[inline(always)]
    fn transpose(rows: &[&[f32]], from: usize, columns: &mut [Self]) {
        for (tile, columns) in columns.chunks_mut(WIDTH).enumerate() {
            let mask = u16::MAX >> (WIDTH - columns.len());
            let mut square = [simd!(_mm512_setzero_ps()); WIDTH];
            for lane in 0..WIDTH {
                let row = &rows[lane][from + tile * WIDTH..][..columns.len()];
                square[lane] = simd!(_mm512_maskz_loadu_ps(mask, row.as_ptr()));
            }
            let square = transposed(square);
            for (index, column) in columns.iter_mut().enumerate() {
                *column = Self(square[index]);
            }
        }
    }
    #[inline(always)]
    fn words_of_rows(columns: &[[u64; 16]; 4], rows: &mut [u64], stride: usize) {
        words_of_rows(columns, rows, stride);
    }
}

/// 16 x 16 numbers: neighbours within pairs of rows, pairs within fours of rows, then blocks of four numbers.
#[inline(always)]
fn transposed(rows: [__m512; WIDTH]) -> [__m512; WIDTH] {
    let (mut pairs, mut fours, mut columns) = (rows, rows, rows);
    for i in (0..WIDTH).step_by(2) {
        pairs[i] = simd!(_mm512_unpacklo_ps(rows[i], rows[i + 1]));
        pairs[i + 1] = simd!(_mm512_unpackhi_ps(rows[i], rows[i + 1]));
    }
    for i in (0..WIDTH).step_by(4) {
        for half in 0..2 {
            let (a, b) = (pairs[i + half], pairs[i + half + 2]);
            let (a, b) = (simd!(_mm512_castps_pd(a)), simd!(_mm512_castps_pd(b)));
            fours[i + 2 * half] = simd!(_mm512_castpd_ps(_mm512_unpacklo_pd(a, b)));
            fours[i + 2 * half + 1] = simd!(_mm512_castpd_ps(_mm512_unpackhi_pd(a, b)));
        }
    }
    for i in 0..4 {
        let (a, b, c, d) = (fours[i], fours[i + 4], fours[i + 8], fours[i + 12]);
        let even = [
            simd!(_mm512_shuffle_f32x4::<0x88>(a, b)),
            simd!(_mm512_shuffle_f32x4::<0x88>(c, d)),
        ];
        let odd = [
            simd!(_mm512_shuffle_f32x4::<0xDD>(a, b)),
            simd!(_mm512_shuffle_f32x4::<0xDD>(c, d)),
        ];
        columns[i] = simd!(_mm512_shuffle_f32x4::<0x88>(even[0], even[1]));
        columns[i + 4] = simd!(_mm512_shuffle_f32x4::<0x88>(odd[0], odd[1]));
        columns[i + 8] = simd!(_mm512_shuffle_f32x4::<0xDD>(even[0], even[1]));
        columns[i + 12] = simd!(_mm512_shuffle_f32x4::<0xDD>(odd[0], odd[1]));
    }
    columns
}

/// Two gathers of eight lanes take half the time of one of sixteen (AMD Zen 5).
impl I32s {
    #[inline(always)]
    fn halves(self) -> (__m256i, __m256i) {
        (
            simd!(_mm512_castsi512_si256(self.0)),
            simd!(_mm512_extracti64x4_epi64::<1>(self.0)),
        )
    }

    #[inline(always)]
    fn assert_inside(self, table: &[i32]) {
        let length = i32::try_from(table.len()).unwrap_or(i32::MAX);
        let inside = simd!(_mm512_cmplt_epu32_mask(self.0, _mm512_set1_epi32(length)));
        assert!(inside == u16::MAX, "an index lies outside of the table");
    }

    #[inline(always)]
    fn assert_inside_bytes(self, bytes: &[u8]) {
        let length = i32::try_from(bytes.len().saturating_sub(3)).unwrap_or(i32::MAX);
        let inside = simd!(_mm512_cmplt_epu32_mask(self.0, _mm512_set1_epi32(length)));
        assert!(inside == u16::MAX, "an index lies outside of the bytes");
    }

    #[inline(always)]
    fn of_halves(low: __m256i, high: __m256i) -> Self {
        let low = simd!(_mm512_castsi256_si512(low));
        Self(simd!(_mm512_inserti64x4::<1>(low, high)))
    }
}

impl Mask for Conditions {
    #[inline(always)]
    fn bits(self) -> u64 {
        u64::from(self.0)
    }
    #[inline(always)]
    #[expect(clippy::cast_possible_truncation, reason = "16 lanes")]
    fn from_bits(bits: u64) -> Self {
        Self(bits as u16)
    }
    #[inline(always)]
    fn and(self, other: Self) -> Self {
        Self(self.0 & other.0)
    }
    #[inline(always)]
    fn or(self, other: Self) -> Self {
        Self(self.0 | other.0)
    }
    #[inline(always)]
    fn and_not(self, other: Self) -> Self {
        Self(self.0 & !other.0)
    }
}

impl Int for I32s {
    type Mask = Conditions;

    #[inline(always)]
    fn splat(value: i32) -> Self {
        Self(simd!(_mm512_set1_epi32(value)))
    }
    #[inline(always)]
    fn load(from: &[i32]) -> Self {
        let from = &from[..WIDTH];
        Self(simd!(_mm512_loadu_epi32(from.as_ptr())))
    }
    #[inline(always)]
    fn store(self, to: &mut [i32]) {
        let to = &mut to[..WIDTH];
        simd!(_mm512_storeu_epi32(to.as_mut_ptr(), self.0));
    }
    #[inline(always)]
    fn add(self, other: Self) -> Self {
        Self(simd!(_mm512_add_epi32(self.0, other.0)))
    }
    #[inline(always)]
    fn sub(self, other: Self) -> Self {
        Self(simd!(_mm512_sub_epi32(self.0, other.0)))
    }
    #[inline(always)]
    fn mul(self, other: Self) -> Self {
        Self(simd!(_mm512_mullo_epi32(self.0, other.0)))
    }
    #[inline(always)]
    fn and(self, other: Self) -> Self {
        Self(simd!(_mm512_and_epi32(self.0, other.0)))
    }
    #[inline(always)]
    fn or(self, other: Self) -> Self {
        Self(simd!(_mm512_or_epi32(self.0, other.0)))
    }
    #[inline(always)]
    fn xor(self, other: Self) -> Self {
        Self(simd!(_mm512_xor_epi32(self.0, other.0)))
    }
    #[inline(always)]
    fn shl(self, other: Self) -> Self {
        Self(simd!(_mm512_sllv_epi32(self.0, other.0)))
    }
    #[inline(always)]
    fn shr(self, other: Self) -> Self {
        Self(simd!(_mm512_srlv_epi32(self.0, other.0)))
    }
    #[inline(always)]
    fn shr_signed(self, other: Self) -> Self {
        Self(simd!(_mm512_srav_epi32(self.0, other.0)))
    }
    #[inline(always)]
    fn eq(self, other: Self) -> Conditions {
        Conditions(simd!(_mm512_cmpeq_epi32_mask(self.0, other.0)))
    }
    #[inline(always)]
    fn lt(self, other: Self) -> Conditions {
        Conditions(simd!(_mm512_cmplt_epi32_mask(self.0, other.0)))
    }
    #[inline(always)]
    fn select(self, other: Self, condition: Conditions) -> Self {
        Self(simd!(_mm512_mask_blend_epi32(condition.0, other.0, self.0)))
    }
    #[inline(always)]
    fn lookup_eight(self, table: &[i32; 8]) -> Self {
        // Four bits count in a table of sixteen.
        let table = simd!(_mm512_broadcast_i32x8(_mm256_loadu_si256(
            table.as_ptr().cast()
        )));
        Self(simd!(_mm512_permutexvar_epi32(self.0, table)))
    }
    #[inline(always)]
    fn lookup(self, table: &[i32]) -> Self {
        self.assert_inside(table);
        let (low, high) = self.halves();
        // SAFETY: every lane's index lies within the table, as asserted.
        let (low, high) = unsafe {
            (
                _mm256_i32gather_epi32::<4>(table.as_ptr(), low),
                _mm256_i32gather_epi32::<4>(table.as_ptr(), high),
            )
        };
        Self::of_halves(low, high)
    }
    #[inline(always)]
    #[expect(clippy::cast_possible_truncation, reason = "a half of the lanes")]
    fn lookup_where(self, table: &[i32], other: Self, condition: Conditions) -> Self {
        self.assert_inside(table);
        let (low, high) = self.halves();
        let (other_low, other_high) = other.halves();
        let (in_low, in_high) = (condition.0 as u8, (condition.0 >> 8) as u8);
        // SAFETY: every lane's index lies within the table, as asserted.
        let (low, high) = unsafe {
            (
                _mm256_mmask_i32gather_epi32::<4>(other_low, in_low, low, table.as_ptr()),
                _mm256_mmask_i32gather_epi32::<4>(other_high, in_high, high, table.as_ptr()),
            )
        };
        Self::of_halves(low, high)
    }
    #[inline(always)]
    fn lookup_bytes(self, bytes: &[u8]) -> Self {
        self.assert_inside_bytes(bytes);
        let (low, high) = self.halves();
        // SAFETY: every lane's four bytes lie within, as asserted.
        let (low, high) = unsafe {
            (
                _mm256_i32gather_epi32::<1>(bytes.as_ptr().cast(), low),
                _mm256_i32gather_epi32::<1>(bytes.as_ptr().cast(), high),
            )
        };
        Self::of_halves(low, high)
    }
    #[inline(always)]
    #[expect(clippy::cast_possible_truncation, reason = "a half of the lanes")]
    fn lookup_bytes_where(self, bytes: &[u8], other: Self, condition: Conditions) -> Self {
        self.assert_inside_bytes(bytes);
        let (low, high) = self.halves();
        let (other_low, other_high) = other.halves();
        let (in_low, in_high) = (condition.0 as u8, (condition.0 >> 8) as u8);
        let bytes = bytes.as_ptr().cast();
        // SAFETY: every lane's four bytes lie within, as asserted.
        let (low, high) = unsafe {
            (
                _mm256_mmask_i32gather_epi32::<1>(other_low, in_low, low, bytes),
                _mm256_mmask_i32gather_epi32::<1>(other_high, in_high, high, bytes),
            )
        };
        Self::of_halves(low, high)
    }
}

/// Four columns of sixteen words in rows that begin `stride` apart.
#[inline(always)]
fn words_of_rows(columns: &[[u64; 16]; 4], rows: &mut [u64], stride: usize) {
    assert!(rows.len() >= 4 && (rows.len() - 4) / 15 >= stride);
    for half in 0..2 {
        let mut words = [simd!(_mm512_setzero_si512()); 4];
        for (words, column) in words.iter_mut().zip(columns) {
            // SAFETY: both halves of sixteen words are there.
            *words = unsafe { _mm512_loadu_si512(column.as_ptr().add(8 * half).cast()) };
        }
        let [a, b, c, d] = words;
        // Rows 0, 2, 4, 6, and those between them, two words of each.
        let (low, high) = (
            [
                simd!(_mm512_unpacklo_epi64(a, b)),
                simd!(_mm512_unpacklo_epi64(c, d)),
            ],
            [
                simd!(_mm512_unpackhi_epi64(a, b)),
                simd!(_mm512_unpackhi_epi64(c, d)),
            ],
        );
        let (first, second) = (
            simd!(_mm512_setr_epi64(0, 1, 8, 9, 2, 3, 10, 11)),
            simd!(_mm512_setr_epi64(4, 5, 12, 13, 6, 7, 14, 15)),
        );
        for (odd, [ones, others]) in [low, high].into_iter().enumerate() {
            for (part, order) in [first, second].into_iter().enumerate() {
                let both = simd!(_mm512_permutex2var_epi64(ones, order, others));
                let row = 8 * half + 4 * part + odd;
                // SAFETY: four words of row 15 are there, as asserted, so those of the rows before are.
                unsafe {
                    let to = rows.as_mut_ptr().add(row * stride).cast();
                    _mm256_storeu_si256(to, _mm512_castsi512_si256(both));
                    let to = rows.as_mut_ptr().add((row + 2) * stride).cast();
                    _mm256_storeu_si256(to, _mm512_extracti64x4_epi64::<1>(both));
                }
            }
        }
    }
}
