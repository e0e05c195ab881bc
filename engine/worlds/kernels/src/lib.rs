//! The episodes of the arena, one at a time, in lanes and in other physics simulators.
//!
//! What is generic over lanes is compiled where it is used: here, with all optimizations, which the missions, robots and checks
//! in `swarmwright-arena` do not need (docs/decisions/025-build.md).

mod arena;
mod lanes;
mod physics;

pub use arena::Arena;
pub use lanes::{VECTORS, evaluate, evaluate_in};
pub use physics::{PhysicsKind, PhysicsSimulation};
