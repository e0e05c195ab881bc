//! Contacts of two robots, each in one lane alone.
//!
//! Robots touch others in other lanes: of 32 lanes one or two have a contact of the same two robots. Vectors would be all but
//! empty, so that contacts are solved by numbers; those of other lanes do not wait for each other.

use swarmwright_lanes::{Lanes, Mask, Number, number};

use super::contact::{Contact, square};
use super::contacts::Moved;
use super::swarm::Bodies;
use super::team::{Pair, Team};

/// Two robots in a lane.
#[derive(Clone, Copy)]
struct PairContact {
    robots: [u32; 2],
    lane: u32,
    pair: Pair,
    /// How fast the rims of both move along each other when nothing else does, m/s.
    rims: f32,
    /// What the impulses are worth for each of the robots, where they differ.
    lightness: [f32; 2],
    contact: Contact<f32>,
}

/// All pairs of robots that may touch in a tick.
pub(super) struct Pairs {
    /// Ascending by robots, then by lanes, and those of the tick before.
    now: Vec<PairContact>,
    old: Vec<PairContact>,
    /// By robot: in which lanes another one touches it in this part.
    touched: Vec<u64>,
}

impl Pairs {
    pub(super) fn new(robots: usize) -> Self {
        Self {
            now: Vec::new(),
            old: Vec::new(),
            touched: vec![0; robots],
        }
    }

    /// Goes to the start of an episode.
    #[inline(always)]
    pub(super) fn forget(&mut self) {
        self.now.clear();
    }

    /// Finds which robots may touch each other in this tick; `pairs` are those that may in any lane.
    #[inline(always)]
    pub(super) fn find<L: Lanes>(
        &mut self,
        bodies: &Bodies<L>,
        pairs: &[[u32; 2]],
        team: &Team,
        near: &mut [L::Mask],
    ) {
        std::mem::swap(&mut self.now, &mut self.old);
        self.now.clear();
        let mut at = 0;
        for robots in pairs {
            let (i, j) = (robots[0] as usize, robots[1] as usize);
            let pair = team.pair(i, j);
            let close = square(bodies.between(i, j)).lt(number(pair.reach * pair.reach));
            let mut lanes = close.bits();
            if lanes == 0 {
                continue;
            }
            near[i] = near[i].or(close);
            near[j] = near[j].or(close);
            let rims = match pair.same {
                Some(radius) => (bodies.spin[i] + bodies.spin[j]) * radius,
                None => {
                    bodies.spin[i] * team.robot(i).radius + bodies.spin[j] * team.robot(j).radius
                }
            };
            while at < self.old.len() && self.old[at].robots < *robots {
                at += 1;
            }
            while lanes != 0 {
                let lane = lanes.trailing_zeros();
                lanes &= lanes - 1;
                let key = (*robots, lane);
                while at < self.old.len() && (self.old[at].robots, self.old[at].lane) < key {
                    at += 1;
                }
                let mut contact = Contact::none();
                if at < self.old.len() && (self.old[at].robots, self.old[at].lane) == key {
                    contact.pressed = self.old[at].contact.pressed;
                    contact.rubbed = self.old[at].contact.rubbed;
                }
                self.now.push(PairContact {
                    robots: *robots,
                    lane,
                    pair,
                    rims: rims.lane(lane as usize),
                    lightness: [team.lightness(i), team.lightness(j)],
                    contact,
                });
            }
        }
    }

    /// Begins a part of the tick with the impulses of the one before.
    #[inline(always)]
    pub(super) fn begin<L: Lanes>(
        &mut self,
        moved: &mut [Moved<L>],
        touched: &mut [L::Mask],
        team: &Team,
    ) {
        let (fastest, equal) = (team.fastest(), team.equal());
        self.touched.fill(0);
        for one in &mut self.now {
            let (i, j) = (one.robots[0] as usize, one.robots[1] as usize);
            let lane = one.lane as usize;
            let (a, b) = (&moved[i], &moved[j]);
            let way = between(&a.at, &b.at, lane);
            let speed = between(&a.before, &b.before, lane);
            let impulse = one
                .contact
                .begin(way, speed, (one.pair.limit, fastest), true);
            if one.contact.active {
                part_from(moved, one, impulse, equal);
                self.touched[i] |= u64::from(one.contact.touches()) << lane;
                self.touched[j] |= u64::from(one.contact.touches()) << lane;
            }
        }
        self.tell(touched);
    }

    /// Solves each contact once, in order.
    #[inline(always)]
    pub(super) fn solve<L: Lanes>(
        &mut self,
        moved: &mut [Moved<L>],
        touched: &mut [L::Mask],
        team: &Team,
    ) {
        let equal = team.equal();
        for one in &mut self.now {
            if !one.contact.active {
                continue;
            }
            let (i, j) = (one.robots[0] as usize, one.robots[1] as usize);
            let lane = one.lane as usize;
            let [nx, ny] = one.contact.normal;
            let relative = between(&moved[i].velocity, &moved[j].velocity, lane);
            let approach = relative[0] * nx + relative[1] * ny;
            let slip = relative[1] * nx - relative[0] * ny - number(one.rims);
            let pair = &one.pair;
            let impulse = one.contact.solve(approach, slip, pair.share, pair.friction);
            part_from(moved, one, impulse, equal);
            self.touched[i] |= u64::from(one.contact.touches()) << lane;
            self.touched[j] |= u64::from(one.contact.touches()) << lane;
        }
        self.tell(touched);
    }

    /// Adds the robots that another one touches.
    #[inline(always)]
    fn tell<M: Mask>(&self, touched: &mut [M]) {
        for (touched, lanes) in touched.iter_mut().zip(&self.touched) {
            if *lanes != 0 {
                *touched = touched.or(M::from_bits(*lanes));
            }
        }
    }
}

/// From one to the other in a lane.
#[inline(always)]
fn between<L: Lanes>(
    one: &[Number<L>; 2],
    other: &[Number<L>; 2],
    lane: usize,
) -> [Number<f32>; 2] {
    [
        Number(other[0].lane(lane) - one[0].lane(lane)),
        Number(other[1].lane(lane) - one[1].lane(lane)),
    ]
}

/// An impulse of the second robot of a pair on itself, and on the first one the other way.
#[inline(always)]
fn part_from<L: Lanes>(
    moved: &mut [Moved<L>],
    contact: &PairContact,
    impulse: [Number<f32>; 2],
    equal: bool,
) {
    let (i, j) = (contact.robots[0] as usize, contact.robots[1] as usize);
    let lane = contact.lane as usize;
    let [x, y] = impulse;
    let [one, two] = if equal {
        [[x, y], [x, y]]
    } else {
        let [one, two] = contact.lightness;
        [[x * one, y * one], [x * two, y * two]]
    };
    push(&mut moved[i].velocity, lane, [-one[0], -one[1]]);
    push(&mut moved[j].velocity, lane, two);
}

#[inline(always)]
fn push<L: Lanes>(velocity: &mut [Number<L>; 2], lane: usize, [x, y]: [Number<f32>; 2]) {
    velocity[0].set_lane(lane, velocity[0].lane(lane) + x.0);
    velocity[1].set_lane(lane, velocity[1].lane(lane) + y.0);
}
