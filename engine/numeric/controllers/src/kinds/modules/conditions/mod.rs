//! The conditions: a file and a line of the list below for each. Their numbers are their places in the list.

mod black_floor;
mod few_neighbours;
mod fixed_probability;
mod grey_floor;
mod neighbours;
mod white_floor;

use swarmwright_lanes::{Int, Lanes, Mask};

use super::lanes::Row;
use super::{BLACK, Sensed, TRANSITION_LIMITS, WHITE, limited, names};
use crate::functions::{lanes, sigmoid};

/// What the file of a condition says.
pub struct Module {
    pub name: &'static str,
    pub condition: Condition,
}

/// When a transition is made.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Condition {
    /// On ground of this colour, with a probability.
    Ground(Ground),
    /// With a probability that grows (1) or shrinks (-1) with the number of neighbours.
    Neighbours(f32),
    /// With a probability.
    Fixed,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Ground {
    Black,
    Grey,
    White,
}

const MODULES: [Module; 6] = [
    black_floor::MODULE,
    grey_floor::MODULE,
    white_floor::MODULE,
    neighbours::MODULE,
    few_neighbours::MODULE,
    fixed_probability::MODULE,
];
pub const COUNT: usize = MODULES.len();

/// Names in the order of numbers.
pub const NAMES: [&str; COUNT] = names!(MODULES);

impl Ground {
    /// The ground that a sensor sees.
    fn of(sensor: f32) -> Self {
        match sensor {
            sensor if sensor <= BLACK => Self::Black,
            sensor if sensor >= WHITE => Self::White,
            _ => Self::Grey,
        }
    }
}

/// The probability that a transition may be made.
pub fn probability(transition: &[f32], sensed: &Sensed) -> f32 {
    let of = |index: usize| limited(transition[index], TRANSITION_LIMITS[index]);
    match MODULES[of(1) as usize].condition {
        Condition::Ground(ground) if Ground::of(sensed.ground) == ground => of(2),
        Condition::Ground(_) => 0.0,
        Condition::Neighbours(sign) => sigmoid(of(4) * (sign * (sensed.neighbours - of(3)))),
        Condition::Fixed => of(2),
    }
}

/// The number of the condition that holds on the ground.
#[inline(always)]
pub fn ground_in_lanes<L: Lanes>(sensor: L) -> L::Int {
    let number = |ground: Ground| {
        let index = MODULES
            .iter()
            .position(|module| module.condition == Condition::Ground(ground));
        L::Int::splat(index.map_or(-1, |index| index as i32))
    };
    let bright = number(Ground::White).select(number(Ground::Grey), L::splat(WHITE).le(sensor));
    number(Ground::Black).select(bright, sensor.le(L::splat(BLACK)))
}

/// As [`probability`]. The weights of the transition begin at `first`; `ground`: see [`ground_in_lanes`].
#[inline(always)]
pub fn probability_in_lanes<L: Lanes>(
    row: &Row<'_, L>,
    first: usize,
    ground: L::Int,
    neighbours: L,
) -> L {
    let condition = row.get(first + 1).floor();
    let none = L::Mask::from_bits(0);
    // No closures: what they do is not always inlined into kernels.
    let (mut fixed, mut many, mut few) = (condition.eq(ground), none, none);
    for (index, module) in MODULES.iter().enumerate() {
        let is = condition.eq(L::Int::splat(index as i32));
        match module.condition {
            Condition::Fixed => fixed = fixed.or(is),
            Condition::Neighbours(sign) if sign < 0.0 => few = few.or(is),
            Condition::Neighbours(_) => many = many.or(is),
            Condition::Ground(_) => {}
        }
    }
    let simple = row.get(first + 2).select(L::splat(0.0), fixed);
    let counted = many.or(few);
    if !counted.any() {
        return simple;
    }
    let more = neighbours.sub(row.get(first + 3));
    let signed = more.neg().select(more, few);
    lanes::sigmoid(row.get(first + 4).mul(signed)).select(simple, counted)
}
