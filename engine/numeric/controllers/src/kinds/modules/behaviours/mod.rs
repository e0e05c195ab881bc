//! The behaviours: a file and a line of the list below for each. Their numbers are their places in the list.

mod anti_phototaxis;
mod attraction;
mod exploration;
mod follow;
mod phototaxis;
mod repulsion;
mod stop;

use swarmwright_lanes::{Int, Lanes, Mask};

use super::lanes::Row;
use super::random::{LaneRandom, Random};
use super::{Sensed, names};
use follow::{LanePull, Pull};

/// What the file of a behaviour says.
pub struct Module {
    pub name: &'static str,
    pub behaviour: Behaviour,
}

/// What a state does. Behaviours that follow a sum of vectors differ in factors alone, so that lanes compute all of them at once.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Behaviour {
    /// See [`exploration`].
    Explore,
    /// Stays where it is.
    Stop,
    /// Follows a sum of vectors, see [`follow`].
    Follow(Pull),
}

const MODULES: [Module; 6] = [
    exploration::MODULE,
    stop::MODULE,
    phototaxis::MODULE,
    anti_phototaxis::MODULE,
    attraction::MODULE,
    repulsion::MODULE,
];
pub const COUNT: usize = MODULES.len();

/// Names in the order of numbers.
pub const NAMES: [&str; COUNT] = names!(MODULES);

/// What the behaviour with this number does, and how many more steps the robot turns: to the left above 0, to the right below.
pub fn act(
    number: usize,
    row: &[f32],
    sensed: &Sensed,
    turn: &mut f32,
    random: &Random<u32>,
) -> [f32; 2] {
    match MODULES[number].behaviour {
        Behaviour::Stop => [0.0, 0.0],
        Behaviour::Explore => exploration::act(row, sensed, turn, random),
        Behaviour::Follow(pull) => follow::act(pull, row, sensed),
    }
}

/// What the behaviours of the lanes' states do: the speeds of both wheels. No closure gives the weights: what it
/// does would not be inlined into kernels.
#[inline(always)]
pub fn act_in_lanes<L: Lanes>(
    row: &Row<'_, L>,
    turn: &mut L,
    sensors: &[L],
    random: LaneRandom<L>,
) -> [L; 2] {
    let zero = L::splat(0.0);
    let behaviour = row.get(0).floor();
    let none = L::Mask::from_bits(0);
    let (mut explores, mut follows) = (none, none);
    let mut pulls = LanePull::none();
    for (index, module) in MODULES.iter().enumerate() {
        let is = behaviour.eq(L::Int::splat(index as i32));
        match module.behaviour {
            Behaviour::Explore => explores = explores.or(is),
            Behaviour::Stop => {}
            Behaviour::Follow(pull) => {
                follows = follows.or(is);
                pulls.set(pull, is);
            }
        }
    }
    let (mut left, mut right) = (zero, zero);
    if explores.any() {
        let proximity = [sensors[0], sensors[1]];
        [left, right] = exploration::act_in_lanes(explores, row.get(1), turn, proximity, random);
    }
    if follows.any() {
        let [steered_left, steered_right] = pulls.act(row.get(2), sensors);
        left = steered_left.select(left, follows);
        right = steered_right.select(right, follows);
    }
    [left, right]
}
