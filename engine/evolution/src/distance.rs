//! How different genomes are.

/// Genomes compared at once: their sums do not wait for one another.
const AT_ONCE: usize = 4;

/// The sum of absolute differences, added in the genome's order.
#[must_use]
pub fn distance(one: &[f32], other: &[f32]) -> f64 {
    one.iter()
        .zip(other)
        .fold(0.0, |sum, (one, other)| sum + difference(*one, *other))
}

/// The distance of one genome to each of several, see [`distance`].
///
/// # Panics
///
/// When there are fewer places in `distances` than `others`, or a genome is shorter than `one`.
pub fn distances(one: &[f32], others: &[&[f32]], distances: &mut [f64]) {
    assert!(others.len() <= distances.len());
    let mut places = distances.chunks_exact_mut(AT_ONCE);
    let mut groups = others.chunks_exact(AT_ONCE);
    for (group, places) in (&mut groups).zip(&mut places) {
        let rows: [&[f32]; AT_ONCE] = std::array::from_fn(|row| &group[row][..one.len()]);
        let mut sums = [0.0; AT_ONCE];
        for (gene, value) in one.iter().enumerate() {
            for (sum, row) in sums.iter_mut().zip(rows) {
                *sum += difference(*value, row[gene]);
            }
        }
        places.copy_from_slice(&sums);
    }
    let done = others.len() - groups.remainder().len();
    for (other, place) in groups.remainder().iter().zip(&mut distances[done..]) {
        *place = distance(one, other);
    }
}

#[inline]
fn difference(one: f32, other: f32) -> f64 {
    (f64::from(one) - f64::from(other)).abs()
}
