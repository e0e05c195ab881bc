//! The numbers that robots send each other with their messages.

use swarmwright_lanes::{Int, Lanes, Mask, Number, number};

use super::place::Place;
use super::random::{Keys, LINKS};
use super::robot::Robot;
use super::senses::Other;
use super::swarm::Bodies;

/// Writes the mean of the messages that a robot hears in a tick, number by number; 0 where it hears none. Those arrive that
/// count as heard.
#[expect(clippy::too_many_arguments, reason = "what a tick consists of")]
#[inline(always)]
pub(super) fn hear<L: Lanes>(
    robot: &Robot,
    place: &Place,
    bodies: &Bodies<L>,
    index: usize,
    (sent, others): (&[Number<L>], &[Other<L>]),
    keys: Keys<L>,
    tick: u32,
    means: &mut [L],
) {
    means.fill(L::splat(0.0));
    let Some(links) = &robot.links else {
        return;
    };
    let lost = L::Int::splat((links.loss * 65536.0) as i32 - 1);
    let range = number::<L>(links.range * links.range);
    let mut heard = number::<L>(0.0);
    for at in 0..others.len() {
        let (other, sender) = (others[at], others[at].index as usize);
        let word = keys.links(tick, index, sender / LINKS)[sender % LINKS / 2];
        let half = if sender.is_multiple_of(2) {
            word.and(L::Int::splat(0xFFFF))
        } else {
            word.shr(L::Int::splat(16))
        };
        let arrives = lost.lt(half).and(other.square.lt(range));
        if !arrives.any() {
            continue;
        }
        let arrives = arrives
            .and_not(behind_robot(robot, others, at))
            .and_not(behind_wall(place, bodies, index, sender));
        heard = heard.add_where(number(1.0), arrives);
        for part in 0..means.len() {
            let number = sent[sender * means.len() + part];
            means[part] = Number(means[part]).add_where(number, arrives).0;
        }
    }
    let share = number::<L>(1.0) / heard.at_least(number(1.0));
    for mean in means {
        *mean = (Number(*mean) * share).0;
    }
}

/// Whether a third robot stands between.
#[inline(always)]
fn behind_robot<L: Lanes>(robot: &Robot, others: &[Other<L>], at: usize) -> L::Mask {
    let mut hidden = L::Mask::from_bits(0);
    let goal = others[at];
    let width = goal.square * (robot.radius * robot.radius);
    for index in 0..others.len() {
        if index == at {
            continue;
        }
        let other = others[index];
        let cross = goal.x * other.y - goal.y * other.x;
        let dot = goal.x * other.x + goal.y * other.y;
        let between = number(0.0).lt(dot).and(dot.lt(goal.square));
        hidden = hidden.or((cross * cross).lt(width).and(between));
    }
    hidden
}

/// Whether a wall stands between.
#[inline(always)]
fn behind_wall<L: Lanes>(place: &Place, bodies: &Bodies<L>, from: usize, to: usize) -> L::Mask {
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
