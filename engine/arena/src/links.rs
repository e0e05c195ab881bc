//! Range and bearing: messages of the robots around, where nothing stands between and nothing is lost.

use swarmwright_lanes::{Int, Lanes, Mask, Number, number};

use super::place::Place;
use super::random::{Keys, LINKS};
use super::robot::{Links, Robot};
use super::senses::Other;
use super::swarm::Bodies;

/// Ticks whose messages count for the attraction.
const WINDOW: usize = 11;

/// Messages of the last ticks.
pub(super) struct LinkWindow<L> {
    /// By robot and tick of the window: the sum over its messages, in the frame that the robot then had.
    sums: Vec<[[Number<L>; 2]; WINDOW]>,
    /// By robot: messages of this tick.
    pub heard: Vec<Number<L>>,
    /// By robot: the sum over the window.
    pub attraction: Vec<[Number<L>; 2]>,
}

impl<L: Lanes> LinkWindow<L> {
    pub(super) fn new(robots: usize) -> Self {
        Self {
            sums: vec![[[number(0.0); 2]; WINDOW]; robots],
            heard: vec![number(0.0); robots],
            attraction: vec![[number(0.0); 2]; robots],
        }
    }

    #[inline(always)]
    pub(super) fn clear(&mut self) {
        self.sums.fill([[number(0.0); 2]; WINDOW]);
    }

    /// A robot hears the others.
    #[expect(clippy::too_many_arguments, reason = "what a tick consists of")]
    #[inline(always)]
    pub(super) fn hear(
        &mut self,
        links: &Links,
        robot: &Robot,
        place: &Place,
        bodies: &Bodies<L>,
        index: usize,
        others: &[Other<L>],
        keys: Keys<L>,
        tick: u32,
    ) {
        let lost = L::Int::splat((links.loss * 65536.0) as i32 - 1);
        let range = number::<L>(links.range * links.range);
        let (mut heard, mut sum) = (number::<L>(0.0), [number(0.0); 2]);
        let mut block = usize::MAX;
        let mut words = [L::Int::splat(0); 4];
        for (at, other) in others.iter().enumerate() {
            let sender = other.index as usize;
            if sender / LINKS != block {
                block = sender / LINKS;
                words = keys.links(tick, index, block);
            }
            let word = words[sender % LINKS / 2];
            let half = if sender.is_multiple_of(2) {
                word.and(L::Int::splat(0xFFFF))
            } else {
                word.shr(L::Int::splat(16))
            };
            let mut arrives = lost.lt(half).and(other.square.lt(range));
            if !arrives.any() {
                continue;
            }
            arrives = arrives.and_not(hidden_by_robot(robot, others, at));
            arrives = arrives.and_not(hidden_by_wall(place, bodies, index, sender));
            if !arrives.any() {
                continue;
            }
            let distance = other.square.sqrt();
            let weight = number::<L>(1.0) / (distance * 100.0 + (1.0 - links.offset));
            let weight = (weight / distance).only_where(arrives);
            heard = heard.add_where(number(1.0), arrives);
            sum[0] += other.x * weight;
            sum[1] += other.y * weight;
        }
        self.heard[index] = heard;
        let sums = &mut self.sums[index];
        sums[tick as usize % WINDOW] = sum;
        let mut total = [number(0.0); 2];
        for sum in sums.iter() {
            total[0] += sum[0];
            total[1] += sum[1];
        }
        self.attraction[index] = total;
    }
}

/// Whether a third robot stands between.
#[inline(always)]
fn hidden_by_robot<L: Lanes>(robot: &Robot, others: &[Other<L>], at: usize) -> L::Mask {
    let mut hidden = L::Mask::from_bits(0);
    let goal = others[at];
    let width = goal.square * (robot.radius * robot.radius);
    for (index, other) in others.iter().enumerate() {
        if index == at {
            continue;
        }
        let cross = goal.x * other.y - goal.y * other.x;
        let dot = goal.x * other.x + goal.y * other.y;
        let between = number(0.0).lt(dot).and(dot.lt(goal.square));
        hidden = hidden.or((cross * cross).lt(width).and(between));
    }
    hidden
}

/// Whether a wall stands between.
#[inline(always)]
fn hidden_by_wall<L: Lanes>(place: &Place, bodies: &Bodies<L>, from: usize, to: usize) -> L::Mask {
    let mut hidden = L::Mask::from_bits(0);
    for face in place.faces.iter().filter(|face| !face.outer) {
        let [ax, ay] = face.along;
        let offset = |index: usize| {
            let (dx, dy) = (
                bodies.x[index] - face.middle[0],
                bodies.y[index] - face.middle[1],
            );
            [dx * ax + dy * ay, dy * ax - dx * ay]
        };
        let ([s, a], [t, b]) = (offset(from), offset(to));
        let crosses = (a * b).lt(number(0.0));
        if crosses.any() {
            let at = s + (t - s) * (a / (a - b));
            let inside = at.le(number(face.half)).and(number(-face.half).le(at));
            hidden = hidden.or(crosses.and(inside));
        }
    }
    hidden
}
