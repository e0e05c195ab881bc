//! The nearest exit of every cell, in time proportional to the number of cells, however many exits there are.
//!
//! Exact: squared Euclidean distances are integers. After the two-pass distance transform of Meijster, Roerdink and
//! Hesselink (2000), here with ties: of two exits equally near the earlier one in the list is the nearest.

use super::field::Cell;

/// An exit as seen from cells of its column: squared distance within the column, index in the list.
type InColumn = Option<(i64, u32)>;

/// The index of the nearest exit of every cell of `width` x `height`, row after row. At least one exit is needed.
pub(super) fn nearest(width: u32, height: u32, exits: &[Cell]) -> Vec<u32> {
    let columns = in_columns(width, height, exits);
    let mut result = Vec::with_capacity(columns.len());
    let mut rivals = Vec::with_capacity(width as usize);
    for row in columns.chunks_exact(width as usize) {
        contest(row, &mut rivals);
        let mut rivals = rivals.iter().peekable();
        let mut best = 0;
        for x in 0..i64::from(width) {
            while let Some(rival) = rivals.next_if(|rival| rival.from <= x) {
                best = rival.index;
            }
            result.push(best);
        }
    }
    result
}

/// For every cell the nearest exit of its own column.
fn in_columns(width: u32, height: u32, exits: &[Cell]) -> Vec<InColumn> {
    let (w, h) = (width as usize, height as usize);
    let mut first: Vec<Option<u32>> = vec![None; w * h];
    for (index, [x, y]) in (0..).zip(exits) {
        first[*y as usize * w + *x as usize].get_or_insert(index);
    }
    let mut result: Vec<InColumn> = vec![None; w * h];
    for x in 0..w {
        for downwards in [true, false] {
            let mut last: Option<(usize, u32)> = None;
            for i in 0..h {
                let y = if downwards { i } else { h - 1 - i };
                if let Some(index) = first[y * w + x] {
                    last = Some((i, index));
                }
                let candidate = last.map(|(at, index)| (((i - at) * (i - at)) as i64, index));
                let cell = &mut result[y * w + x];
                *cell = [*cell, candidate].into_iter().flatten().min();
            }
        }
    }
    result
}

/// A column whose exit is the nearest one in its row from x = `from` on, until the next rival takes over.
struct Rival {
    column: i64,
    squared: i64,
    index: u32,
    from: i64,
}

/// The lower envelope of the parabolas (x - column)^2 + squared, left to right.
fn contest(row: &[InColumn], rivals: &mut Vec<Rival>) {
    rivals.clear();
    for (column, exit) in (0..).zip(row) {
        let Some((squared, index)) = *exit else {
            continue;
        };
        let mut from = 0;
        while let Some(last) = rivals.last() {
            from = overtakes(last, column, squared, index).max(0);
            if from > last.from {
                break;
            }
            rivals.pop();
            from = 0;
        }
        if from < row.len() as i64 {
            rivals.push(Rival {
                column,
                squared,
                index,
                from,
            });
        }
    }
}

/// The smallest x where the exit of `column` is nearer than that of `last`, which lies to its left.
fn overtakes(last: &Rival, column: i64, squared: i64, index: u32) -> i64 {
    // (x - column)^2 + squared <= (x - last.column)^2 + last.squared solved for x; both sides are whole.
    let lead = column * column - last.column * last.column + squared - last.squared;
    let slope = 2 * (column - last.column);
    if index < last.index {
        (lead + slope - 1).div_euclid(slope)
    } else {
        lead.div_euclid(slope) + 1
    }
}

#[cfg(test)]
mod tests {
    use super::nearest;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn agrees_with_looking_at_every_exit(
            (width, height, exits) in (1_u32..30, 1_u32..30).prop_flat_map(|(w, h)| {
                (Just(w), Just(h), prop::collection::vec([0..w, 0..h], 1..40))
            })
        ) {
            let table = nearest(width, height, &exits);
            for y in 0..height {
                for x in 0..width {
                    let squared = |e: &[u32; 2]| e[0].abs_diff(x).pow(2) + e[1].abs_diff(y).pow(2);
                    // min_by_key gives the first of equal ones.
                    let best = exits.iter().enumerate().min_by_key(|(_, e)| squared(e)).unwrap().0;
                    prop_assert_eq!(table[(y * width + x) as usize] as usize, best, "cell {}, {}", x, y);
                }
            }
        }
    }
}
