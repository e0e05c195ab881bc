//! The conditions: a file and a line of the list below for each. Their numbers are their places in the list.

mod black_floor;
mod few_neighbours;
mod fixed_probability;
mod grey_floor;
mod neighbours;
mod white_floor;

use swarmwright_lanes::{Int, Lanes, Mask};

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
        let place = MODULES
            .iter()
            .position(|module| module.condition == Condition::Ground(ground));
        L::Int::splat(place.map_or(-1, |place| place as i32))
    };
    let bright = number(Ground::White).select(number(Ground::Grey), L::splat(WHITE).le(sensor));
    number(Ground::Black).select(bright, sensor.le(L::splat(BLACK)))
}

/// As [`probability`]. `transition`: the weight of each lane's transition with this place; `ground`: see [`ground_in_lanes`].
#[inline(always)]
pub fn probability_in_lanes<L: Lanes>(
    transition: impl Fn(usize) -> L,
    ground: L::Int,
    neighbours: L,
) -> L {
    let condition = transition(1).floor();
    let none = L::Mask::from_bits(0);
    let is = |wanted: Condition| {
        let places = MODULES
            .iter()
            .enumerate()
            .filter(|(_, module)| module.condition == wanted);
        places.fold(none, |mask, (place, _)| {
            mask.or(condition.eq(L::Int::splat(place as i32)))
        })
    };
    let fixed = condition.eq(ground).or(is(Condition::Fixed));
    let simple = transition(2).select(L::splat(0.0), fixed);
    let (many, few) = (
        is(Condition::Neighbours(1.0)),
        is(Condition::Neighbours(-1.0)),
    );
    let counted = many.or(few);
    if !counted.any() {
        return simple;
    }
    let more = neighbours.sub(transition(3));
    let signed = more.neg().select(more, few);
    lanes::sigmoid(transition(4).mul(signed)).select(simple, counted)
}
