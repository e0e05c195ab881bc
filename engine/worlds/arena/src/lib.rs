//! The arena: a swarm of robots, such as e-pucks, between walls, on a coloured floor and under lights.

#![allow(
    clippy::needless_range_loop,
    reason = "what iterators call is not always inlined into kernels"
)]

mod bodies;
mod contacts;
mod failures;
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

// What swarmwright-kernels makes episodes of.
pub use metrics::Tally;
pub use mistakes::Mistakes;
pub use place::Pose as Place;
pub use robots::{Group, MOST_ROBOTS};
pub use scene::scene;
pub use sensing::verlet::MOST_IN_LANES;
pub use settings::{Settings, parameters};
pub use start::Starts;
pub use swarm::Swarm;
pub use time::TICK;

pub use missions::{MissionInfo, missions};
pub use physics::{
    Motion, Physics, Pose, RobotModel, Start, World, WorldLight, WorldObject, WorldPatch, WorldWall,
};
pub use robots::robots;
