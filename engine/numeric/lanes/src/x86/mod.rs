//! Instruction sets of x86-64 beyond SSE2.
//!
//! The types are private to this crate and made only inside [`crate::Level::run`], after the processor was asked; every
//! `unsafe` below relies on that, and on the bounds checked beside it.
#![allow(unsafe_code)]

use std::arch::x86_64::{_MM_HINT_T0, _mm_prefetch};

#[cfg_attr(not(level_avx2), allow(dead_code))]
pub mod avx2;
#[cfg_attr(not(level_avx512), allow(dead_code))]
pub mod avx512;

/// Asks for the cache line of a byte.
#[inline(always)]
pub fn prefetch_line(byte: *const u8) {
    // SAFETY: a hint, which reads nothing as far as the program can tell, wherever it points.
    unsafe { _mm_prefetch::<_MM_HINT_T0>(byte.cast()) }
}
