//! Who can be near whom: for each robot the others that are looked at, ascending.

use swarmwright_lanes::{Lanes, Number};

use super::robot::Robot;
use super::swarm::Bodies;

/// Up to so many robots all others are looked at.
pub(super) const MOST_IN_LANES: usize = 64;

/// For each robot a list of others. With few robots all others are in it, with many those within reach, so that work for a
/// robot does not grow with their number. What is not in it is too far to matter, so that the lists decide nothing.
#[derive(Debug, Clone, Default)]
pub(super) struct Neighbours {
    /// Where each robot's list begins, and where the last one ends.
    starts: Vec<u32>,
    others: Vec<u32>,
    /// How near others must be, metres; none where all are looked at.
    reach: Option<f32>,
    cells: Cells,
}

impl Neighbours {
    /// Lists for robots of which things within `reach` metres matter.
    pub(super) fn new(robots: usize, robot: &Robot, reach: f32) -> Self {
        let mut lists = Self::default();
        if robots > MOST_IN_LANES {
            lists.reach = Some(robot.range().max(reach));
            return lists;
        }
        for robot in 0..robots as u32 {
            lists.starts.push(lists.others.len() as u32);
            lists.others.extend(0..robot);
            lists.others.extend(robot + 1..robots as u32);
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
    pub(super) fn update<L: Lanes>(&mut self, bodies: &Bodies<L>) {
        if let Some(reach) = self.reach {
            debug_assert_eq!(
                L::WIDTH,
                1,
                "many robots are computed one episode at a time"
            );
            let number = |number: &Number<L>| {
                let mut lanes = [0.0; swarmwright_lanes::MOST_LANES];
                number.store(&mut lanes[..L::WIDTH]);
                lanes[0]
            };
            let points = bodies.x.iter().zip(&bodies.y);
            self.cells.points.clear();
            self.cells
                .points
                .extend(points.map(|(x, y)| [number(x), number(y)]));
            self.list(reach);
        }
    }

    /// Makes the lists of all robots.
    fn list(&mut self, reach: f32) {
        self.cells.sort(reach);
        self.starts.clear();
        self.others.clear();
        for robot in 0..self.cells.points.len() as u32 {
            let first = self.others.len();
            self.starts.push(first as u32);
            self.cells.around(robot, reach, &mut self.others);
            self.others[first..].sort_unstable();
        }
        self.starts.push(self.others.len() as u32);
    }
}

/// Points in the cells of a grid.
#[derive(Debug, Clone, Default)]
struct Cells {
    points: Vec<[f32; 2]>,
    low: [f32; 2],
    /// Cells in a metre, at most one in a reach, and cells along x and y.
    scale: f32,
    counts: [usize; 2],
    /// Where each cell begins in `sorted`.
    begins: Vec<u32>,
    sorted: Vec<([f32; 2], u32)>,
}

impl Cells {
    /// Sorts the points into cells of at least `reach`, about as many as there are points at most.
    fn sort(&mut self, reach: f32) {
        let (mut low, mut high) = ([f32::INFINITY; 2], [f32::NEG_INFINITY; 2]);
        for point in &self.points {
            for axis in 0..2 {
                low[axis] = low[axis].min(point[axis]);
                high[axis] = high[axis].max(point[axis]);
            }
        }
        let extent = [high[0] - low[0], high[1] - low[1]];
        let side = (extent[0] * extent[1] / self.points.len() as f32)
            .sqrt()
            .max(extent[0].max(extent[1]) / self.points.len() as f32)
            // A little more, so that rounding does not put neighbours two cells apart.
            .max(reach * 1.001);
        self.low = low;
        self.scale = 1.0 / side;
        self.counts = extent.map(|extent| (extent * self.scale) as usize + 1);
        self.begins.clear();
        self.begins.resize(self.counts[0] * self.counts[1] + 1, 0);
        for point in &self.points {
            let [column, row] = self.cell(*point);
            self.begins[row * self.counts[0] + column] += 1;
        }
        // Where each cell ends; putting the points in, the last one first, moves that to where it begins.
        let mut end = 0;
        for begin in &mut self.begins {
            end += *begin;
            *begin = end;
        }
        self.sorted.resize(self.points.len(), ([0.0; 2], 0));
        for (index, point) in self.points.iter().enumerate().rev() {
            let [column, row] = self.cell(*point);
            let begin = &mut self.begins[row * self.counts[0] + column];
            *begin -= 1;
            self.sorted[*begin as usize] = (*point, index as u32);
        }
    }

    fn cell(&self, point: [f32; 2]) -> [usize; 2] {
        let of = |axis: usize| {
            let cell = ((point[axis] - self.low[axis]) * self.scale) as usize;
            cell.min(self.counts[axis] - 1)
        };
        [of(0), of(1)]
    }

    /// Adds the others that are less than `reach` away.
    fn around(&self, robot: u32, reach: f32, others: &mut Vec<u32>) {
        let [x, y] = self.points[robot as usize];
        let [column, row] = self.cell([x, y]);
        let last = (column + 1).min(self.counts[0] - 1);
        for row in row.saturating_sub(1)..=(row + 1).min(self.counts[1] - 1) {
            let row = row * self.counts[0];
            let begin = self.begins[row + column.saturating_sub(1)] as usize;
            let end = self.begins[row + last + 1] as usize;
            for ([px, py], index) in &self.sorted[begin..end] {
                let (dx, dy) = (px - x, py - y);
                if dx * dx + dy * dy < reach * reach && *index != robot {
                    others.push(*index);
                }
            }
        }
    }
}
