//! A field as lanes read it: what an agent sees around it in four bytes, wherever it stands.
//!
//! A byte, a *stack*, holds six cells that lie one above another, and between copies of the cell above them (the lowest
//! bit) and of the one below. A bit is set where no agent could go. The stacks of six rows lie side by side; so three of
//! them in a row hold the surroundings of a cell of the middle one. The border is never free: a column on the right,
//! which is also the one on the left of the next rows, and a row of stacks above and below.
//!
//! An agent's *place* is 8 times the index of its stack, plus which of the six cells it is.

use super::super::field::{Cell, Field};
use super::super::nearest::nearest;
use super::exits::{Numbers, between};

/// Cells in a stack.
const ROWS: usize = 6;
/// A byte before the first stack, so that there is something to the left of it.
const FIRST: usize = 1;
/// Bytes read at once.
pub(super) const WINDOW: usize = 4;
/// A place where nothing is free around and no agent comes by: the top left corner of the border.
pub(super) const NOWHERE: i32 = 8 * FIRST as i32;
/// The bit of the own cell among three stacks in a row, for the uppermost cell.
pub(super) const OWN: i32 = 9;
/// The bits around it, from north clockwise as the sensors are.
pub(super) const AROUND: [u32; 8] = [8, 16, 17, 18, 10, 2, 1, 0];

/// How the cells of a field are laid out.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Layout {
    /// From a stack to the one below.
    pub stride: usize,
    /// Stacks, the border and what is read in vain included.
    pub stacks: usize,
}

/// What a field is like at the start.
pub(super) struct Terrain {
    /// By stack: the cells that are not free.
    pub taken: Vec<u8>,
    /// Where each agent starts: its place, the way to its nearest exit, the number of that exit.
    pub agents: Vec<[i32; 3]>,
}

impl Layout {
    pub(super) fn new(width: u32, height: u32) -> Self {
        let stride = width as usize + 1;
        Self {
            stride,
            stacks: FIRST + stride * ((height as usize).div_ceil(ROWS) + 2) + WINDOW,
        }
    }

    fn place(self, [x, y]: Cell) -> usize {
        let (x, y) = (x as usize, y as usize);
        8 * (FIRST + self.stride * (1 + y / ROWS) + x) + y % ROWS
    }

    /// By the lowest bits of a place after a step up or down: what is to be added where the step led out of the stack.
    pub(super) fn corrections(self) -> [i32; 8] {
        let mut corrections = [0; 8];
        corrections[ROWS] = (8 * self.stride - ROWS) as i32;
        // One up from the uppermost cell is the last bit of the stack before.
        corrections[7] = -corrections[ROWS];
        corrections
    }

    /// Changes cells from free to not free or back: those of `cells` in the four stacks from `stack` on, and their copies
    /// above and below.
    #[inline(always)]
    pub(super) fn flip(self, occupied: &mut [u8], stack: usize, cells: u32) {
        flip_four(occupied, stack, cells);
        flip_four(occupied, stack - self.stride, (cells & 0x0303_0303) << ROWS);
        flip_four(occupied, stack + self.stride, cells >> ROWS & 0x0303_0303);
    }
}

#[inline(always)]
fn flip_four(occupied: &mut [u8], stack: usize, cells: u32) {
    debug_assert!(stack + WINDOW <= occupied.len());
    // SAFETY: agents never leave their field, since the cells around it are never free, and around these stacks there
    // are others.
    #[allow(unsafe_code)]
    unsafe {
        let four = occupied.as_mut_ptr().add(stack).cast::<u32>();
        four.write_unaligned(four.read_unaligned() ^ cells.to_le());
    }
}

impl Terrain {
    /// The numbers of exits that are nearest to its places become the next ones of `numbers`.
    pub(super) fn new(field: &Field, numbers: &mut Numbers) -> Self {
        let layout = Layout::new(field.width, field.height);
        let table = nearest(field.width, field.height, &field.exits);
        let start = |cell: &Cell| {
            let exit = table[cell[1] as usize * field.width as usize + cell[0] as usize];
            let way = between(*cell, field.exits[exit as usize]);
            [layout.place(*cell) as i32, way, exit as i32]
        };
        let mut terrain = Self {
            taken: vec![0xFF; layout.stacks],
            agents: field.agents.iter().map(start).collect(),
        };
        let mut numbers = numbers.append(8 * layout.stacks);
        let mut table = table.iter();
        for y in 0..field.height {
            for (x, exit) in (0..field.width).zip(&mut table) {
                numbers.put(layout.place([x, y]), *exit);
                terrain.turn(layout, [x, y]);
            }
        }
        for cell in field.blockades.iter().chain(&field.agents) {
            terrain.turn(layout, *cell);
        }
        terrain
    }

    /// Makes a cell free, or not.
    fn turn(&mut self, layout: Layout, cell: Cell) {
        let position = layout.place(cell);
        layout.flip(
            &mut self.taken,
            position / 8 - 1,
            1 << OWN << (position % 8),
        );
    }
}
