//! The robots around a sensing robot.

use swarmwright_lanes::Number;

/// Vector to another robot, along the axes of the arena.
#[derive(Clone, Copy)]
pub struct Other<L> {
    pub x: Number<L>,
    pub y: Number<L>,
    pub square: Number<L>,
}

/// The robots around a sensing robot, kind by kind.
pub struct Others<L> {
    /// Reused memory; the first `count` items are valid.
    pub all: Vec<Other<L>>,
    pub count: usize,
    /// End of the index range of each kind's robots.
    pub ends: Vec<usize>,
}

impl<L> std::ops::Deref for Others<L> {
    type Target = [Other<L>];

    #[inline(always)]
    fn deref(&self) -> &[Other<L>] {
        &self.all[..self.count]
    }
}

impl<L> Others<L> {
    /// Returns the number of kinds.
    #[inline(always)]
    pub fn kinds(&self) -> usize {
        self.ends.len()
    }

    /// Returns the robots of a kind.
    #[inline(always)]
    pub fn of(&self, kind: usize) -> &[Other<L>] {
        let first = if kind == 0 { 0 } else { self.ends[kind - 1] };
        &self.all[first..self.ends[kind]]
    }
}
