//! The integration tests of this crate as one program: each program links the whole engine anew.

mod emergency_exit;
mod emergency_exit_parts;
mod emergency_exit_vectors;
mod frevo;
mod lanes;
mod minisim;
mod minisim_parts;
mod pace;
mod parameters;
mod steering_rule;
mod taken;
mod teams;
mod text;
mod vectors;
