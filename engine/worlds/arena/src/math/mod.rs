//! Functions, random numbers and plane geometry as fixed sequences of operations.

pub mod functions;
pub mod polygon;
pub mod random;
