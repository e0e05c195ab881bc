//! Objects that robots push: discs and boxes that stand on the floor, held by Coulomb friction.

use swarmwright_controllers::functions::lanes::{cos_pi, sin_pi};
use swarmwright_lanes::{Lanes, MOST_LANES, Mask, Number, number};

use crate::place::{Form, Kind, LedColor, Pose};
use crate::time::PART;

/// m/s^2.
const GRAVITY: f32 = 9.81;

/// Radii a second: nothing pushes a body faster, so that it does not go through a wall or another body in a part.
pub(crate) const FASTEST: f32 = 50.0;

/// What an object is.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Object {
    /// Index of its kind.
    pub kind: usize,
    pub form: Form,
    pub height: f32,
    /// Radius of the circle around it, metres.
    pub radius: f32,
    pub color: Option<LedColor>,
    /// Nothing pushes it faster, m/s, so that it does not go through a wall.
    pub fastest: f32,
    /// 1 / kg, and 1 / (kg m^2).
    pub light: f32,
    pub nimble: f32,
    /// (s/m)^2 and (s/rad)^2: 1 over the square of the largest change by the friction of the floor in a part.
    pub loose: [f32; 2],
}

impl Object {
    fn new(kind: usize, of: &Kind) -> Self {
        let inertia = of.form.inertia();
        let slower = of.friction * GRAVITY * PART;
        let turned = slower * of.form.lever() / inertia;
        Self {
            kind,
            form: of.form,
            height: of.height,
            radius: of.form.radius(),
            color: of.color,
            fastest: FASTEST * of.form.inner_radius(),
            light: 1.0 / of.mass,
            nimble: 1.0 / (of.mass * inertia),
            loose: [1.0 / (slower * slower), 1.0 / (turned * turned)],
        }
    }
}

/// Where an object is, and how it moves.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Moving<L> {
    pub x: Number<L>,
    pub y: Number<L>,
    /// Half turns, -1..=1, with its cosine and sine.
    pub heading: Number<L>,
    pub cos: Number<L>,
    pub sin: Number<L>,
    /// m/s.
    pub velocity: [Number<L>; 2],
    /// rad/s.
    pub spin: Number<L>,
    /// What the friction of the floor gives in this part: m/s along x and y, rad/s.
    pub load: [Number<L>; 3],
}

impl<L: Lanes> Moving<L> {
    #[inline(always)]
    fn at_rest() -> Self {
        let zero = number(0.0);
        Self {
            x: zero,
            y: zero,
            heading: zero,
            cos: number(1.0),
            sin: zero,
            velocity: [zero; 2],
            spin: zero,
            load: [zero; 3],
        }
    }

    /// Along the axes of the arena, of a vector along those of the object.
    #[inline(always)]
    pub(crate) fn out(&self, [x, y]: [Number<L>; 2]) -> [Number<L>; 2] {
        [x * self.cos - y * self.sin, x * self.sin + y * self.cos]
    }

    /// The other way round.
    #[inline(always)]
    pub(crate) fn within(&self, [x, y]: [Number<L>; 2]) -> [Number<L>; 2] {
        [x * self.cos + y * self.sin, y * self.cos - x * self.sin]
    }

    #[inline(always)]
    pub(crate) fn turn(&mut self, heading: Number<L>) {
        let heading = (heading - number(2.0)).select(heading, heading.gt(number(1.0)));
        self.heading = (heading + 2.0).select(heading, heading.lt(number(-1.0)));
        self.cos = Number(cos_pi(self.heading.0));
        self.sin = Number(sin_pi(self.heading.0));
    }

    /// Whether it moves in any lane.
    #[inline(always)]
    pub(crate) fn moves(&self) -> bool {
        let zero = number(0.0);
        let [vx, vy] = self.velocity;
        let mut moving = false;
        for number in [vx, vy, self.spin] {
            moving |= number.lt(zero).or(zero.lt(number)).any();
        }
        moving
    }

    /// The friction of the floor ends the motion, as far as it can: force and torque lie within an ellipsoid.
    #[inline(always)]
    fn rest(&mut self, object: &Object, before: [Number<L>; 3]) {
        let [vx, vy] = self.velocity;
        let impulse = [before[0] - vx, before[1] - vy, before[2] - self.spin];
        let [x, y, turn] = impulse;
        let used = (x * x + y * y) * object.loose[0] + turn * turn * object.loose[1];
        let part = (number::<L>(1.0) / used.sqrt()).at_most(number(1.0));
        self.load = [x * part, y * part, turn * part];
        self.velocity[0] += self.load[0] - before[0];
        self.velocity[1] += self.load[1] - before[1];
        self.spin += self.load[2] - before[2];
    }
}

/// What has an extent in a contact, by its index.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) enum Surface {
    Object(usize),
    Face(usize),
}

/// The point in a contact.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) enum Point {
    /// The middle of a robot, which is a disc.
    Robot(usize),
    /// The middle of an object that is a disc.
    Center(usize),
    /// An object, and which corner of its box.
    Corner(usize, usize),
    /// Where a face begins.
    End(usize),
}

/// A contact that is possible in a tick. Impulses in N s.
#[derive(Clone, Copy)]
pub(crate) struct Touch<L: Lanes> {
    pub surface: Surface,
    pub point: Point,
    /// By which it is found again in the next tick.
    pub key: [u32; 3],
    /// In which lanes it is possible.
    pub lanes: L::Mask,
    /// Lanes in which the robot holds the object: it pulls as well as pushes, and does not slip.
    pub held: L::Mask,
    /// From the surface to the point.
    pub normal: [Number<L>; 2],
    /// From the middles of both bodies to where they touch.
    pub arms: [[Number<L>; 2]; 2],
    /// kg: the mass that resists along the normal and along the tangent.
    pub masses: [Number<L>; 2],
    /// The speed of approach at which nothing happens in this part.
    pub slack: Number<L>,
    /// Impulse of a part along the normal and along the tangent.
    pub pressed: Number<L>,
    pub rubbed: Number<L>,
    pub active: bool,
}

/// The objects of as many episodes as there are lanes.
pub(crate) struct Objects<L: Lanes> {
    pub things: Vec<Object>,
    pub moving: Vec<Moving<L>>,
    /// What may touch in this tick, ascending by its key, and what could in the one before.
    pub touches: [Vec<Touch<L>>; 2],
    /// Whether anything can happen in this tick.
    pub awake: bool,
    /// By robot and object: in which lanes it is held; empty where robots have no grippers.
    pub held: Vec<L::Mask>,
}

impl<L: Lanes> Default for Objects<L> {
    fn default() -> Self {
        Self::new(&[], 0)
    }
}

impl<L: Lanes> Objects<L> {
    /// `grippers`: robots, where some of them have one.
    pub(crate) fn new(kinds: &[Kind], grippers: usize) -> Self {
        let mut items = Vec::new();
        for (index, kind) in kinds.iter().enumerate() {
            items.extend((0..kind.count()).map(|_| Object::new(index, kind)));
        }
        Self {
            moving: vec![Moving::at_rest(); items.len()],
            held: vec![L::Mask::from_bits(0); grippers * items.len()],
            things: items,
            touches: [Vec::new(), Vec::new()],
            awake: false,
        }
    }

    /// Starts an episode in each lane.
    #[inline(always)]
    pub(crate) fn start(&mut self, mut pose: impl FnMut(usize, usize) -> Pose) {
        self.touches[0].clear();
        self.held.fill(L::Mask::from_bits(0));
        for (index, moving) in self.moving.iter_mut().enumerate() {
            let mut lanes = [[0.0; MOST_LANES]; 3];
            let [x, y, heading] = &mut lanes;
            for lane in 0..L::WIDTH {
                let pose = pose(lane, index);
                [x[lane], y[lane]] = pose.at;
                heading[lane] = pose.heading;
            }
            *moving = Moving {
                x: Number::load(x),
                y: Number::load(y),
                ..Moving::at_rest()
            };
            moving.turn(Number::load(heading));
        }
    }

    /// Whether there are any.
    #[inline(always)]
    pub(crate) fn any(&self) -> bool {
        !self.things.is_empty()
    }

    /// Whether anything can happen in this tick.
    #[inline(always)]
    pub(crate) fn awake(&self) -> bool {
        self.awake
    }

    /// The friction of the floor, at the beginning of a part or again in one of its passes.
    #[inline(always)]
    pub(crate) fn rest(&mut self, again: bool) {
        if !self.awake {
            return;
        }
        for index in 0..self.moving.len() {
            let moving = &mut self.moving[index];
            let before = if again { moving.load } else { [number(0.0); 3] };
            moving.rest(&self.things[index], before);
        }
    }

    /// In which lanes a robot holds something.
    #[inline(always)]
    pub(crate) fn held_by(&self, robot: usize) -> L::Mask {
        let count = self.things.len();
        let mut holds = L::Mask::from_bits(0);
        if !self.held.is_empty() {
            for object in 0..count {
                holds = holds.or(self.held[robot * count + object]);
            }
        }
        holds
    }

    /// In which lanes robots hold an object.
    #[inline(always)]
    pub(crate) fn is_held(&self, object: usize) -> L::Mask {
        let mut holds = L::Mask::from_bits(0);
        let mut at = object;
        while at < self.held.len() {
            holds = holds.or(self.held[at]);
            at += self.things.len();
        }
        holds
    }
}

impl Objects<f32> {
    /// Their poses.
    pub(crate) fn poses(&self) -> impl Iterator<Item = Pose> + '_ {
        self.moving.iter().map(|moving| Pose {
            at: [moving.x.0, moving.y.0],
            heading: moving.heading.0,
        })
    }

    /// All are elsewhere.
    pub(crate) fn put(&mut self, poses: impl Iterator<Item = Pose>) {
        for (moving, pose) in self.moving.iter_mut().zip(poses) {
            let [x, y] = pose.at.map(Number);
            (moving.x, moving.y) = (x, y);
            moving.turn(Number(pose.heading));
        }
    }
}
