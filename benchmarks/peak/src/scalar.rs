//! Loads and stores of four bytes, in a buffer that fits the first-level cache.

use std::hint::black_box;

/// 16 KiB.
const LENGTH: usize = 4096;
const TIMES: u64 = 16;

/// Loads.
#[allow(unsafe_code)]
pub fn loads() -> u64 {
    let buffer = black_box(vec![1_u32; LENGTH]);
    for _ in 0..TIMES {
        for eight in buffer.chunks_exact(8) {
            for number in eight {
                // SAFETY: a reference is a valid address. Volatile, so that each load stays and stays alone.
                unsafe { std::ptr::read_volatile(number) };
            }
        }
    }
    TIMES * LENGTH as u64
}

/// Stores.
#[allow(unsafe_code)]
pub fn stores() -> u64 {
    let mut buffer = black_box(vec![1_u32; LENGTH]);
    for _ in 0..TIMES {
        for eight in buffer.chunks_exact_mut(8) {
            for number in eight {
                // SAFETY: as above.
                unsafe { std::ptr::write_volatile(number, 2) };
            }
        }
    }
    black_box(&buffer);
    TIMES * LENGTH as u64
}
