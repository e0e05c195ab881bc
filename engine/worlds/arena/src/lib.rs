//! The arena: a swarm of robots, such as e-pucks, between walls, on a coloured floor and under lights.

#![allow(
    clippy::needless_range_loop,
    reason = "what iterators call is not always inlined into kernels"
)]

mod arena;
mod bodies;
mod contacts;
mod failures;
mod lanes;
mod math;
mod metrics;
mod missions;
mod mistakes;
mod physics;
mod place;
mod robots;
mod rules;
mod scene;
mod sensing;
mod settings;
mod start;
mod swarm;
mod time;

pub use arena::Arena;
pub use lanes::{VECTORS, evaluate, evaluate_in};
pub use missions::{MissionInfo, missions};
pub use physics::{
    Motion, Physics, PhysicsKind, PhysicsSimulation, Pose, RobotModel, Start, World, WorldLight,
    WorldObject, WorldPatch, WorldWall,
};
pub use robots::robots;
