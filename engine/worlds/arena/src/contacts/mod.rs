//! Motion and contacts in a tick.
//!
//! `tests/contacts_parts.rs` compiles parts of this folder with substitutes for robots and places, so paths are
//! relative.

mod contact;
mod gap;
mod grip;
pub mod near;
mod objects;
mod pairs;
pub mod solver;
pub mod walls;
