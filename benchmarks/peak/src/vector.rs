//! Streams of vector operations.

use std::hint::black_box;
use swarmwright_lanes::{Int, Kernel, Lanes};

/// Independent streams: enough to hide latency, few enough for 16 registers.
const STREAMS: usize = 12;
const TIMES: u64 = 4000;

/// Alternately a multiplication and an addition.
pub struct MultiplyAdd;
/// Divisions.
pub struct Divide;
/// Square roots.
pub struct SquareRoot;
/// Alternately an addition and a conjunction of integers.
pub struct Integer;

/// Numbers that the compiler knows nothing about.
#[inline(always)]
fn unknown<L: Lanes>(value: f32) -> L {
    L::splat(black_box(value))
}

/// Streams that differ, or the compiler would compute one of them for all.
#[inline(always)]
fn streams<L: Lanes>(start: f32) -> [L; STREAMS] {
    let mut streams = [L::splat(0.0); STREAMS];
    for (index, stream) in (0_u8..).zip(&mut streams) {
        *stream = unknown(start + f32::from(index) * 0.37);
    }
    streams
}

/// Makes the compiler believe that the streams are needed.
#[inline(always)]
fn used<L: Lanes>(streams: [L; STREAMS]) {
    let mut lanes = [0.0; 16];
    for stream in streams {
        stream.store(&mut lanes);
        black_box(&lanes);
    }
}

impl Kernel for MultiplyAdd {
    type Output = u64;

    #[inline(always)]
    fn run<L: Lanes>(self) -> u64 {
        let (factor, term): (L, L) = (unknown(0.5), unknown(1.0));
        let mut streams = streams::<L>(1.5);
        for _ in 0..TIMES {
            for stream in &mut streams {
                *stream = stream.mul(factor).add(term);
            }
        }
        used(streams);
        TIMES * 2 * STREAMS as u64
    }
}

impl Kernel for Divide {
    type Output = u64;

    #[inline(always)]
    fn run<L: Lanes>(self) -> u64 {
        let over: L = unknown(1.5);
        let mut streams = streams::<L>(1.25);
        for _ in 0..TIMES {
            for stream in &mut streams {
                *stream = over.div(*stream);
            }
        }
        used(streams);
        TIMES * STREAMS as u64
    }
}

impl Kernel for SquareRoot {
    type Output = u64;

    #[inline(always)]
    fn run<L: Lanes>(self) -> u64 {
        let mut streams = streams::<L>(1e30);
        for _ in 0..TIMES {
            for stream in &mut streams {
                *stream = stream.sqrt();
            }
        }
        used(streams);
        TIMES * STREAMS as u64
    }
}

impl Kernel for Integer {
    type Output = u64;

    #[inline(always)]
    fn run<L: Lanes>(self) -> u64 {
        let (term, bits) = (
            L::Int::splat(black_box(3)),
            L::Int::splat(black_box(0xFF_FFFF)),
        );
        let mut streams = [L::Int::splat(0); STREAMS];
        for (index, stream) in (0..).zip(&mut streams) {
            *stream = L::Int::splat(black_box(index));
        }
        for _ in 0..TIMES {
            for stream in &mut streams {
                *stream = stream.add(term).and(bits);
            }
        }
        for stream in streams {
            used([L::from_int(stream); STREAMS]);
        }
        TIMES * 2 * STREAMS as u64
    }
}
