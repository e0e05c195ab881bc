//! Functions, random numbers and plane geometry as fixed sequences of operations.

pub(crate) mod functions;
pub(crate) mod polygon;
pub(crate) mod random;
