//! Ranks, and draws of which the better-ranked are likelier.

use crate::stream::Stream;

/// The key of failed members, above that of every fitness.
const FAILED: u64 = u64::MAX;
const SIGN: u64 = 1 << 63;

/// The rank k for a ticket in 0 .. members * (members + 1) / 2, of which k holds members - k.
#[must_use]
pub fn triangular(ticket: u64, members: u64) -> u64 {
    // Tickets from the end: the last holds one, the last but one two, .. so k counts triangular numbers from there.
    let left = tickets(members) - 1 - ticket;
    let row = ((8 * left + 1).isqrt() - 1) / 2;
    members - 1 - row
}

const fn tickets(members: u64) -> u64 {
    members * (members + 1) / 2
}

/// Members that stay: the best, then others, drawn at random, the k-th best of m that remain with a probability proportional to m - k.
///
/// Of equal ones the first is ahead; failed ones (NaN) never stay.
#[must_use]
pub fn survivors(fitness: &[f64], best: usize, random: usize, stream: &mut Stream) -> Vec<usize> {
    let ranked = best_first(fitness);
    let (elite, others) = ranked.split_at(best.min(ranked.len()));
    let mut staying: Vec<_> = elite.iter().map(|member| *member as usize).collect();
    let mut remaining = Remaining::new(others.len());
    for left in (1..=others.len()).rev().take(random) {
        let left = left as u64;
        let rank = triangular(stream.integer(tickets(left)), left);
        staying.push(others[remaining.take(rank)] as usize);
    }
    staying
}

/// The members that have not failed, the best first, of equal ones the first.
fn best_first(fitness: &[f64]) -> Vec<u32> {
    let keys: Vec<u64> = fitness.iter().map(|fitness| key(*fitness)).collect();
    let mut order = ordered(&keys);
    let worked = order.partition_point(|member| keys[*member as usize] != FAILED);
    order.truncate(worked);
    order
}

/// The indices of the keys in ascending order, of equal ones the first.
pub(crate) fn ordered(keys: &[u64]) -> Vec<u32> {
    // Plain integers are sorted three times as fast as pairs. The index takes the place of the lowest bits of the key, which seldom
    // decide; the second sort, of what is mostly sorted, goes by all of them.
    let low = keys.len().next_power_of_two() as u64 - 1;
    let mut sorted: Vec<u64> = (0..)
        .zip(keys)
        .map(|(index, key)| key & !low | index)
        .collect();
    sorted.sort_unstable();
    #[expect(
        clippy::cast_possible_truncation,
        reason = "members are counted in u32"
    )]
    let mut order: Vec<u32> = sorted.iter().map(|entry| (entry & low) as u32).collect();
    order.sort_by_key(|member| keys[*member as usize]);
    order
}

/// A key that is the lower the better a member is, and its index.
type Rank = (u64, u32);

fn rank((member, fitness): (u32, &f64)) -> Rank {
    (key(*fitness), member)
}

/// A number that is the lower the better a fitness is; that of failed ones (NaN) is the highest.
pub(crate) fn key(fitness: f64) -> u64 {
    // Adding 0.0 turns -0.0 into 0.0, which is its equal.
    let bits = (fitness + 0.0).to_bits();
    let ascending = if bits & SIGN == 0 { bits | SIGN } else { !bits };
    if fitness.is_nan() { FAILED } else { !ascending }
}

const fn member(rank: Rank) -> usize {
    rank.1 as usize
}

/// Places of which some are taken already: a Fenwick tree of how many remain.
struct Remaining(Vec<u32>);

impl Remaining {
    fn new(places: usize) -> Self {
        let counts = (1..=places).map(|index| 1 << index.trailing_zeros());
        Self(counts.collect())
    }

    /// Takes the remaining place that has `before` remaining places before it.
    fn take(&mut self, before: u64) -> usize {
        let (mut index, mut before) = (0, before);
        let mut step = (self.0.len() + 1).next_power_of_two();
        while step > 0 {
            if let Some(count) = self.0.get_mut(index + step - 1) {
                if u64::from(*count) <= before {
                    before -= u64::from(*count);
                    index += step;
                } else {
                    *count -= 1;
                }
            }
            step /= 2;
        }
        index
    }
}

/// Members that are replaced one by one, in the order of their ranks; at first all have failed.
#[derive(Debug, Clone)]
pub struct Ranks {
    keys: Vec<u64>,
    order: Vec<Rank>,
}

impl Ranks {
    /// So many members.
    #[must_use]
    pub fn new(members: u32) -> Self {
        Self {
            keys: vec![FAILED; members as usize],
            order: (0..members).map(|member| (FAILED, member)).collect(),
        }
    }

    /// Number of members.
    #[must_use]
    pub fn members(&self) -> usize {
        self.keys.len()
    }

    /// How many have not failed.
    #[must_use]
    pub fn worked(&self) -> usize {
        self.order.partition_point(|rank| rank.0 != FAILED)
    }

    /// The last in order: the failed member with the largest index, or else the one with the lowest fitness.
    #[must_use]
    pub fn worst(&self) -> Option<usize> {
        self.order.last().copied().map(member)
    }

    /// A member gets another fitness; NaN: it has failed.
    ///
    /// # Panics
    ///
    /// When there is no such member.
    pub fn set(&mut self, index: u32, fitness: f64) {
        let key = &mut self.keys[index as usize];
        let (before, after) = ((*key, index), rank((index, &fitness)));
        *key = after.0;
        let from = self.order.partition_point(|rank| *rank < before);
        let to = self.order.partition_point(|rank| *rank < after);
        if from < to {
            self.order[from..to].rotate_left(1);
            self.order[to - 1] = after;
        } else {
            self.order[to..=from].rotate_right(1);
            self.order[to] = after;
        }
    }

    /// A member that has not failed, the k-th best of m with a probability proportional to m - k.
    ///
    /// # Panics
    ///
    /// When all have failed.
    #[must_use]
    pub fn draw(&self, stream: &mut Stream) -> usize {
        let worked = self.worked() as u64;
        assert!(worked > 0, "all members have failed");
        let rank = triangular(stream.integer(tickets(worked)), worked);
        #[expect(clippy::cast_possible_truncation, reason = "it is a rank")]
        member(self.order[rank as usize])
    }
}
