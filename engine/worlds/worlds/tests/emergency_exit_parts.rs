//! Tests of Emergency Exit's private parts, compiled here as those of Minisim.

#![allow(dead_code, clippy::unwrap_used, reason = "only their tests are wanted")]

#[path = "../src/emergency_exit/nearest.rs"]
mod nearest;
#[path = "../src/emergency_exit/random.rs"]
mod random;

mod field {
    /// As in the library.
    pub type Cell = [u32; 2];
}
