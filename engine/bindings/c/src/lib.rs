//! The simulation wrapper for C and whatever speaks to C; `include/swarmwright/swarmwright.h` is its documentation.
//!
//! Nothing unwinds out of here: every function is [shielded](error::shield). Nothing is allocated on one side and freed on
//! the other. What a function was told wrong, or could not do, is kept for its thread as [`error`] says.
#![allow(unsafe_code)] // the ABI is made of pointers; each use says why it holds
#![warn(clippy::undocumented_unsafe_blocks)]

use std::ffi::c_char;

mod callbacks;
mod description;
mod error;
mod foreign;
mod input;
mod live;
mod options;
mod parallel;
mod parameters;
mod physics;
mod plugin;
mod scene;
mod server;

/// Version of the ABI: what a caller was compiled against is to be the same.
pub const ABI: u32 = 1;

/// The version of the ABI that the library has.
#[unsafe(no_mangle)]
pub extern "C" fn swarmwright_abi() -> u32 {
    ABI
}

/// The library's version as text.
#[unsafe(no_mangle)]
pub extern "C" fn swarmwright_version() -> *const c_char {
    const VERSION: &str = concat!(env!("CARGO_PKG_VERSION"), "\0");
    VERSION.as_ptr().cast()
}
