//! Contacts of two robots, each in a single lane.
//!
//! A given pair of robots is usually in contact in only one or two of 32 lanes, so vectors by lane would be nearly
//! empty. Work that does not depend on other contacts is therefore done for a full vector of contacts side by side; the
//! contacts are then solved one by one, in order.

use swarmwright_lanes::{Lanes, Mask, Number, lane_of, number};

use super::super::bodies::Bodies;
use super::super::math::functions::square;
use super::super::robots::{Pair, Team};
use super::contact::Contact;
use super::near::{Moved, Near, Spot, key};

/// Two robots in a lane.
#[derive(Clone, Copy)]
struct Touch {
    robots: [u32; 2],
    lane: u32,
    /// Positions of the robots among the packed robots.
    spots: [Spot; 2],
    pair: Pair,
    /// Relative tangential speed of the two rims by rotation alone, m/s.
    rims: f32,
}

impl Touch {
    #[inline(always)]
    fn key(&self) -> u64 {
        key(self.robots[0], self.robots[1], self.lane)
    }
}

/// All pairs of robots that may touch in a tick.
struct Touches<L: Lanes> {
    /// Ascending by robots, then by lanes.
    all: Vec<Touch>,
    /// Contacts in the order of `all`, with the distance between the middles at which the robots touch, and the smaller
    /// radius.
    contacts: Vec<(Contact<L>, [Number<L>; 2])>,
}

/// The contacts of a tick, and those of the tick before.
pub struct Pairs<L: Lanes> {
    now: Touches<L>,
    old: Touches<L>,
}

impl<L: Lanes> Touches<L> {
    fn new() -> Self {
        Self {
            all: Vec::new(),
            contacts: Vec::new(),
        }
    }

    #[inline(always)]
    fn clear(&mut self) {
        self.all.clear();
        self.contacts.clear();
    }

    /// Adds a pair of robots with its impulses from the previous tick.
    #[inline(always)]
    fn push(&mut self, touch: Touch, impulses: [f32; 2]) {
        let lane = self.all.len() % L::WIDTH;
        if lane == 0 {
            self.contacts.push((Contact::none(), [number(0.0); 2]));
        }
        let (contact, [limit, smaller]) = &mut self.contacts[self.all.len() / L::WIDTH];
        contact.set_lane(lane, impulses);
        limit.set_lane(lane, touch.pair.limit);
        smaller.set_lane(lane, touch.pair.smaller);
        self.all.push(touch);
    }

    /// Returns the impulses of a contact.
    #[inline(always)]
    fn impulses(&self, index: usize) -> [f32; 2] {
        let (contact, _) = &self.contacts[index / L::WIDTH];
        let lane = index % L::WIDTH;
        [contact.pressed.lane(lane), contact.rubbed.lane(lane)]
    }
}

impl<L: Lanes> Pairs<L> {
    pub fn new() -> Self {
        Self {
            now: Touches::new(),
            old: Touches::new(),
        }
    }

    /// Discards the contacts, at the start of an episode.
    #[inline(always)]
    pub fn forget(&mut self) {
        self.now.clear();
    }

    /// Finds the pairs of robots that may touch in this tick. `pairs` are the candidates in any lane.
    #[inline(always)]
    pub fn find(
        &mut self,
        bodies: &Bodies<L>,
        pairs: &[[u32; 2]],
        team: &Team,
        nearby: &mut [u64],
    ) {
        std::mem::swap(&mut self.now, &mut self.old);
        self.now.clear();
        let old = &self.old.all;
        let mut at = 0;
        for robots in pairs {
            let (i, j) = (robots[0] as usize, robots[1] as usize);
            let pair = team.pair(i, j);
            let close = square(bodies.between(i, j)).lt(number(pair.reach * pair.reach));
            let mut lanes = close.bits();
            if lanes == 0 {
                continue;
            }
            nearby[i] |= lanes;
            nearby[j] |= lanes;
            let rims = match pair.same {
                Some(radius) => (bodies.spin[i] + bodies.spin[j]) * radius,
                None => {
                    bodies.spin[i] * team.robot(i).radius + bodies.spin[j] * team.robot(j).radius
                }
            };
            while lanes != 0 {
                let lane = lanes.trailing_zeros();
                lanes &= lanes - 1;
                let key = key(robots[0], robots[1], lane);
                while at < old.len() && old[at].key() < key {
                    at += 1;
                }
                let mut impulses = [0.0; 2];
                if at < old.len() && old[at].key() == key {
                    impulses = self.old.impulses(at);
                }
                let touch = Touch {
                    robots: *robots,
                    lane,
                    spots: [Spot::default(); 2],
                    pair,
                    rims: rims.lane(lane_of::<L>(lane)),
                };
                self.now.push(touch, impulses);
            }
        }
    }

    /// Stores the positions of the robots among the packed robots.
    #[inline(always)]
    pub fn place(&mut self, nearby: &Near<L>) {
        for touch in &mut self.now.all {
            let (i, j) = (touch.robots[0] as usize, touch.robots[1] as usize);
            let lane = lane_of::<L>(touch.lane);
            touch.spots = [nearby.spot(i, lane), nearby.spot(j, lane)];
        }
    }

    /// Begins a part of the tick with the impulses of the previous part.
    #[inline(always)]
    pub fn begin(&mut self, moved: &mut [Moved<L>], team: &Team) {
        let (fastest, equal) = (team.fastest(), team.equal());
        let Touches { all, contacts } = &mut self.now;
        for (index, (contact, [limit, smaller])) in contacts.iter_mut().enumerate() {
            let first = index * L::WIDTH;
            let touches = &all[first..all.len().min(first + L::WIDTH)];
            // In unused lanes the bodies coincide, which does not count as a contact.
            let (mut way, mut speed) = ([number(0.0); 2], [number(0.0); 2]);
            for (lane, touch) in touches.iter().enumerate() {
                let [a, b] = touch.spots;
                let (first, second) = (&moved[a.vector as usize], &moved[b.vector as usize]);
                let between_middles = between((&first.at, a), (&second.at, b));
                let relative = between((&first.before, a), (&second.before, b));
                let lane = lane_of::<L>(lane as u32);
                for axis in 0..2 {
                    way[axis].set_lane(lane, between_middles[axis].0);
                    speed[axis].set_lane(lane, relative[axis].0);
                }
            }
            let impulse = contact.begin(way, speed, (*limit, *smaller, fastest));
            let touching = contact.touches().bits();
            let mut lanes = contact.active;
            while lanes != 0 {
                let lane = lane_of::<L>(lanes.trailing_zeros());
                lanes &= lanes - 1;
                let impulse = [impulse[0].lane(lane), impulse[1].lane(lane)];
                let Touch { spots, pair, .. } = touches[lane];
                part_from(moved, spots, impulse, (equal, pair.lightness));
                note(moved, spots, touching >> lane & 1);
            }
        }
    }

    /// Solves each contact once, in order.
    #[inline(always)]
    pub fn solve(&mut self, moved: &mut [Moved<L>], team: &Team) {
        let equal = team.equal();
        let Touches { all, contacts } = &mut self.now;
        for (index, (contacts, _)) in contacts.iter_mut().enumerate() {
            let mut lanes = contacts.active;
            while lanes != 0 {
                let lane = lane_of::<L>(lanes.trailing_zeros());
                lanes &= lanes - 1;
                // Copied, so that the compiler knows that changes of robots do not affect it.
                let touch = all[index * L::WIDTH + lane];
                let [a, b] = touch.spots;
                let (first, second) = (&moved[a.vector as usize], &moved[b.vector as usize]);
                let mut contact = contacts.lane(lane);
                let [nx, ny] = contact.normal;
                let relative = between((&first.velocity, a), (&second.velocity, b));
                let approach = relative[0] * nx + relative[1] * ny;
                let slip = relative[1] * nx - relative[0] * ny - number(touch.rims);
                let pair = &touch.pair;
                let impulse = contact.solve(approach, slip, pair.share, pair.friction);
                contacts.set_lane(lane, [contact.pressed.0, contact.rubbed.0]);
                let impulse = [impulse[0].0, impulse[1].0];
                part_from(moved, touch.spots, impulse, (equal, pair.lightness));
                note(moved, touch.spots, u64::from(contact.touches()));
            }
        }
    }
}

/// Returns the vector from a lane of the first to a lane of the second.
#[inline(always)]
fn between<L: Lanes>(
    (first, a): (&[Number<L>; 2], Spot),
    (second, b): (&[Number<L>; 2], Spot),
) -> [Number<f32>; 2] {
    let (a, b) = (lane_of::<L>(a.lane), lane_of::<L>(b.lane));
    [
        Number(second[0].lane(b) - first[0].lane(a)),
        Number(second[1].lane(b) - first[1].lane(a)),
    ]
}

/// Applies an impulse to the second robot of a pair, and its opposite to the first.
#[inline(always)]
fn part_from<L: Lanes>(
    moved: &mut [Moved<L>],
    spots: [Spot; 2],
    [x, y]: [f32; 2],
    (equal, lightness): (bool, [f32; 2]),
) {
    let [first, second] = if equal {
        [[x, y], [x, y]]
    } else {
        let [first, second] = lightness;
        [[x * first, y * first], [x * second, y * second]]
    };
    push(moved, spots[0], [-first[0], -first[1]]);
    push(moved, spots[1], second);
}

#[inline(always)]
fn push<L: Lanes>(moved: &mut [Moved<L>], spot: Spot, [x, y]: [f32; 2]) {
    let velocity = &mut moved[spot.vector as usize].velocity;
    let lane = lane_of::<L>(spot.lane);
    velocity[0].set_lane(lane, velocity[0].lane(lane) + x);
    velocity[1].set_lane(lane, velocity[1].lane(lane) + y);
}

/// Records for both robots whether something touches them.
#[inline(always)]
fn note<L: Lanes>(moved: &mut [Moved<L>], spots: [Spot; 2], touching: u64) {
    for spot in spots {
        moved[spot.vector as usize].touched |= touching << spot.lane;
    }
}
