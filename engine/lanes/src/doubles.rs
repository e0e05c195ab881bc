//! What is done with numbers of binary64, in plain Rust.

/// 2^-53.
pub const UNIT: f64 = 1.0 / 9_007_199_254_740_992.0;

/// See [`crate::Lanes::units_of_rows`].
#[inline(always)]
#[expect(clippy::cast_precision_loss, reason = "53 bits are exact")]
pub fn units_of_rows(columns: &[[u64; 16]; 4], rows: &mut [f64], stride: usize) {
    in_rows(columns, rows, stride, |word| (word >> 11) as f64 * UNIT);
}

/// See [`crate::Lanes::words_of_rows`].
#[inline(always)]
pub fn words_of_rows(columns: &[[u64; 16]; 4], rows: &mut [u64], stride: usize) {
    in_rows(columns, rows, stride, |word| word);
}

#[inline(always)]
fn in_rows<T>(columns: &[[u64; 16]; 4], rows: &mut [T], stride: usize, of: impl Fn(u64) -> T) {
    for row in 0..16 {
        let to = &mut rows[row * stride..][..4];
        for (place, column) in to.iter_mut().zip(columns) {
            *place = of(column[row]);
        }
    }
}

/// See [`crate::Lanes::outside`].
#[inline(always)]
#[expect(
    clippy::cast_possible_truncation,
    reason = "there is room for as many places"
)]
pub fn outside(
    numbers: &[f64],
    center: f64,
    border: f64,
    places: &mut [u32],
    found: &mut [f64],
) -> usize {
    check_room(numbers, places, found);
    let mut count = 0;
    for (index, number) in numbers.iter().enumerate() {
        // Always written, and kept only if it is counted: that needs no branch.
        places[count] = index as u32;
        found[count] = *number;
        count += usize::from((number - center).abs() > border);
    }
    count
}

/// Panics when numbers are not whole vectors, or when there is no room for all of them and a vector behind them.
#[inline(always)]
pub fn check_room(numbers: &[f64], places: &[u32], found: &[f64]) {
    assert!(
        numbers.len().is_multiple_of(8),
        "the numbers are not a multiple of eight"
    );
    assert!(
        places.len().min(found.len()) >= numbers.len() + 8,
        "too little room for the numbers that are found"
    );
}
