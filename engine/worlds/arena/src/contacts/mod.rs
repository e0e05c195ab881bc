//! Motion and contacts in a tick.
//!
//! `tests/contacts_parts.rs` compiles parts of this folder with other robots and places around it, so paths in it are relative.

mod contact;
mod gap;
mod grip;
pub(crate) mod near;
mod objects;
mod pairs;
pub(crate) mod solver;
pub(crate) mod walls;
