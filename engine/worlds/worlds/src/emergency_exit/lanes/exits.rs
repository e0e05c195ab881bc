//! Which exit is the nearest one of every place, and the way there.
//!
//! Places far outnumber exits. Therefore a table holds a number of one byte for each place, and the way is kept up while an
//! agent moves: its step is subtracted, and where the nearest exit is another one, the way from the one to the other is added.
//!
//! A way is columns + 65536 * rows, so that ways can be added and subtracted. Sides are far below 2^15; 0 is an exit.

use swarmwright_lanes::{Int, Lanes};

use super::super::field::Cell;

/// Read at once, wherever a number begins.
const READ: usize = 4;

/// By place: the number of its nearest exit, in as few bytes as hold all of them.
pub(super) struct Numbers {
    bytes: Vec<u8>,
    /// A number has 2^this bytes.
    shift: u32,
}

/// The numbers of a terrain.
pub(super) struct Part<'a> {
    bytes: &'a mut [u8],
    shift: u32,
}

impl Numbers {
    /// Of exits up to this many in a field, for this many places in all.
    pub(super) fn new(exits: usize, places: usize) -> Self {
        let shift = match exits {
            ..=0x100 => 0,
            0x101..=0x1_0000 => 1,
            _ => 2,
        };
        let mut bytes = Vec::with_capacity((places << shift) + READ);
        bytes.resize(READ, 0);
        Self { bytes, shift }
    }

    /// Length in bytes.
    pub(super) fn len(&self) -> usize {
        self.bytes.len()
    }

    /// Adds the numbers of as many places, all 0.
    pub(super) fn append(&mut self, places: usize) -> Part<'_> {
        let first = self.bytes.len() - READ;
        self.bytes
            .resize(self.bytes.len() + (places << self.shift), 0);
        Part {
            bytes: &mut self.bytes[first..],
            shift: self.shift,
        }
    }

    /// Those of places in all lanes where the condition holds, else `others`.
    #[inline(always)]
    pub(super) fn lookup_where<I: Int>(&self, places: I, others: I, condition: I::Mask) -> I {
        let mask = u32::MAX >> (32 - (8 << self.shift));
        places
            .shl(I::splat(self.shift as i32))
            .lookup_bytes_where(&self.bytes, others, condition)
            .and(I::splat(mask.cast_signed()))
    }
}

impl Part<'_> {
    pub(super) fn put(&mut self, index: usize, number: u32) {
        let length = 1 << self.shift;
        self.bytes[index << self.shift..][..length]
            .copy_from_slice(&number.to_le_bytes()[..length]);
    }
}

/// The way from a cell to another.
pub(super) fn between(from: Cell, to: Cell) -> i32 {
    packed(to) - packed(from)
}

/// The way from the first cell of a field.
pub(super) fn packed([x, y]: Cell) -> i32 {
    (y << 16 | x).cast_signed()
}

/// Columns and rows of a way.
pub(super) fn columns_and_rows(way: i32) -> [i32; 2] {
    let columns = i32::from(way as i16);
    [columns, (way - columns) >> 16]
}

/// Columns and rows of ways.
#[inline(always)]
pub(super) fn numbers<L: Lanes>(way: L::Int) -> [L; 2] {
    let half = L::Int::splat(16);
    let columns = way.shl(half).shr_signed(half);
    [
        L::from_int(columns),
        L::from_int(way.sub(columns).shr_signed(half)),
    ]
}

/// The way of a step: 8 for each column, 1 for each row.
#[inline(always)]
pub(super) fn of_step<I: Int>(step: I) -> I {
    let columns = step.add(I::splat(1)).shr_signed(I::splat(3));
    // Rows are what is left: (step - 8 * columns) * 65536 + columns.
    step.shl(I::splat(16))
        .sub(columns.shl(I::splat(19)))
        .add(columns)
}
