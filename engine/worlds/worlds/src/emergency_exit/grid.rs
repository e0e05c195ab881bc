//! What never changes while agents walk: walls and the way to the nearest exit, by cells.

use super::field::{Cell, Field};
use super::nearest::nearest;

/// Eight neighbours: N, NE, E, SE, S, SW, W, NW; the sensors' order.
pub(super) const DIRECTIONS: [[i32; 2]; 8] = [
    [0, -1],
    [1, -1],
    [1, 0],
    [1, 1],
    [0, 1],
    [-1, 1],
    [-1, 0],
    [-1, -1],
];

/// The direction of a move, by (dy + 1) * 3 + dx + 1; 8 is none.
pub(super) const DIRECTION_OF_MOVE: [usize; 9] = [7, 0, 1, 6, 8, 2, 5, 4, 3];

/// Cells in rows with a border of one cell all around, so that every cell has eight neighbours.
#[derive(Debug, Clone)]
pub(super) struct Grid {
    stride: usize,
    surroundings: Vec<Surroundings>,
    /// By direction: what to add to a cell's index to come to its neighbour.
    offsets: [isize; 8],
}

/// What an agent in a cell finds, side by side: on large grids it is the way to memory that takes time.
#[derive(Debug, Clone, Copy, Default)]
struct Surroundings {
    /// Columns and rows to the nearest exit.
    to_exit: [i16; 2],
    /// Bit d is set where the neighbour in direction d is neither outside nor a blockade.
    open: u8,
}

impl Grid {
    pub(super) fn new(field: &Field) -> Self {
        let (width, rows) = (field.width as usize, field.rows as usize);
        let stride = width + 2;
        let cells = stride * (rows + 2);
        let mut grid = Self {
            stride,
            surroundings: vec![Surroundings::default(); cells],
            offsets: DIRECTIONS.map(|[dx, dy]| dy as isize * stride as isize + dx as isize),
        };
        let mut walkable = vec![false; cells];
        for y in 0..field.rows {
            for x in 0..field.width {
                walkable[grid.index([x, y])] = true;
            }
        }
        for blockade in &field.blockades {
            walkable[grid.index(*blockade)] = false;
        }
        let table = nearest(field.width, field.rows, &field.exits);
        let mut table = table.iter();
        for y in 0..field.rows {
            for x in 0..field.width {
                let cell = grid.index([x, y]);
                for (d, offset) in grid.offsets.iter().enumerate() {
                    // In FREVO those below the last row may walk on up there and sideways, but not down.
                    let leaves = DIRECTIONS[d][1] == 1 && y + 1 >= field.height;
                    if !leaves && walkable[cell.wrapping_add_signed(*offset)] {
                        grid.surroundings[cell].open |= 1 << d;
                    }
                }
                if let Some(exit) = table
                    .next()
                    .and_then(|index| field.exits.get(*index as usize))
                {
                    // Sides are far below 2^15.
                    grid.surroundings[cell].to_exit =
                        [exit[0] as i16 - x as i16, exit[1] as i16 - y as i16];
                }
            }
        }
        grid
    }

    pub(super) fn index(&self, [x, y]: Cell) -> usize {
        (y as usize + 1) * self.stride + x as usize + 1
    }

    pub(super) fn cell(&self, index: usize) -> Cell {
        [
            (index % self.stride) as u32 - 1,
            (index / self.stride) as u32 - 1,
        ]
    }

    /// Number of cells, the border's included.
    pub(super) fn len(&self) -> usize {
        self.surroundings.len()
    }

    /// The neighbour in a direction, unless that is outside or a blockade.
    #[inline]
    pub(super) fn neighbour(&self, index: usize, direction: usize) -> Option<usize> {
        (self.surroundings[index].open >> direction & 1 == 1)
            .then(|| index.wrapping_add_signed(self.offsets[direction]))
    }

    /// Columns and rows to the nearest exit.
    #[inline]
    pub(super) fn to_exit(&self, index: usize) -> [i16; 2] {
        self.surroundings[index].to_exit
    }

    /// Distance to the nearest exit, in cells.
    pub(super) fn distance(&self, index: usize) -> f64 {
        let [dx, dy] = self.to_exit(index).map(i32::from);
        f64::from(dx * dx + dy * dy).sqrt()
    }
}

/// Occupied cells, a bit each, so that even a large grid fits into a near cache.
#[derive(Debug, Clone, Default)]
pub(super) struct Taken(Vec<u64>);

impl Taken {
    /// Nothing is taken of `cells` cells.
    pub(super) fn clear(&mut self, cells: usize) {
        self.0.clear();
        self.0.resize(cells.div_ceil(64), 0);
    }

    #[inline]
    pub(super) fn holds(&self, cell: usize) -> bool {
        self.0[cell / 64] >> (cell % 64) & 1 == 1
    }

    #[inline]
    pub(super) fn take(&mut self, cell: usize) {
        self.0[cell / 64] |= 1 << (cell % 64);
    }

    #[inline]
    pub(super) fn free(&mut self, cell: usize) {
        self.0[cell / 64] &= !(1 << (cell % 64));
    }
}
