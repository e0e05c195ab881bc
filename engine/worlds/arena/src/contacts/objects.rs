//! Contacts of objects with robots, with each other and with walls.
//!
//! Every contact is between a point, or a disc around it, and a disc, a box or a face. A contact stops the approach
//! before the two bodies overlap in this part; existing overlap is pushed apart slowly.

use swarmwright_lanes::{Lanes, Mask, Number, number};

use super::super::bodies::{Bodies, Moving, Object, Objects, Point, Surface, Touch};
use super::super::math::functions::square;
use super::super::place::{Form, Place, to_face};
use super::super::robots::{MOST_RATIO, Team};
use super::super::time::{PART, TICK};
use super::contact::{SHARE, slow_down};
use super::gap::{to_object, to_wall};
use super::near::Moved;

/// Coefficients of friction between objects, and between objects and walls.
const FRICTION: [f32; 2] = [0.49, 0.07];
/// Maximum distance that an object moves in a tick, metres; more if robots are faster.
const WAY: f32 = 0.05;
/// Distance at the beginning of a part beyond which bodies do not touch in it, metres; more if robots are faster.
pub const NEAR: f32 = 0.02;
/// Overlap that is not corrected, metres, and the maximum speed at which more overlap is pushed apart, m/s.
const SLOP: f32 = 0.0002;
const APART: f32 = 0.05;

/// Returns the maximum distance that objects move in a tick, metres: as far as the fastest robot pushes them.
#[inline]
pub fn way(team: &Team) -> f32 {
    (team.fastest() * (TICK / 2.0)).max(WAY)
}

impl<L: Lanes> Objects<L> {
    /// Finds the possible contacts of this tick. Adds to `nearby` the lanes in which robots may touch an object.
    #[inline(always)]
    pub fn find(&mut self, bodies: &Bodies<L>, team: &Team, layout: &Place, nearby: &mut [u64]) {
        let Self {
            touches: [now, old],
            held,
            ..
        } = self;
        std::mem::swap(now, old);
        now.clear();
        self.awake = false;
        let way_of_objects = way(team);
        let mut at = 0;
        for index in 0..self.things.len() {
            let (object, moving) = (&self.things[index], &self.moving[index]);
            self.awake |= moving.moves();
            let mut list = List {
                now,
                old,
                at: &mut at,
                object: index as u32,
            };
            for other in 0..bodies.len() {
                let robot = team.robot(other);
                let reach = object.radius + robot.radius + team.gap() + way_of_objects;
                let way = [bodies.x[other] - moving.x, bodies.y[other] - moving.y];
                let close = square(way).lt(number(reach * reach));
                if close.any() {
                    nearby[other] |= close.bits();
                    let (surface, point) = (Surface::Object(index), Point::Robot(other));
                    list.add(surface, point, (0, other, 0), close);
                    if !held.is_empty() {
                        list.hold(held[other * self.things.len() + index]);
                    }
                }
            }
            let reach = object.radius + way_of_objects;
            for face in 0..layout.faces.len() {
                let way = to_face(&layout.faces[face], moving.x, moving.y);
                let close = square(way).lt(number(reach * reach));
                if !close.any() {
                    continue;
                }
                let surface = Surface::Face(face);
                if matches!(object.form, Form::Disc { .. }) {
                    list.add(surface, Point::Center(index), (1, face, 0), close);
                    continue;
                }
                for corner in 0..4 {
                    let point = Point::Corner(index, corner);
                    list.add(surface, point, (1, face, corner), close);
                }
                if !layout.faces[face].outer {
                    let (surface, point) = (Surface::Object(index), Point::End(face));
                    list.add(surface, point, (1, face, 4), close);
                }
            }
            for other in index + 1..self.things.len() {
                let (item, second) = (&self.things[other], &self.moving[other]);
                let way = [second.x - moving.x, second.y - moving.y];
                let reach = object.radius + item.radius + 2.0 * way_of_objects;
                let close = square(way).lt(number(reach * reach));
                if !close.any() {
                    continue;
                }
                match (object.form, item.form) {
                    (_, Form::Disc { .. }) => {
                        let (surface, point) = (Surface::Object(index), Point::Center(other));
                        list.add(surface, point, (2, other, 0), close);
                    }
                    (Form::Disc { .. }, _) => {
                        let (surface, point) = (Surface::Object(other), Point::Center(index));
                        list.add(surface, point, (2, other, 0), close);
                    }
                    _ => {
                        for corner in 0..8 {
                            let (surface, of) = if corner < 4 {
                                (index, other)
                            } else {
                                (other, index)
                            };
                            let point = Point::Corner(of, corner % 4);
                            list.add(Surface::Object(surface), point, (2, other, corner), close);
                        }
                    }
                }
            }
        }
        self.awake |= !self.touches[0].is_empty();
    }

    /// Begins a part with the current positions and the impulses of the previous part.
    #[inline(always)]
    pub fn begin(&mut self, moved: &mut [Moved<L>], at: (&Team, &Place)) {
        if self.held.is_empty() {
            self.begin_with::<false>(moved, at);
        } else {
            self.begin_with::<true>(moved, at);
        }
    }

    /// Implements [`Self::begin`]; `GRIPS` says whether robots have grippers.
    #[inline(always)]
    fn begin_with<const GRIPS: bool>(
        &mut self,
        moved: &mut [Moved<L>],
        (team, layout): (&Team, &Place),
    ) {
        let Self {
            things: items,
            moving,
            touches: [touches, _],
            ..
        } = self;
        let margin = NEAR.max(team.fastest() * PART);
        for touch in touches.iter_mut() {
            let (point, radius, arm) = point(touch.point, items, moving, moved, (team, layout));
            let gap = match touch.surface {
                Surface::Object(index) => {
                    let (object, moving) = (&items[index], &moving[index]);
                    let way = [point[0] - moving.x, point[1] - moving.y];
                    to_object(object, moving, way, radius)
                }
                Surface::Face(index) => {
                    let corner = matches!(touch.point, Point::Corner(..));
                    to_wall(&layout.faces[index], point, radius, corner)
                }
            };
            let possible = gap.size.lt(number(margin)).and(gap.valid).and(touch.lanes);
            touch.active = possible.any();
            touch.pressed = touch.pressed.only_where(possible);
            touch.rubbed = touch.rubbed.only_where(possible);
            if GRIPS {
                // Even without a contact in any lane: an object that slipped away in this part is not held in the next
                // one.
                touch.held = touch.held.and(possible);
            }
            if !touch.active {
                continue;
            }
            for axis in 0..2 {
                touch.normal[axis] = gap.normal[axis].only_where(possible);
                // A disc touches at its rim.
                let rim = gap.normal[axis] * radius;
                touch.arms[0][axis] = gap.arm[axis].only_where(possible);
                touch.arms[1][axis] = match touch.point {
                    Point::Center(_) => (-rim).only_where(possible),
                    _ => arm[axis].only_where(possible),
                };
            }
            let before = (gap.size * (1.0 / PART)).at_least(number(0.0));
            let overlap = ((gap.size + SLOP) * (SHARE / PART)).at_least(number(-APART));
            let slack = before + overlap.at_most(number(0.0));
            touch.slack = slack.select(number(f32::MAX), possible);
            if GRIPS {
                // A released object is no longer pulled.
                let pressed = touch.pressed.at_least(number(0.0));
                touch.pressed = touch.pressed.select(pressed, touch.held);
                let closing = (gap.size * (SHARE / PART)).within(-APART, APART);
                touch.slack = closing.select(touch.slack, touch.held);
            }
            touch.weigh(items, team);
            let impulse = touch.along(touch.pressed, touch.rubbed);
            touch.push(items, moving, moved, team, impulse);
            if let Point::Robot(index) = touch.point {
                moved[index].touched |= number(0.0).lt(touch.pressed).bits();
                if GRIPS {
                    moved[index].touched |= touch.held.bits();
                }
            }
        }
    }

    /// Solves all contacts once, in their order.
    #[inline(always)]
    pub fn solve(&mut self, moved: &mut [Moved<L>], team: &Team) {
        if self.held.is_empty() {
            self.solve_with::<false>(moved, team);
        } else {
            self.solve_with::<true>(moved, team);
        }
    }

    /// Implements [`Self::solve`]; `GRIPS` says whether robots have grippers.
    #[inline(always)]
    fn solve_with<const GRIPS: bool>(&mut self, moved: &mut [Moved<L>], team: &Team) {
        let Self {
            things: items,
            moving,
            touches: [touches, _],
            ..
        } = self;
        for touch in touches.iter_mut() {
            if !touch.active {
                continue;
            }
            let mut relative = [number(0.0); 2];
            let mut rim = number(0.0);
            let mut friction = FRICTION[1];
            match touch.point {
                Point::Robot(index) => {
                    relative = moved[index].velocity;
                    let robot = team.robot(index);
                    rim = moved[index].spin * robot.radius;
                    if GRIPS {
                        // The gripper is on a ring that turns freely.
                        rim = number(0.0).select(rim, touch.held);
                    }
                    friction = robot.friction[0];
                }
                Point::Center(index) | Point::Corner(index, _) => {
                    relative = moving[index].speed(touch.arms[1]);
                }
                Point::End(_) => {}
            }
            if let Surface::Object(index) = touch.surface {
                let [x, y] = moving[index].speed(touch.arms[0]);
                relative = [relative[0] - x, relative[1] - y];
                if matches!(touch.point, Point::Center(_) | Point::Corner(..)) {
                    friction = FRICTION[0];
                }
            }
            let [nx, ny] = touch.normal;
            let approach = -(relative[0] * nx + relative[1] * ny);
            let slip = relative[1] * nx - relative[0] * ny - rim;
            let free = touch.pressed + (approach - touch.slack) * touch.masses[0];
            let mut pressed = free.at_least(number(0.0));
            let limit = pressed * friction;
            let held = touch.rubbed - slip * touch.masses[1];
            let mut rubbed = held.at_most(limit).at_least(-limit);
            if GRIPS {
                pressed = free.select(pressed, touch.held);
                rubbed = held.select(rubbed, touch.held);
            }
            let impulse = touch.along(pressed - touch.pressed, rubbed - touch.rubbed);
            touch.pressed = pressed;
            touch.rubbed = rubbed;
            touch.push(items, moving, moved, team, impulse);
            if let Point::Robot(index) = touch.point {
                moved[index].touched |= number(0.0).lt(pressed).bits();
            }
        }
    }

    /// Moves the objects by a part of a tick.
    #[inline(always)]
    pub fn advance(&mut self, team: &Team) {
        if !self.awake {
            return;
        }
        let fastest = way(team) / TICK;
        for (moving, object) in self.moving.iter_mut().zip(&self.things) {
            if !moving.moves() {
                continue;
            }
            slow_down(&mut moving.velocity, fastest.min(object.fastest));
            let [vx, vy] = moving.velocity;
            moving.x += vx * PART;
            moving.y += vy * PART;
            let turn = moving.spin * (PART * std::f32::consts::FRAC_1_PI);
            moving.turn(moving.heading + turn);
        }
    }
}

/// List to which the contacts of an object are added.
struct List<'a, L: Lanes> {
    now: &'a mut Vec<Touch<L>>,
    old: &'a [Touch<L>],
    at: &'a mut usize,
    object: u32,
}

impl<L: Lanes> List<'_, L> {
    /// Adds a contact, with the impulses of the previous tick. The tuple orders contacts: group, index in it, and part.
    #[inline(always)]
    fn add(
        &mut self,
        surface: Surface,
        point: Point,
        (group, index, part): (u32, usize, usize),
        lanes: L::Mask,
    ) {
        let key = [self.object, group << 20 | index as u32, part as u32];
        let zero = number(0.0);
        let mut touch = Touch {
            surface,
            point,
            key,
            lanes,
            held: L::Mask::from_bits(0),
            normal: [zero; 2],
            arms: [[zero; 2]; 2],
            masses: [zero; 2],
            slack: zero,
            pressed: zero,
            rubbed: zero,
            active: false,
        };
        while *self.at < self.old.len() && self.old[*self.at].key < key {
            *self.at += 1;
        }
        if *self.at < self.old.len() && self.old[*self.at].key == key {
            let before = &self.old[*self.at];
            touch.pressed = before.pressed.only_where(lanes);
            touch.rubbed = before.rubbed.only_where(lanes);
        }
        self.now.push(touch);
    }

    /// Marks the lanes in which the robot of the last contact holds the object.
    #[inline(always)]
    fn hold(&mut self, lanes: L::Mask) {
        if let Some(touch) = self.now.last_mut() {
            touch.held = lanes;
        }
    }
}

impl<L: Lanes> Touch<L> {
    /// Computes the effective masses.
    #[inline(always)]
    fn weigh(&mut self, items: &[Object], team: &Team) {
        let [nx, ny] = self.normal;
        for (axis, along) in [[nx, ny], [-ny, nx]].into_iter().enumerate() {
            let mut inverse = number(0.0);
            if let Surface::Object(index) = self.surface {
                let turn = cross(self.arms[0], along);
                inverse += turn * turn * items[index].nimble + items[index].light;
            }
            match self.point {
                Point::Robot(index) => inverse += number(self.lightness(index, items, team)),
                Point::Center(index) | Point::Corner(index, _) => {
                    let turn = cross(self.arms[1], along);
                    inverse += turn * turn * items[index].nimble + items[index].light;
                }
                Point::End(_) => {}
            }
            self.masses[axis] = number::<L>(1.0) / inverse;
        }
    }

    /// Returns the change of a robot's velocity by an impulse of 1 N s.
    #[inline(always)]
    fn lightness(&self, robot: usize, items: &[Object], team: &Team) -> f32 {
        let light = 1.0 / team.robot(robot).mass;
        match self.surface {
            Surface::Object(index) => light.max(items[index].light / MOST_RATIO),
            Surface::Face(_) => light,
        }
    }

    #[inline(always)]
    fn along(&self, pressed: Number<L>, rubbed: Number<L>) -> [Number<L>; 2] {
        let [nx, ny] = self.normal;
        [nx * pressed - ny * rubbed, ny * pressed + nx * rubbed]
    }

    /// Applies an impulse to the point, and its opposite to the surface.
    #[inline(always)]
    fn push(
        &self,
        items: &[Object],
        moving: &mut [Moving<L>],
        moved: &mut [Moved<L>],
        team: &Team,
        [x, y]: [Number<L>; 2],
    ) {
        if let Surface::Object(index) = self.surface {
            moving[index].push(&items[index], self.arms[0], [-x, -y]);
        }
        match self.point {
            Point::Robot(index) => {
                let velocity = &mut moved[index].velocity;
                let light = self.lightness(index, items, team);
                velocity[0] += x * light;
                velocity[1] += y * light;
            }
            Point::Center(index) | Point::Corner(index, _) => {
                moving[index].push(&items[index], self.arms[1], [x, y]);
            }
            Point::End(_) => {}
        }
    }
}

impl<L: Lanes> Moving<L> {
    /// Returns the velocity of a point of the object, given relative to its middle.
    #[inline(always)]
    fn speed(&self, [x, y]: [Number<L>; 2]) -> [Number<L>; 2] {
        [
            self.velocity[0] - self.spin * y,
            self.velocity[1] + self.spin * x,
        ]
    }

    #[inline(always)]
    fn push(&mut self, object: &Object, arm: [Number<L>; 2], impulse: [Number<L>; 2]) {
        self.velocity[0] += impulse[0] * object.light;
        self.velocity[1] += impulse[1] * object.light;
        self.spin += cross(arm, impulse) * object.nimble;
    }

    /// Returns the vector from the middle to a corner of a box, 0 to 3 counter-clockwise from the lower left.
    #[inline(always)]
    fn corner(&self, [x, y]: [f32; 2], corner: usize) -> [Number<L>; 2] {
        let x = if corner == 1 || corner == 2 { x } else { -x };
        let y = if corner >= 2 { y } else { -y };
        self.out([number(x), number(y)])
    }
}

#[inline(always)]
fn cross<L: Lanes>(a: [Number<L>; 2], b: [Number<L>; 2]) -> Number<L> {
    a[0] * b[1] - a[1] * b[0]
}

/// Returns the point of a contact, the radius of the disc around it, and the vector to it from the middle of its body.
#[inline(always)]
fn point<L: Lanes>(
    point: Point,
    items: &[Object],
    moving: &[Moving<L>],
    moved: &[Moved<L>],
    (team, layout): (&Team, &Place),
) -> ([Number<L>; 2], f32, [Number<L>; 2]) {
    let none = [number(0.0); 2];
    match point {
        Point::Robot(index) => (moved[index].at, team.robot(index).radius, none),
        Point::Center(index) => {
            let of = &moving[index];
            ([of.x, of.y], items[index].radius, none)
        }
        Point::Corner(index, corner) => {
            let of = &moving[index];
            let half = match items[index].form {
                Form::Box { half } => half,
                Form::Disc { .. } => [0.0; 2],
            };
            let arm = of.corner(half, corner);
            ([of.x + arm[0], of.y + arm[1]], 0.0, arm)
        }
        Point::End(face) => {
            let [[x, y], _] = layout.faces[face].ends();
            ([number(x), number(y)], 0.0, none)
        }
    }
}
