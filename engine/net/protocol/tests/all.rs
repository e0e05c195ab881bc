//! The integration tests of this crate as one program: each program links the whole engine anew.

mod extension;
mod fields;
mod modules;
mod reasons;
mod vectors;
