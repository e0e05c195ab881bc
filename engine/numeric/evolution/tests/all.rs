//! The integration tests of this crate as one program: each program links the whole engine anew.

mod cma;
mod differential;
mod eigen;
mod exact;
mod growing;
mod matrix;
mod network;
mod normal;
mod philox;
mod sampling;
mod selection;
mod shaping;
mod swarm;
