//! Instruction sets of x86-64 beyond SSE2.
//!
//! The types are private to this crate and made only inside [`crate::Level::run`], after the processor was asked; every
//! `unsafe` below relies on that, and on the bounds checked beside it.
#![allow(unsafe_code)]

pub mod avx2;
pub mod avx512;
