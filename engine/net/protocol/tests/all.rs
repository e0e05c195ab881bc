//! Integration tests of this crate as one program, since each program links the whole engine anew.

mod extension;
mod fields;
mod modules;
mod reasons;
mod vectors;
