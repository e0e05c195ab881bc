//! Start positions of robots and objects in an episode.

pub(crate) mod objects;
pub(crate) mod robots;

use crate::place::Pose;

/// Start poses of everything that moves.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Starts {
    pub robots: Vec<Pose>,
    pub objects: Vec<Pose>,
}
