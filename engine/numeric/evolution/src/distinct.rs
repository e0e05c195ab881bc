//! Which genomes are new.

/// An odd number whose bits are as good as random: 2^64 divided by the golden ratio.
const FACTOR: u64 = 0x9E37_79B9_7F4A_7C15;
/// Pairs of genes that are hashed at once: their products do not wait for one another.
const AT_ONCE: usize = 4;
const FREE: u32 = u32::MAX;

/// The indices of those genomes that are, to the bit, the same as no earlier one and as none of those known.
///
/// `existing`, `genomes`: rows of `genes` numbers.
///
/// # Panics
///
/// Without genes, or with 2^32 - 1 genomes or more.
#[must_use]
pub fn distinct(existing: &[&[f32]], genomes: &[f32], genes: usize) -> Vec<usize> {
    let rows = existing.iter().flat_map(|rows| rows.chunks_exact(genes));
    let new = genomes.len() / genes;
    let all: Vec<&[f32]> = rows.chain(genomes.chunks_exact(genes)).collect();
    assert!(all.len() < FREE as usize, "there are too many genomes");
    let mut table = Table::of(&all);
    let first_new = all.len() - new;
    let mut indices = Vec::with_capacity(new);
    for index in 0..all.len() {
        if table.insert(index) && index >= first_new {
            indices.push(index - first_new);
        }
    }
    indices
}

/// A hash table of rows, by index, with open addressing.
struct Table<'a> {
    rows: &'a [&'a [f32]],
    /// An index and the upper half of its hash in each place taken.
    places: Vec<(u32, u32)>,
    /// How far to shift a hash to get a place.
    shift: u32,
}

impl<'a> Table<'a> {
    fn of(rows: &'a [&'a [f32]]) -> Self {
        let places = (2 * rows.len()).next_power_of_two().max(2);
        Self {
            rows,
            places: vec![(FREE, 0); places],
            shift: u64::BITS - places.trailing_zeros(),
        }
    }

    /// Whether a row was not there yet; it is from now on.
    #[expect(
        clippy::cast_possible_truncation,
        reason = "there are fewer rows than a u32 counts"
    )]
    fn insert(&mut self, index: usize) -> bool {
        let row = self.rows[index];
        let hash = hash(row);
        // Places are found by the upper bits, which depend on all others; the lower half tells most others apart.
        let mut slot = (hash >> self.shift) as usize;
        loop {
            match self.places[slot] {
                (FREE, _) => break,
                (other, low) if low == hash as u32 && same(self.rows[other as usize], row) => {
                    return false;
                }
                _ => slot = (slot + 1) % self.places.len(),
            }
        }
        self.places[slot] = (index as u32, hash as u32);
        true
    }
}

fn hash(genome: &[f32]) -> u64 {
    let (chunks, rest) = genome.as_chunks::<{ 2 * AT_ONCE }>();
    let mut sums = [0; AT_ONCE];
    for chunk in chunks {
        for index in 0..AT_ONCE {
            sums[index] = mixed(sums[index], bits([chunk[2 * index], chunk[2 * index + 1]]));
        }
    }
    let mut sum = 0;
    for gene in rest {
        sum = mixed(sum, u64::from(gene.to_bits()));
    }
    for other in sums {
        sum = mixed(sum, other);
    }
    sum
}

#[inline]
fn bits([low, high]: [f32; 2]) -> u64 {
    u64::from(low.to_bits()) | u64::from(high.to_bits()) << 32
}

#[inline]
fn mixed(sum: u64, word: u64) -> u64 {
    (sum.rotate_left(29) ^ word).wrapping_mul(FACTOR)
}

fn same(left: &[f32], right: &[f32]) -> bool {
    (0..left.len()).all(|gene| left[gene].to_bits() == right[gene].to_bits())
}
