//! Where robots and objects are at the start of an episode.

pub(crate) mod objects;
pub(crate) mod robots;

use crate::place::Pose;

/// Where all that moves is at the start.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Starts {
    pub robots: Vec<Pose>,
    pub objects: Vec<Pose>,
}
