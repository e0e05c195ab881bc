//! Motion and collisions in a tick, after the rigid discs of Chipmunk 6 as ARGoS uses them.
//!
//! A drive pulls the velocity towards its aim by at most `acceleration` x substep in a substep; positions move before
//! velocities change. Bodies that overlap are not pushed apart: what is cancelled is their approach, with Coulomb friction
//! at the rims, in a fixed number of passes over the contacts in order. Robots that nothing can touch in the tick move in
//! closed form.

use swarmwright_lanes::{Lanes, Mask, Number, number};

use super::neighbours::Neighbours;
use super::place::{Face, Place};
use super::robot::Robot;
use super::swarm::{Bodies, SUBSTEP, SUBSTEPS};

/// Passes over contacts and drives in a substep.
const PASSES: usize = 10;
/// Two bodies that are further apart than this at the beginning of a tick do not touch in it, metres.
const REACH: f32 = 0.04;

/// An impulse divided by the mass of a robot.
#[derive(Clone, Copy)]
struct Contact<L: Lanes> {
    /// From the first robot to the other, or into the wall.
    normal: [Number<L>; 2],
    /// Impulse along the normal so far in this substep, and along the tangent.
    pressed: Number<L>,
    rubbed: Number<L>,
    touches: L::Mask,
    active: bool,
}

impl<L: Lanes> Contact<L> {
    #[inline(always)]
    fn none() -> Self {
        Self {
            normal: [number(0.0); 2],
            pressed: number(0.0),
            rubbed: number(0.0),
            touches: L::Mask::from_bits(0),
            active: false,
        }
    }

    /// Between points whose squared distance is known.
    #[inline(always)]
    fn at(&mut self, way: [Number<L>; 2], square: Number<L>, limit: f32) {
        // Middles that lie on each other press in no direction.
        let positive = number(0.0).lt(square);
        self.touches = square.lt(number(limit * limit)).and(positive);
        self.active = self.touches.any();
        if self.active {
            let inverse = number::<L>(1.0) / square.sqrt().select(number(1.0), positive);
            self.normal = [way[0] * inverse, way[1] * inverse];
            self.pressed = number(0.0);
            self.rubbed = number(0.0);
        }
    }

    /// The change of impulse that ends the approach and what friction adds; `approach` and `slip` are the relative
    /// velocities along normal and tangent, `share` is the part of them that each body takes.
    #[inline(always)]
    fn push(
        &mut self,
        approach: Number<L>,
        slip: Number<L>,
        share: f32,
        friction: f32,
    ) -> [Number<L>; 2] {
        let pressed = (self.pressed - approach * share).at_least(number(0.0));
        let limit = pressed * friction;
        let rubbed = (self.rubbed - slip * share).at_most(limit).at_least(-limit);
        let change = [
            (pressed - self.pressed).only_where(self.touches),
            (rubbed - self.rubbed).only_where(self.touches),
        ];
        self.pressed += change[0];
        self.rubbed += change[1];
        let [nx, ny] = self.normal;
        [
            nx * change[0] - ny * change[1],
            ny * change[0] + nx * change[1],
        ]
    }
}

/// The work of a tick.
pub(super) struct Contacts<L: Lanes> {
    /// The velocity that each drive aims at.
    pub aim: Vec<[Number<L>; 2]>,
    /// In which lanes something can touch a robot.
    near: Vec<L::Mask>,
    involved: Vec<u32>,
    /// In which lanes something touches a robot in this substep.
    touched: Vec<L::Mask>,
    pairs: Vec<([u32; 2], Contact<L>)>,
    walls: Vec<(u32, u32, Contact<L>)>,
    /// By robot: position, velocity, and what the drive has given in this substep.
    moved: Vec<Moved<L>>,
}

#[derive(Clone, Copy)]
struct Moved<L> {
    at: [Number<L>; 2],
    velocity: [Number<L>; 2],
    driven: [Number<L>; 2],
}

/// From a point to the nearest point of a face.
#[inline(always)]
pub(super) fn to_face<L: Lanes>(face: &Face, x: Number<L>, y: Number<L>) -> [Number<L>; 2] {
    let (dx, dy) = (x - face.middle[0], y - face.middle[1]);
    let s = (dx * face.along[0] + dy * face.along[1]).within(-face.half, face.half);
    [s * face.along[0] - dx, s * face.along[1] - dy]
}

#[inline(always)]
fn square<L: Lanes>([x, y]: [Number<L>; 2]) -> Number<L> {
    x * x + y * y
}

impl<L: Lanes> Contacts<L> {
    pub(super) fn new(robots: usize) -> Self {
        let zero = [number(0.0); 2];
        let moved = Moved {
            at: zero,
            velocity: zero,
            driven: zero,
        };
        Self {
            aim: vec![zero; robots],
            near: vec![L::Mask::from_bits(0); robots],
            involved: Vec::new(),
            touched: vec![L::Mask::from_bits(0); robots],
            pairs: Vec::new(),
            walls: Vec::new(),
            moved: vec![moved; robots],
        }
    }

    /// Moves all robots by a tick.
    #[inline(always)]
    pub(super) fn resolve(
        &mut self,
        bodies: &mut Bodies<L>,
        neighbours: &Neighbours,
        robot: &Robot,
        place: &Place,
    ) {
        self.find(bodies, neighbours, robot, place);
        for index in 0..self.involved.len() {
            let robot = self.involved[index] as usize;
            self.moved[robot] = Moved {
                at: [bodies.x[robot], bodies.y[robot]],
                velocity: [bodies.vx[robot], bodies.vy[robot]],
                driven: [number(0.0); 2],
            };
        }
        self.move_freely(bodies, robot);
        if self.involved.is_empty() {
            return;
        }
        for _ in 0..SUBSTEPS {
            self.substep(bodies, robot, place);
        }
        for index in 0..self.involved.len() {
            let robot = self.involved[index] as usize;
            let (near, moved) = (self.near[robot], self.moved[robot]);
            bodies.x[robot] = moved.at[0].select(bodies.x[robot], near);
            bodies.y[robot] = moved.at[1].select(bodies.y[robot], near);
            bodies.vx[robot] = moved.velocity[0].select(bodies.vx[robot], near);
            bodies.vy[robot] = moved.velocity[1].select(bodies.vy[robot], near);
        }
    }

    /// Finds who may touch what in this tick.
    #[inline(always)]
    fn find(&mut self, bodies: &Bodies<L>, neighbours: &Neighbours, robot: &Robot, place: &Place) {
        self.near.fill(L::Mask::from_bits(0));
        self.pairs.clear();
        self.walls.clear();
        self.involved.clear();
        let reach = 2.0 * robot.radius + REACH;
        let reach = number(reach * reach);
        for first in 0..bodies.len() {
            for other in neighbours.of(first) {
                let second = *other as usize;
                if second < first {
                    continue;
                }
                let close = square(bodies.between(first, second)).lt(reach);
                if close.any() {
                    self.near[first] = self.near[first].or(close);
                    self.near[second] = self.near[second].or(close);
                    self.pairs.push(([first as u32, *other], Contact::none()));
                }
            }
        }
        let reach = robot.radius + REACH / 2.0;
        let reach = number(reach * reach);
        for index in 0..bodies.len() {
            for (face, wall) in place.faces.iter().enumerate() {
                let close = square(to_face(wall, bodies.x[index], bodies.y[index])).lt(reach);
                if close.any() {
                    self.near[index] = self.near[index].or(close);
                    self.walls
                        .push((index as u32, face as u32, Contact::none()));
                }
            }
            if self.near[index].any() {
                self.involved.push(index as u32);
            }
        }
    }

    /// Ten substeps of robots that touch nothing, at once.
    #[inline(always)]
    fn move_freely(&mut self, bodies: &mut Bodies<L>, robot: &Robot) {
        let most = number::<L>(robot.acceleration * SUBSTEP);
        for index in 0..bodies.len() {
            let [ax, ay] = self.aim[index];
            let (vx, vy) = (bodies.vx[index], bodies.vy[index]);
            let (dx, dy) = (ax - vx, ay - vy);
            // The part of the change that a substep brings; infinite where there is none.
            let part = most / square([dx, dy]).sqrt();
            let (mut sum, mut done) = (number(0.0), number(0.0));
            for _ in 1..SUBSTEPS {
                done += part;
                sum += done.at_most(number(1.0));
            }
            let last = (done + part).at_most(number(1.0));
            let substeps = SUBSTEPS as f32;
            bodies.x[index] += (vx * substeps + dx * sum) * SUBSTEP;
            bodies.y[index] += (vy * substeps + dy * sum) * SUBSTEP;
            bodies.vx[index] = vx + dx * last;
            bodies.vy[index] = vy + dy * last;
        }
    }

    #[inline(always)]
    fn substep(&mut self, bodies: &Bodies<L>, robot: &Robot, place: &Place) {
        let Self {
            aim,
            involved,
            touched,
            pairs,
            walls,
            moved,
            ..
        } = self;
        for index in involved.iter() {
            let moved = &mut moved[*index as usize];
            moved.at[0] += moved.velocity[0] * SUBSTEP;
            moved.at[1] += moved.velocity[1] * SUBSTEP;
            moved.driven = [number(0.0); 2];
            touched[*index as usize] = L::Mask::from_bits(0);
        }
        let mut active = false;
        for ([first, second], contact) in pairs.iter_mut() {
            let (from, to) = (moved[*first as usize].at, moved[*second as usize].at);
            let way = [to[0] - from[0], to[1] - from[1]];
            contact.at(way, square(way), 2.0 * robot.radius);
            if contact.active {
                active = true;
                for index in [*first, *second] {
                    let touched = &mut touched[index as usize];
                    *touched = touched.or(contact.touches);
                }
            }
        }
        for (index, face, contact) in walls.iter_mut() {
            let [x, y] = moved[*index as usize].at;
            let way = to_face(&place.faces[*face as usize], x, y);
            contact.at(way, square(way), robot.radius);
            if contact.active {
                active = true;
                let touched = &mut touched[*index as usize];
                *touched = touched.or(contact.touches);
            }
        }
        let most = robot.acceleration * SUBSTEP;
        // Where nothing touches a robot the first pass is all.
        for pass in 0..if active { PASSES } else { 1 } {
            for ([first, second], contact) in pairs.iter_mut().filter(|(_, c)| c.active) {
                let (i, j) = (*first as usize, *second as usize);
                let [nx, ny] = contact.normal;
                let (u, v) = (moved[i].velocity, moved[j].velocity);
                let relative = [v[0] - u[0], v[1] - u[1]];
                let approach = relative[0] * nx + relative[1] * ny;
                let slip = relative[1] * nx
                    - relative[0] * ny
                    - (bodies.spin[i] + bodies.spin[j]) * robot.radius;
                let [px, py] = contact.push(approach, slip, 0.5, robot.friction[0]);
                moved[i].velocity = [u[0] - px, u[1] - py];
                moved[j].velocity = [v[0] + px, v[1] + py];
            }
            for (index, _, contact) in walls.iter_mut().filter(|(_, _, c)| c.active) {
                let i = *index as usize;
                let [nx, ny] = contact.normal;
                let u = moved[i].velocity;
                let approach = -(u[0] * nx + u[1] * ny);
                let slip = u[0] * ny - u[1] * nx - bodies.spin[i] * robot.radius;
                let [px, py] = contact.push(approach, slip, 1.0, robot.friction[1]);
                moved[i].velocity = [u[0] - px, u[1] - py];
            }
            for index in involved.iter() {
                let index = *index as usize;
                if pass > 0 && !touched[index].any() {
                    continue;
                }
                let Moved {
                    velocity, driven, ..
                } = &mut moved[index];
                let wanted = [
                    driven[0] + (aim[index][0] - velocity[0]),
                    driven[1] + (aim[index][1] - velocity[1]),
                ];
                let length = square(wanted);
                let long = number(most * most).lt(length);
                let factor = if long.any() {
                    (number::<L>(most) / length.sqrt()).select(number(1.0), long)
                } else {
                    number(1.0)
                };
                let mut given = [wanted[0] * factor, wanted[1] * factor];
                if pass > 0 {
                    for axis in 0..2 {
                        given[axis] = given[axis].select(driven[axis], touched[index]);
                    }
                }
                velocity[0] += given[0] - driven[0];
                velocity[1] += given[1] - driven[1];
                *driven = given;
            }
        }
    }
}
