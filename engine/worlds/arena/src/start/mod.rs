//! Start positions of robots and objects in an episode.

pub mod objects;
pub mod robots;

use crate::place::Pose;

/// Start poses of everything that moves.
#[derive(Debug, Clone, PartialEq)]
pub struct Starts {
    /// One per robot.
    pub robots: Vec<Pose>,
    /// One per object.
    pub objects: Vec<Pose>,
}
