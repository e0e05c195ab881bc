//! Models of robots, and the robots of a swarm.

mod model;
mod numbers;
mod outputs;
mod parts;
mod robot;
mod team;
mod together;

pub use model::robots;
pub use outputs::Output;
pub use parts::{Camera, Drive, GroundSensors, LightSensors, Links, Proximity, Radio, Sight};
pub use robot::{Group, Robot};
pub use team::{MOST_RATIO, MOST_ROBOTS, Pair, Team};
