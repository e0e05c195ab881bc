//! The squares of the floor, each of the kind of robots that were in it last.

use std::ops::Range;

use super::state::State;
use super::swarm::Grid;
use crate::place::Place;

/// Of nobody; kinds count from 1.
const NOBODY: u8 = 0;
/// Of robots of several kinds in the same tick.
const SEVERAL: u8 = u8::MAX;

/// The squares of each lane.
pub(super) struct Paint {
    grid: Grid,
    is_free: Vec<bool>,
    free: usize,
    /// The kind of each square, lane after lane.
    owners: Vec<u8>,
    /// Number of free squares of each kind, by lane.
    counts: Vec<Vec<usize>>,
    /// The squares of this tick, with the kind that is in each.
    now: Vec<(usize, u8)>,
}

impl Paint {
    pub(super) fn new(layout: &Place, cell: f32, lanes: usize) -> Self {
        let grid = Grid::new(layout, cell);
        let is_free = grid.free_squares(layout);
        Self {
            free: is_free.iter().filter(|free| **free).count(),
            is_free,
            owners: vec![NOBODY; grid.len() * lanes],
            counts: vec![Vec::new(); lanes],
            now: Vec::new(),
            grid,
        }
    }

    /// Paints the squares where the robots of a lane are. Returns the share of free squares of the kind with a name.
    #[inline]
    pub(super) fn paint(
        &mut self,
        robots: &[State],
        kinds: &[(String, Range<usize>)],
        name: &str,
        lane: usize,
    ) -> f64 {
        self.now.clear();
        for (kind, (_, members)) in kinds.iter().enumerate() {
            let kind = kind as u8 + 1;
            for robot in &robots[members.clone()] {
                let square = self
                    .grid
                    .index(robot.at)
                    .filter(|square| self.is_free[*square]);
                self.now.extend(square.map(|square| (square, kind)));
            }
        }
        self.now.sort_unstable();
        self.now.dedup();
        // Squares with several kinds are next to each other now.
        for index in 1..self.now.len() {
            if self.now[index].0 == self.now[index - 1].0 {
                self.now[index].1 = SEVERAL;
                self.now[index - 1].1 = SEVERAL;
            }
        }
        let owners = &mut self.owners[lane * self.grid.len()..][..self.grid.len()];
        let counts = &mut self.counts[lane];
        counts.resize(kinds.len() + 1, 0);
        for (square, kind) in &self.now {
            if *kind != SEVERAL {
                counts[usize::from(owners[*square])] =
                    counts[usize::from(owners[*square])].saturating_sub(1);
                owners[*square] = *kind;
                counts[usize::from(*kind)] += 1;
            }
        }
        let kind = kinds.iter().position(|(kind, _)| kind == name);
        let count = kind.map_or(0, |kind| counts[kind + 1]);
        count as f64 / (self.free as f64).max(1.0)
    }
}
