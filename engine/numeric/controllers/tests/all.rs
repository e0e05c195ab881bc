//! The integration tests of this crate as one program: each program links the whole engine anew.

mod controller;
mod functions;
mod kinds;
mod lanes;
mod modules;
mod parameter_set;
mod python_modules;
mod specification;
mod team;
mod vectors;
