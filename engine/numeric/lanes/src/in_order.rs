//! Vectors that lie in memory as their numbers do, lane after lane: those of instruction sets, and pairs of vectors.
#![allow(unsafe_code)]

use crate::Lanes;

/// The numbers of a vector type that holds nothing else.
#[inline(always)]
pub fn numbers<L: Lanes>(vector: &L) -> &[f32] {
    const { assert!(size_of::<L>() == L::WIDTH * size_of::<f32>()) };
    // SAFETY: the vector is its numbers and, as it is as large as they are, nothing else: no byte of it is undefined. It is
    // borrowed as long as the slice.
    unsafe { std::slice::from_raw_parts(std::ptr::from_ref(vector).cast(), L::WIDTH) }
}

/// The same, to change them.
#[inline(always)]
pub fn numbers_mut<L: Lanes>(vector: &mut L) -> &mut [f32] {
    const { assert!(size_of::<L>() == L::WIDTH * size_of::<f32>()) };
    // SAFETY: as above; any bits are a number.
    unsafe { std::slice::from_raw_parts_mut(std::ptr::from_mut(vector).cast(), L::WIDTH) }
}
