//! A population on a torus, whose members meet their neighbours only, after FREVO's `CEA2D`.

use crate::stream::{Stream, purpose_key};

/// Neighbours of a member at most.
const NEAR: usize = 8;
/// Members of a neighbourhood at most, and a place for one that is not kept.
const MOST: usize = NEAR + 2;

/// Neighbourhoods of members, and the number of survivors. Members are numbered column by column.
#[derive(Debug, Clone)]
pub struct Torus {
    /// Start index of each member's neighbours, and the end of the last one's.
    starts: Vec<usize>,
    /// Ascending for each member.
    neighbours: Vec<u32>,
    /// Share of a neighbourhood, the member itself included, that stays.
    elite: f64,
}

/// The shares of members that are made in a way.
#[derive(Debug, Clone, Copy)]
pub struct Ways {
    /// Mutated copies.
    pub mutate: f64,
    /// Children of two.
    pub crossover: f64,
}

/// How the member that comes into a cell is made.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Way {
    /// At random.
    Renew,
    /// As a mutated copy of this member.
    Mutate(usize),
    /// As the child of the cell's own member and this one.
    Cross(usize),
}

/// A member and its fitness.
type Member = (u32, f64);

/// The members of a neighbourhood that did not fail, in no order.
struct Worked {
    members: [Member; MOST],
    count: usize,
}

impl Worked {
    fn add(&mut self, fitness: &[f64], member: u32) {
        let its = fitness[member as usize];
        self.members[self.count] = (member, its);
        self.count += usize::from(!its.is_nan());
    }

    /// The member at rank `ahead`. That is mostly the first, so the best is found repeatedly instead of sorting all.
    fn ranked(&self, ahead: usize) -> usize {
        let mut members = self.members;
        let mut left = &mut members[..self.count];
        loop {
            let (mut position, mut best) = (0, left[0]);
            for (index, member) in left.iter().enumerate() {
                let better = is_ahead(*member, best);
                position = if better { index } else { position };
                best = if better { *member } else { best };
            }
            if left.len() + ahead == self.count {
                return best.0 as usize;
            }
            left.swap(0, position);
            left = &mut left[1..];
        }
    }
}

impl Torus {
    /// The up to eight cells around each, on a torus of `width` columns and `height` rows.
    ///
    /// `obstacles`: number of empty cells, drawn at random.
    ///
    /// # Panics
    ///
    /// Unless there are more cells than obstacles, and fewer than 2^32.
    #[must_use]
    pub fn grid(width: usize, height: usize, obstacles: usize, seed: u64, elite: f64) -> Self {
        let members = numbered(width * height, obstacles, seed);
        let mut torus = Self::empty(elite);
        for (cell, member) in members.iter().enumerate() {
            let Some(member) = member else { continue };
            let (x, y) = (cell / height, cell % height);
            let columns = [(x + width - 1) % width, x, (x + 1) % width];
            let rows = [(y + height - 1) % height, y, (y + 1) % height];
            let around = columns
                .into_iter()
                .flat_map(|x| rows.map(|y| x * height + y));
            torus.push(*member, around.filter_map(|cell| members[cell]));
        }
        torus
    }

    /// Up to eight members for each, drawn once from all.
    ///
    /// # Panics
    ///
    /// With 2^32 members or more.
    #[must_use]
    pub fn random(members: usize, seed: u64, elite: f64) -> Self {
        let key = purpose_key("cea2d.neighbours");
        let mut torus = Self::empty(elite);
        for member in 0..members {
            let mut drawn = [0; NEAR];
            Stream::new(seed, key, 0, member as u64).integers(members as u64, &mut drawn);
            torus.push(index(member as u64), drawn.into_iter().map(index));
        }
        torus
    }

    const fn empty(elite: f64) -> Self {
        Self {
            starts: Vec::new(),
            neighbours: Vec::new(),
            elite,
        }
    }

    /// Adds the next member with its neighbours, each of them once and not itself.
    fn push(&mut self, member: u32, around: impl Iterator<Item = u32>) {
        if self.starts.is_empty() {
            self.starts.push(0);
        }
        let mut around: Vec<u32> = around.filter(|other| *other != member).collect();
        around.sort_unstable();
        around.dedup();
        self.neighbours.extend(around);
        self.starts.push(self.neighbours.len());
    }

    /// Number of members.
    #[must_use]
    pub fn members(&self) -> usize {
        self.starts.len().saturating_sub(1)
    }

    /// The neighbours of a member, ascending.
    #[must_use]
    pub fn neighbours(&self, member: usize) -> &[u32] {
        &self.neighbours[self.starts[member]..self.starts[member + 1]]
    }

    /// Whether a member is among the best of its neighbourhood; failed ones (NaN) never are.
    ///
    /// Of equal ones the one with the larger number is ahead.
    #[must_use]
    pub fn stays(&self, fitness: &[f64], member: usize) -> bool {
        let neighbours = self.neighbours(member);
        let its = (index(member as u64), fitness[member]);
        let mut ahead = 0;
        for other in neighbours {
            ahead += usize::from(is_ahead((*other, fitness[*other as usize]), its));
        }
        !its.1.is_nan() && ahead < self.size(neighbours)
    }

    /// The first member from `cursor` on, round the torus, that does not stay.
    #[must_use]
    pub fn next(&self, fitness: &[f64], cursor: usize) -> Option<usize> {
        let all = (cursor..self.members()).chain(0..cursor);
        all.into_iter().find(|member| !self.stays(fitness, *member))
    }

    /// The members of a neighbourhood that stay, the best first; failed ones never do.
    #[must_use]
    pub fn elite(&self, fitness: &[f64], member: usize) -> Vec<usize> {
        let around = self.around(fitness, member);
        let elite = self.size(self.neighbours(member)).min(around.count);
        (0..elite).map(|rank| around.ranked(rank)).collect()
    }

    fn around(&self, fitness: &[f64], member: usize) -> Worked {
        let mut worked = Worked {
            members: [(0, f64::NAN); MOST],
            count: 0,
        };
        worked.add(fitness, index(member as u64));
        for other in self.neighbours(member) {
            worked.add(fitness, *other);
        }
        worked
    }

    /// How the member that comes into a cell is made, and of whom, by two numbers uniform in 0 .. 1.
    #[must_use]
    pub fn choose(&self, fitness: &[f64], cell: usize, ways: Ways, drawn: [f64; 2]) -> Way {
        let share = drawn[0] * (1.0 - self.elite);
        let around = self.around(fitness, cell);
        let elite = self.size(self.neighbours(cell)).min(around.count);
        if around.count == 0 || share >= ways.mutate + ways.crossover {
            return Way::Renew;
        }
        // Without an elite FREVO crosses with any of the neighbourhood, and mutates a cell's own member.
        let parents = if elite > 0 { elite } else { around.count };
        let parent = around.ranked(part(drawn[1], parents));
        if fitness[cell].is_nan() {
            Way::Mutate(parent)
        } else if share < ways.mutate {
            Way::Mutate(if elite > 0 { parent } else { cell })
        } else {
            Way::Cross(parent)
        }
    }

    /// How many of a member and its neighbours stay.
    #[expect(
        clippy::cast_possible_truncation,
        clippy::cast_sign_loss,
        clippy::cast_precision_loss,
        reason = "they are few"
    )]
    fn size(&self, neighbours: &[u32]) -> usize {
        ((neighbours.len() + 1) as f64 * self.elite).round_ties_even() as usize
    }
}

/// Whether one member is better than another; failed members never are.
#[inline]
fn is_ahead(left: Member, right: Member) -> bool {
    // Without jumps, which would be guessed wrong half of the time.
    (left.1 > right.1) | ((left.1 == right.1) & (left.0 > right.0))
}

/// Index of the equal part of 0 .. 1 that contains a number.
#[expect(
    clippy::cast_possible_truncation,
    clippy::cast_sign_loss,
    clippy::cast_precision_loss,
    reason = "the whole part is meant"
)]
fn part(number: f64, parts: usize) -> usize {
    (number * parts as f64) as usize
}

#[expect(clippy::expect_used, reason = "the constructors document it")]
fn index(member: u64) -> u32 {
    u32::try_from(member).expect("there are too many members")
}

/// The number of each cell's member, None for an obstacle. Obstacles are the first of a shuffled row of all cells.
fn numbered(cells: usize, obstacles: usize, seed: u64) -> Vec<Option<u32>> {
    assert!(obstacles < cells, "obstacles leave no members");
    let mut row: Vec<usize> = (0..cells).collect();
    let mut stream = Stream::new(seed, purpose_key("cea2d.obstacles"), 0, 0);
    let mut members = vec![Some(0); cells];
    for cell in 0..obstacles {
        #[expect(
            clippy::cast_possible_truncation,
            reason = "it is below the number of cells"
        )]
        let other = cell + stream.integer((cells - cell) as u64) as usize;
        row.swap(cell, other);
        members[row[cell]] = None;
    }
    for (number, member) in (0..).zip(members.iter_mut().flatten()) {
        *member = index(number);
    }
    members
}
