//! The closest of many points, to the bit what looking at all of them in order gives.

use super::{Point, squared_distance};

/// Number of points below which they are checked one by one.
const FEW: usize = 32;
/// Points in a cell, on average.
const IN_CELL: f64 = 2.0;
/// Most cells, so that few points on a vast map do not ask for vast memory.
const MOST_CELLS: f64 = 4_194_304.0;
/// Squared distances are computed in binary32; this is far more than they are off by.
const SLACK: f64 = 1.0 - 1e-5;

/// Points in square cells. Built anew for each step, in the memory of the one before.
#[derive(Debug, Clone, Default)]
pub(super) struct Nearest {
    points: Vec<Point>,
    side: f64,
    columns: usize,
    rows: usize,
    /// Start of each cell's points in `order`, and the end of the last one's.
    starts: Vec<u32>,
    /// Indices of the points, by cell, ascending within a cell.
    order: Vec<u32>,
}

impl Nearest {
    /// Takes the points to be asked for; their order decides ties.
    pub fn fill(&mut self, map: Point, points: impl Iterator<Item = Point>) {
        self.points.clear();
        self.points.extend(points);
        if self.points.len() < FEW {
            return;
        }
        let [width, height] = map.map(f64::from);
        let count = self.points.len() as f64;
        let cells = (count / IN_CELL).clamp(1.0, MOST_CELLS);
        self.side = (width * height / cells).sqrt();
        self.columns = (width / self.side).ceil().max(1.0) as usize;
        self.rows = (height / self.side).ceil().max(1.0) as usize;
        self.starts.clear();
        self.starts.resize(self.columns * self.rows + 1, 0);
        for index in 0..self.points.len() {
            let cell = self.cell(self.points[index]);
            self.starts[cell + 1] += 1;
        }
        for cell in 1..self.starts.len() {
            self.starts[cell] += self.starts[cell - 1];
        }
        self.order.clear();
        self.order.resize(self.points.len(), 0);
        // Backwards, so that each start moves down to where it belongs and indices ascend within a cell.
        for index in (0..self.points.len()).rev() {
            let cell = self.cell(self.points[index]);
            self.starts[cell + 1] -= 1;
            self.order[self.starts[cell + 1] as usize] = index as u32;
        }
        // Every start has become the one of the cell before it.
        self.starts.rotate_left(1);
        if let Some(last) = self.starts.last_mut() {
            *last = self.points.len() as u32;
        }
    }

    fn place(&self, [x, y]: Point) -> (usize, usize) {
        // A negative or too large quotient saturates; bodies stand on the map, or off it by a rounding.
        let column = ((f64::from(x) / self.side) as usize).min(self.columns - 1);
        (
            column,
            ((f64::from(y) / self.side) as usize).min(self.rows - 1),
        )
    }

    fn cell(&self, point: Point) -> usize {
        let (column, row) = self.place(point);
        row * self.columns + column
    }

    /// The closest point, the first on ties, and its squared distance in binary32; none without points.
    pub fn closest(&self, from: Point) -> Option<(Point, f32)> {
        let mut best: Option<(u32, f32)> = None;
        if self.points.len() < FEW {
            for index in 0..self.points.len() as u32 {
                self.consider(index, from, &mut best);
            }
        } else {
            self.search(from, &mut best);
        }
        best.map(|(index, q)| (self.points[index as usize], q))
    }

    fn consider(&self, index: u32, from: Point, best: &mut Option<(u32, f32)>) {
        let q = squared_distance(from, self.points[index as usize]);
        if best.is_none_or(|(first, least)| q < least || (q == least && index < first)) {
            *best = Some((index, q));
        }
    }

    /// Looks at rings of cells around the one of `from`, until what lies further out cannot be as close.
    fn search(&self, from: Point, best: &mut Option<(u32, f32)>) {
        let (column, row) = self.place(from);
        for ring in 0..self.columns.max(self.rows) {
            let (left, right) = (
                column.saturating_sub(ring),
                (column + ring).min(self.columns - 1),
            );
            let (low, high) = (row.saturating_sub(ring), (row + ring).min(self.rows - 1));
            for y in low..=high {
                let edge = y + ring == row || y == row + ring;
                let mut x = left;
                while x <= right {
                    let side = x + ring == column || x == column + ring;
                    if edge || side {
                        self.look_into(y * self.columns + x, from, best);
                        x += 1;
                    } else {
                        // On to the right side of the ring.
                        x = (column + ring).max(x + 1);
                    }
                }
            }
            // Whatever is in the next ring is at least this far away.
            let beyond = self.side * ring as f64;
            if best.is_some_and(|(_, q)| beyond * beyond * SLACK > f64::from(q)) {
                return;
            }
        }
    }

    fn look_into(&self, cell: usize, from: Point, best: &mut Option<(u32, f32)>) {
        for index in &self.order[self.starts[cell] as usize..self.starts[cell + 1] as usize] {
            self.consider(*index, from, best);
        }
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    proptest! {
        #[test]
        fn the_closest_is_the_one_found_by_looking_at_all(
            size in (1u16..300, 1u16..300),
            // Whole and half coordinates give ties.
            places in prop::collection::vec((0u16..600, 0u16..600, any::<bool>()), 1..300),
            asked in prop::collection::vec((0u16..600, 0u16..600), 1..30),
        ) {
            let map = [f32::from(size.0), f32::from(size.1)];
            let point = |(x, y): (u16, u16), exact: bool| {
                let scale = if exact { 0.5 } else { 0.497 };
                [(f32::from(x) * scale).min(map[0]), (f32::from(y) * scale).min(map[1])]
            };
            let points: Vec<Point> = places.into_iter().map(|(x, y, exact)| point((x, y), exact)).collect();
            let mut nearest = Nearest::default();
            for _ in 0..2 {
                nearest.fill(map, points.iter().copied());
                for from in &asked {
                    let from = point(*from, true);
                    let mut expected: Option<(Point, f32)> = None;
                    for other in &points {
                        let q = squared_distance(from, *other);
                        if expected.is_none_or(|(_, least)| q < least) {
                            expected = Some((*other, q));
                        }
                    }
                    prop_assert_eq!(nearest.closest(from), expected);
                }
            }
        }
    }
}
