//! Vectors that lie in memory as their numbers do, lane after lane.
#![allow(unsafe_code)]

use crate::Lanes;

/// The numbers of a vector type that holds nothing else.
#[inline(always)]
pub fn numbers<L: Lanes>(vector: &L) -> &[f32] {
    const { assert!(size_of::<L>() == L::WIDTH * size_of::<f32>()) };
    // SAFETY: as large as its numbers, so that there is nothing between them, and borrowed as long as the slice.
    unsafe { std::slice::from_raw_parts(std::ptr::from_ref(vector).cast(), L::WIDTH) }
}

/// The same, to change them.
#[inline(always)]
pub fn numbers_mut<L: Lanes>(vector: &mut L) -> &mut [f32] {
    const { assert!(size_of::<L>() == L::WIDTH * size_of::<f32>()) };
    // SAFETY: as above; any bits are a number.
    unsafe { std::slice::from_raw_parts_mut(std::ptr::from_mut(vector).cast(), L::WIDTH) }
}
