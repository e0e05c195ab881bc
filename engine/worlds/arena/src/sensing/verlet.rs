//! Verlet lists: for each robot the others that may be within reach of it, in ascending order.

use swarmwright_lanes::{Lanes, Mask, Number, number};

use crate::bodies::Bodies;

/// Maximum number of robots in lanes; the state of more robots would take too much memory.
pub const MOST_IN_LANES: usize = 16_384;
/// Maximum number of robots for which checking all others is faster, with one episode at a time.
const FEW: usize = 48;
/// Maximum number of robots for which checking all others is faster, with episodes in lanes.
const FEW_IN_LANES: usize = 96;
/// Minimum number of ticks for which lists stay valid: the time in which the fastest robots cross the skin.
const SKIN_TICKS: f32 = 6.0;

/// For each robot, a list of other robots. In small swarms, it contains all robots; in large ones, only those within
/// reach in any lane, so that the work for a robot does not grow with the swarm. Omitted robots are too far away to
/// matter, so the lists never change results.
///
/// As in Verlet (1967), lists also contain robots in a skin beyond the reach, and are rebuilt when a robot has moved by
/// half of the skin's thickness.
pub struct VerletLists<L: Lanes> {
    /// Start of each robot's list in `others`, and the end of the last list.
    starts: Vec<u32>,
    others: Vec<u32>,
    /// Distance within which robots affect each other, metres; `None` if all are checked.
    reach: Option<f32>,
    /// Thickness of the skin, metres.
    skin: f32,
    /// Positions of the robots when the lists were built.
    x: Vec<Number<L>>,
    y: Vec<Number<L>>,
    /// Grid of each lane.
    cells: Vec<Cells>,
    /// Robots of a list, as a bit set.
    marks: Vec<u64>,
}

impl<L: Lanes> VerletLists<L> {
    /// Creates lists for robots that affect each other within `reach` metres. `gap` is the maximum distance by which
    /// two robots approach each other in a tick, metres.
    pub fn new(robots: usize, reach: f32, gap: f32) -> Self {
        let few = if L::WIDTH == 1 { FEW } else { FEW_IN_LANES };
        Self {
            starts: Vec::new(),
            others: (0..robots as u32).collect(),
            reach: (robots > few).then_some(reach),
            skin: gap * SKIN_TICKS,
            x: Vec::new(),
            y: Vec::new(),
            cells: Vec::new(),
            marks: Vec::new(),
        }
    }

    /// Returns the indices of the robots that may be near a robot, in ascending order; may include the robot itself.
    #[inline(always)]
    pub fn of(&self, robot: usize) -> &[u32] {
        if self.reach.is_none() {
            return &self.others;
        }
        &self.others[self.starts[robot] as usize..self.starts[robot + 1] as usize]
    }

    /// Rebuilds the lists, if robots have moved too far.
    #[inline(always)]
    pub fn update(&mut self, bodies: &Bodies<L>) {
        let Some(reach) = self.reach else {
            return;
        };
        if self.x.len() == bodies.len() {
            let mut most = number::<L>(0.0);
            for robot in 0..bodies.len() {
                let (x, y) = (
                    bodies.x[robot] - self.x[robot],
                    bodies.y[robot] - self.y[robot],
                );
                most = most.at_least(x * x + y * y);
            }
            // Slightly less than half, to allow for rounding.
            let far = self.skin * 0.499;
            if !number(far * far).lt(most).any() {
                return;
            }
        }
        self.x.clear();
        self.x.extend_from_slice(&bodies.x);
        self.y.clear();
        self.y.extend_from_slice(&bodies.y);
        self.list(reach + self.skin);
    }

    /// Builds the lists of all robots, with the others within `reach`.
    fn list(&mut self, reach: f32) {
        self.cells.resize_with(L::WIDTH, Cells::default);
        for (lane, cells) in self.cells.iter_mut().enumerate() {
            cells.points.clear();
            let points = self.x.iter().zip(&self.y);
            cells
                .points
                .extend(points.map(|(x, y)| [x.lane(lane), y.lane(lane)]));
            cells.sort(reach);
        }
        self.starts.clear();
        self.others.clear();
        self.marks.resize(self.x.len().div_ceil(64), 0);
        for robot in 0..self.x.len() as u32 {
            let first = self.others.len();
            self.starts.push(first as u32);
            for cells in &self.cells {
                cells.around(robot, reach, &mut self.others);
            }
            if L::WIDTH == 1 {
                self.others[first..].sort_unstable();
                continue;
            }
            // Merge the robots of all lanes, without duplicates.
            for other in self.others.drain(first..) {
                self.marks[other as usize / 64] |= 1 << (other % 64);
            }
            for (word, marks) in self.marks.iter_mut().enumerate() {
                while *marks != 0 {
                    self.others.push(word as u32 * 64 + marks.trailing_zeros());
                    *marks &= *marks - 1;
                }
            }
        }
        self.starts.push(self.others.len() as u32);
    }
}

/// Points sorted into the cells of a grid.
#[derive(Debug, Clone, Default)]
struct Cells {
    points: Vec<[f32; 2]>,
    low: [f32; 2],
    /// Cells per metre, with cells of at least the reach; number of cells along x and y.
    scale: f32,
    counts: [usize; 2],
    /// Start of each cell in `sorted`.
    begins: Vec<u32>,
    sorted: Vec<([f32; 2], u32)>,
}

impl Cells {
    /// Sorts the points into cells with a side of at least `reach`; there are at most about as many cells as points.
    #[inline]
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
            // Slightly more, so that rounding does not put neighbours two cells apart.
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
        // First compute the end of each cell. Inserting the points in reverse order then moves it to the start.
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

    #[inline]
    fn cell(&self, point: [f32; 2]) -> [usize; 2] {
        let of = |axis: usize| {
            let cell = ((point[axis] - self.low[axis]) * self.scale) as usize;
            cell.min(self.counts[axis] - 1)
        };
        [of(0), of(1)]
    }

    /// Adds the other robots that are less than `reach` away.
    #[inline]
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
