//! Contacts of robots with walls.

use swarmwright_lanes::{Lanes, Mask, Number, lane_of, number};

use super::super::bodies::Bodies;
use super::super::math::functions::square;
use super::super::place::{Face, Place, to_face};
use super::super::robots::{Robot, Team};
use super::contact::Contact;
use super::near::{Moved, Near, Spot, key};

/// A robot that may touch a face in a lane.
#[derive(Clone, Copy)]
struct Touch {
    robot: u32,
    face: u32,
    lane: u32,
    /// Index of the contact, and the lane in it.
    contact: u32,
    at: u32,
    /// Impulses of the last part of the tick.
    pressed: f32,
    rubbed: f32,
}

/// Packed robots of a vector, each with its own face.
#[derive(Clone, Copy)]
struct WallContact<L: Lanes> {
    vector: u32,
    /// Lanes that have a face, as bits.
    lanes: u64,
    /// The next contact of the same vector; 0 for none.
    next: u32,
    middle: [Number<L>; 2],
    along: [Number<L>; 2],
    half: Number<L>,
    contact: Contact<L>,
}

/// All contacts with walls.
pub struct Walls<L: Lanes> {
    /// Ascending by robot, face and lane; `old` holds the contacts of the previous tick.
    now: Vec<Touch>,
    old: Vec<Touch>,
    contacts: Vec<WallContact<L>>,
    /// First contact of each vector; `u32::MAX` for none.
    first: Vec<u32>,
}

/// Returns the distance beyond which walls affect neither contacts nor rays in a tick, metres. `gap` is the maximum
/// distance by which two robots approach each other in a tick.
#[inline]
pub fn reach_of_walls(robot: &Robot, gap: f32) -> f32 {
    let rays = robot.proximity.as_ref().map_or(0.0, |p| p.start + p.range);
    rays.max(robot.radius + gap / 2.0)
}

impl<L: Lanes> Walls<L> {
    pub fn new(robots: usize) -> Self {
        Self {
            now: Vec::new(),
            old: Vec::new(),
            contacts: Vec::new(),
            first: vec![u32::MAX; robots],
        }
    }

    /// Discards the contacts, at the start of an episode.
    #[inline(always)]
    pub fn forget(&mut self) {
        self.now.clear();
    }

    /// Finds the walls that robots may touch in this tick. `pairs` are the candidate pairs of a robot and a face in any
    /// lane.
    #[inline(always)]
    pub fn find(
        &mut self,
        bodies: &Bodies<L>,
        pairs: &[[u32; 2]],
        (team, layout): (&Team, &Place),
        nearby: &mut [u64],
    ) {
        std::mem::swap(&mut self.now, &mut self.old);
        self.now.clear();
        // Faster robots may push slow ones.
        let gap = team.gap();
        let mut before = 0;
        for [robot, face] in pairs {
            let index = *robot as usize;
            let reach = team.robot(index).radius + gap / 2.0;
            let way = to_face(
                &layout.faces[*face as usize],
                bodies.x[index],
                bodies.y[index],
            );
            let close = square(way).lt(number(reach * reach));
            let mut lanes = close.bits();
            if lanes == 0 {
                continue;
            }
            nearby[index] |= lanes;
            while lanes != 0 {
                let lane = lanes.trailing_zeros();
                lanes &= lanes - 1;
                let mut touch = Touch {
                    robot: *robot,
                    face: *face,
                    lane,
                    contact: 0,
                    at: 0,
                    pressed: 0.0,
                    rubbed: 0.0,
                };
                while before < self.old.len() && self.old[before].key() < touch.key() {
                    before += 1;
                }
                if before < self.old.len() && self.old[before].key() == touch.key() {
                    touch.pressed = self.old[before].pressed;
                    touch.rubbed = self.old[before].rubbed;
                }
                self.now.push(touch);
            }
        }
    }

    /// Collects the faces for each vector of robots; the faces of a robot are in ascending order.
    #[inline(always)]
    pub fn collect(&mut self, nearby: &Near<L>, layout: &Place) {
        self.contacts.clear();
        for vector in &nearby.used {
            self.first[*vector as usize] = u32::MAX;
        }
        for touch in &mut self.now {
            let Spot { vector, lane } = nearby.spot(touch.robot as usize, touch.lane as usize);
            let new = self.contacts.len() as u32;
            let first = &mut self.first[vector as usize];
            let mut index = *first;
            if index == u32::MAX {
                *first = new;
                index = new;
            }
            while index != new && self.contacts[index as usize].lanes >> lane & 1 != 0 {
                let next = &mut self.contacts[index as usize].next;
                if *next == 0 {
                    *next = new;
                }
                index = *next;
            }
            if index == new {
                self.contacts.push(WallContact::none(vector));
            }
            let face = &layout.faces[touch.face as usize];
            self.contacts[index as usize].take(lane_of::<L>(lane), face, touch);
            (touch.contact, touch.at) = (index, lane);
        }
    }

    /// Begins a part of the tick with the impulses of the previous part.
    #[inline(always)]
    pub fn begin(&mut self, moved: &mut [Moved<L>], team: &Team) {
        let fastest = team.fastest();
        for wall in &mut self.contacts {
            let moved = &mut moved[wall.vector as usize];
            let radius = team.robot(moved.robot as usize).radius;
            let way = wall.way(moved.at);
            let speed = [-moved.before[0], -moved.before[1]];
            let limits = (number(radius), number(radius), fastest);
            let impulse = wall.contact.begin(way, speed, limits);
            if wall.contact.active != 0 {
                pull(moved, impulse);
                moved.touched |= wall.contact.touches().bits();
            }
        }
    }

    /// Solves each contact once, in order.
    #[inline(always)]
    pub fn solve(&mut self, moved: &mut [Moved<L>], team: &Team) {
        for wall in &mut self.contacts {
            if wall.contact.active == 0 {
                continue;
            }
            let moved = &mut moved[wall.vector as usize];
            let robot = team.robot(moved.robot as usize);
            let ([nx, ny], [x, y]) = (wall.contact.normal, moved.velocity);
            let approach = -(x * nx + y * ny);
            let slip = x * ny - y * nx - moved.spin * robot.radius;
            let impulse = wall.contact.solve(approach, slip, 1.0, robot.friction[1]);
            pull(moved, impulse);
            moved.touched |= wall.contact.touches().bits();
        }
    }

    /// Keeps the impulses for the next tick.
    #[inline(always)]
    pub fn keep(&mut self) {
        for touch in &mut self.now {
            let contact = &self.contacts[touch.contact as usize].contact;
            touch.pressed = contact.pressed.lane(lane_of::<L>(touch.at));
            touch.rubbed = contact.rubbed.lane(lane_of::<L>(touch.at));
        }
    }
}

impl Touch {
    #[inline(always)]
    fn key(&self) -> u64 {
        key(self.robot, self.face, self.lane)
    }
}

impl<L: Lanes> WallContact<L> {
    #[inline(always)]
    fn none(vector: u32) -> Self {
        Self {
            vector,
            lanes: 0,
            next: 0,
            // Too far away to touch.
            middle: [number(1e6); 2],
            along: [number(1.0), number(0.0)],
            half: number(0.0),
            contact: Contact::none(),
        }
    }

    /// Sets the face of a lane.
    #[inline(always)]
    fn take(&mut self, lane: usize, face: &Face, touch: &Touch) {
        self.lanes |= 1 << lane;
        for axis in 0..2 {
            self.middle[axis].set_lane(lane, face.middle[axis]);
            self.along[axis].set_lane(lane, face.along[axis]);
        }
        self.half.set_lane(lane, face.half);
        self.contact.set_lane(lane, [touch.pressed, touch.rubbed]);
    }

    /// Returns the vector from a point to the nearest point of the face.
    #[inline(always)]
    fn way(&self, [x, y]: [Number<L>; 2]) -> [Number<L>; 2] {
        let (dx, dy) = (x - self.middle[0], y - self.middle[1]);
        let s = dx * self.along[0] + dy * self.along[1];
        let s = s.at_most(self.half).at_least(-self.half);
        [s * self.along[0] - dx, s * self.along[1] - dy]
    }
}

#[inline(always)]
fn pull<L: Lanes>(moved: &mut Moved<L>, [x, y]: [Number<L>; 2]) {
    moved.velocity[0] -= x;
    moved.velocity[1] -= y;
}
