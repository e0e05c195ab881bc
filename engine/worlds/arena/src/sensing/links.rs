//! Range and bearing: messages of nearby robots that are neither blocked nor lost.

use swarmwright_controllers::functions::lanes::tanh;
use swarmwright_lanes::{Lanes, Mask, Number, number};

use super::others::Others;
use super::radio::{Reception, both};
use super::slots::Slots;
use crate::bodies::Bodies;
use crate::math::functions::either;
use crate::math::random::Keys;
use crate::place::Place;
use crate::robots::{Links, Team};

/// Number of ticks whose messages count for the attraction.
const WINDOW: usize = 11;
/// Number of messages that are processed at a time.
const AT_A_TIME: usize = 4;

/// Messages of the last ticks.
pub struct LinkWindow<L: Lanes> {
    /// Sum over the messages, by robot and tick of the window, in the robot's frame at that tick.
    sums: Vec<[[Number<L>; 2]; WINDOW]>,
    /// Number of messages in this tick, by robot.
    pub heard: Vec<Number<L>>,
    /// Sum over the window, by robot.
    pub attraction: Vec<[Number<L>; 2]>,
    sent: Sent<L>,
    /// Lanes in which each robot is mute; empty if no robot is.
    pub mute: Vec<L::Mask>,
    /// Probability with which failures lose messages, in addition to the robots' own loss; `None` without such
    /// failures.
    pub failing: Option<f32>,
}

/// Messages that were not lost: vector to the sender, and the distance between middles at which the rims touch,
/// centimetres.
type Sent<L> = Slots<L, 3, AT_A_TIME>;

/// Number and sum of the messages that were received.
#[derive(Clone, Copy)]
struct Arrived<L> {
    count: Number<L>,
    sum: [Number<L>; 2],
}

impl<L: Lanes> LinkWindow<L> {
    pub fn new(robots: usize) -> Self {
        Self {
            sums: vec![[[number(0.0); 2]; WINDOW]; robots],
            heard: vec![number(0.0); robots],
            attraction: vec![[number(0.0); 2]; robots],
            sent: Sent::new([0.0; 3]),
            mute: Vec::new(),
            failing: None,
        }
    }

    #[inline(always)]
    pub fn clear(&mut self) {
        self.sums.fill([[number(0.0); 2]; WINDOW]);
    }

    /// Returns the probability that a robot does not receive a message, because of its own loss or a failure.
    #[inline(always)]
    pub fn loss(&self, links: &Links) -> f32 {
        match self.failing {
            None => links.loss,
            Some(failing) => either(links.loss, failing),
        }
    }

    /// Receives the messages for a robot.
    #[expect(clippy::too_many_arguments, reason = "what a tick consists of")]
    #[inline(always)]
    pub fn hear(
        &mut self,
        links: &Links,
        team: &Team,
        layout: &Place,
        bodies: &Bodies<L>,
        index: usize,
        (others, indices): (&Others<L>, &[u32]),
        keys: Keys<L>,
        tick: u32,
    ) {
        let loss = self.loss(links);
        let (mut kind, mut left) = (0, 0);
        let (mut range, mut rims) = (number::<L>(0.0), number(0.0));
        let mut arrived = Arrived {
            count: number(0.0),
            sum: [number(0.0); 2],
        };
        let mut reception = Reception::new(
            links,
            team,
            (others, indices),
            (loss, &self.mute),
            (keys, tick, index),
        );
        let slots = &mut self.sent;
        slots.clear();
        let at = [bodies.x[index], bodies.y[index]];
        for k in 0..others.len() {
            let (other, sender) = (&others[k], indices[k] as usize);
            while left == 0 {
                let of = team.kind(kind);
                range = number(both(links, of));
                rims = number(100.0 * (team.robot(index).radius + of.radius));
                left = others.of(kind).len();
                kind += 1;
            }
            left -= 1;
            let of = team.kind(kind - 1);
            let mut sent = reception.arrives((sender, of), other.square, range);
            if !self.mute.is_empty() {
                sent = sent.and_not(self.mute[sender]);
            }
            if sent.any() {
                let rest = slots.put([other.x, other.y, rims], sent);
                if rest.any() {
                    receive(
                        links,
                        team,
                        (layout, bodies),
                        at,
                        others,
                        slots,
                        &mut arrived,
                    );
                    slots.clear();
                    slots.put([other.x, other.y, rims], rest);
                }
            }
        }
        receive(
            links,
            team,
            (layout, bodies),
            at,
            others,
            slots,
            &mut arrived,
        );
        self.heard[index] = arrived.count;
        let sums = &mut self.sums[index];
        let ([x, y], cos, sin) = (arrived.sum, bodies.cos[index], bodies.sin[index]);
        sums[tick as usize % WINDOW] = [x * cos + y * sin, y * cos - x * sin];
        let mut total = [number(0.0); 2];
        for sum in sums.iter() {
            total[0] += sum[0];
            total[1] += sum[1];
        }
        self.attraction[index] = total;
    }
}

/// Adds the messages that nothing blocks.
#[inline(always)]
fn receive<L: Lanes>(
    links: &Links,
    team: &Team,
    (layout, bodies): (&Place, &Bodies<L>),
    at: [Number<L>; 2],
    others: &Others<L>,
    slots: &Sent<L>,
    arrived: &mut Arrived<L>,
) {
    for place_of in 0..slots.used() {
        let ([x, y, rims], nothing) = slots.get(place_of);
        let way = [x, y];
        // Computed as for all other robots, so that the sender does not block its own message.
        let square = way[0] * way[0] + way[1] * way[1];
        let mut hidden = nothing;
        if links.line_of_sight() {
            hidden = hidden
                .or(behind_robot(team, way, square, others))
                .or(behind_wall(layout, at, way))
                .or(bodies.objects.hide(at, way));
        }
        let distance = square.sqrt();
        // The distance between rims plus 1 cm is at least 1; otherwise overlapping robots would get huge or negative
        // weights.
        let far = (distance * 100.0 + (number::<L>(1.0) - rims)).at_least(number(1.0));
        let weight = number::<L>(1.0) / (far * distance);
        let weight = number::<L>(0.0).select(weight, hidden);
        arrived.count += number::<L>(0.0).select(number(1.0), hidden);
        arrived.sum[0] += way[0] * weight;
        arrived.sum[1] += way[1] * weight;
    }
}

/// Returns whether a third robot stands between the two robots.
#[inline(always)]
pub fn behind_robot<L: Lanes>(
    team: &Team,
    [x, y]: [Number<L>; 2],
    square: Number<L>,
    others: &Others<L>,
) -> L::Mask {
    let mut hidden = L::Mask::from_bits(0);
    for kind in 0..others.kinds() {
        let radius = team.kind(kind).radius;
        let width = square * (radius * radius);
        for other in others.of(kind) {
            let cross = x * other.y - y * other.x;
            let dot = x * other.x + y * other.y;
            let between = number(0.0).lt(dot).and(other.square.lt(square));
            hidden = hidden.or((cross * cross).lt(width).and(between));
        }
    }
    hidden
}

/// Returns whether a wall lies between two points.
#[inline(always)]
pub fn behind_wall<L: Lanes>(
    layout: &Place,
    [x, y]: [Number<L>; 2],
    way: [Number<L>; 2],
) -> L::Mask {
    let mut hidden = L::Mask::from_bits(0);
    for face in &layout.faces {
        if face.outer {
            continue;
        }
        let [ax, ay] = face.along;
        let front = face.ahead(x, y);
        let goal = front + (way[1] * ax - way[0] * ay);
        let crosses = (front * goal).lt(number(0.0));
        if crosses.any() {
            let side = (x - face.middle[0]) * ax + (y - face.middle[1]) * ay;
            let part = front / (front - goal);
            let at = side + (way[0] * ax + way[1] * ay) * part;
            let inside = at.le(number(face.half)).and(number(-face.half).le(at));
            hidden = hidden.or(crosses.and(inside));
        }
    }
    hidden
}

/// Returns the components of a vector along the four diagonals, after its length is squashed to tanh(length / 2);
/// negative components are 0.
#[inline(always)]
pub fn parts<L: Lanes>([x, y]: [Number<L>; 2]) -> [Number<L>; 4] {
    let length = (x * x + y * y).sqrt();
    let any = number(0.0).lt(length);
    let factor = (Number(tanh((length * 0.5).0)) / length).only_where(any);
    let half = factor * std::f32::consts::FRAC_1_SQRT_2;
    let (sum, difference) = ((x + y) * half, (y - x) * half);
    let none = number(0.0);
    [
        sum.at_least(none),
        difference.at_least(none),
        (-sum).at_least(none),
        (-difference).at_least(none),
    ]
}
