//! Objects that robots push: discs and boxes that stand on the floor, held by Coulomb friction.

use swarmwright_controllers::functions::lanes::{cos_pi, sin_pi};
use swarmwright_lanes::{Lanes, MOST_LANES, Mask, Number, number};

use crate::place::{Form, Kind, LedColor, Pose};
use crate::time::PART;

/// Gravitational acceleration, m/s^2.
const GRAVITY: f32 = 9.81;

/// Maximum speed of a body, in radii per second, so that it cannot pass through a wall or another body in one part of a
/// tick.
pub const FASTEST: f32 = 50.0;

/// The constant properties of an object.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Object {
    /// Index of the object's kind.
    pub kind: usize,
    pub form: Form,
    pub height: f32,
    /// Radius of the circumscribed circle, metres.
    pub radius: f32,
    pub color: Option<LedColor>,
    /// Maximum speed, m/s, so that the object cannot pass through a wall.
    pub fastest: f32,
    /// Inverse mass, 1/kg, and inverse moment of inertia, 1/(kg m^2).
    pub light: f32,
    pub nimble: f32,
    /// Inverse squares of the largest changes of speed, (s/m)^2 and (s/rad)^2, that the friction of the floor makes in
    /// a part.
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

/// Pose and motion of an object.
#[derive(Debug, Clone, Copy)]
pub struct Moving<L> {
    pub x: Number<L>,
    pub y: Number<L>,
    /// Heading in half turns, -1..=1, with its cosine and sine.
    pub heading: Number<L>,
    pub cos: Number<L>,
    pub sin: Number<L>,
    /// Velocity, m/s.
    pub velocity: [Number<L>; 2],
    /// Angular velocity, rad/s.
    pub spin: Number<L>,
    /// Change of velocity by the friction of the floor in this part: m/s along x and y, and rad/s.
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

    /// Transforms a vector from the object's axes to the arena's axes.
    #[inline(always)]
    pub fn out(&self, [x, y]: [Number<L>; 2]) -> [Number<L>; 2] {
        [x * self.cos - y * self.sin, x * self.sin + y * self.cos]
    }

    /// Transforms a vector from the arena's axes to the object's axes.
    #[inline(always)]
    pub fn within(&self, [x, y]: [Number<L>; 2]) -> [Number<L>; 2] {
        [x * self.cos + y * self.sin, y * self.cos - x * self.sin]
    }

    #[inline(always)]
    pub fn turn(&mut self, heading: Number<L>) {
        let heading = (heading - number(2.0)).select(heading, heading.gt(number(1.0)));
        self.heading = (heading + 2.0).select(heading, heading.lt(number(-1.0)));
        self.cos = Number(cos_pi(self.heading.0));
        self.sin = Number(sin_pi(self.heading.0));
    }

    /// Returns whether the object moves in any lane.
    #[inline(always)]
    pub fn moves(&self) -> bool {
        let zero = number(0.0);
        let [vx, vy] = self.velocity;
        let mut moving = false;
        for number in [vx, vy, self.spin] {
            moving |= number.lt(zero).or(zero.lt(number)).any();
        }
        moving
    }

    /// Applies the friction of the floor, which stops the motion as far as it can: force and torque lie within an
    /// ellipsoid.
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

/// The extended surface in a contact, by its index.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Surface {
    Object(usize),
    Face(usize),
}

/// The point in a contact.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Point {
    /// The middle of a robot, which is a disc.
    Robot(usize),
    /// The middle of an object that is a disc.
    Center(usize),
    /// An object, and the index of a corner of its box.
    Corner(usize, usize),
    /// The end at which a face begins.
    End(usize),
}

/// A contact that is possible in a tick. Impulses are in N s.
#[derive(Clone, Copy)]
pub struct Touch<L: Lanes> {
    pub surface: Surface,
    pub point: Point,
    /// Key that identifies the contact in the next tick.
    pub key: [u32; 3],
    /// Lanes in which the contact is possible.
    pub lanes: L::Mask,
    /// Lanes in which the robot holds the object: the contact pulls as well as pushes, and does not slip.
    pub held: L::Mask,
    /// Unit vector from the surface to the point.
    pub normal: [Number<L>; 2],
    /// Vectors from the middles of both bodies to the point of contact.
    pub arms: [[Number<L>; 2]; 2],
    /// Effective masses along the normal and along the tangent, kg.
    pub masses: [Number<L>; 2],
    /// Speed of approach up to which the contact exerts no force in this part.
    pub slack: Number<L>,
    /// Impulses of a part along the normal and along the tangent.
    pub pressed: Number<L>,
    pub rubbed: Number<L>,
    pub active: bool,
}

/// The objects of the episodes in all lanes.
pub struct Objects<L: Lanes> {
    pub things: Vec<Object>,
    pub moving: Vec<Moving<L>>,
    /// Possible contacts in this tick, ascending by key, and those of the previous tick.
    pub touches: [Vec<Touch<L>>; 2],
    /// Whether any object moves or may touch something in this tick.
    pub awake: bool,
    /// Lanes in which a robot holds an object, by robot and object; empty if no robot has a gripper.
    pub held: Vec<L::Mask>,
}

impl<L: Lanes> Default for Objects<L> {
    fn default() -> Self {
        Self::new(&[], 0)
    }
}

impl<L: Lanes> Objects<L> {
    /// Creates objects at rest. `grippers` is the number of robots if some have a gripper, else 0.
    pub fn new(kinds: &[Kind], grippers: usize) -> Self {
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
    pub fn start(&mut self, mut pose: impl FnMut(usize, usize) -> Pose) {
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

    /// Returns whether there are any objects.
    #[inline(always)]
    pub fn any(&self) -> bool {
        !self.things.is_empty()
    }

    /// Returns whether any object moves or may touch something in this tick.
    #[inline(always)]
    pub fn awake(&self) -> bool {
        self.awake
    }

    /// Applies the friction of the floor, at the beginning of a part, or `again` in one of its passes.
    #[inline(always)]
    pub fn rest(&mut self, again: bool) {
        if !self.awake {
            return;
        }
        for index in 0..self.moving.len() {
            let moving = &mut self.moving[index];
            let before = if again { moving.load } else { [number(0.0); 3] };
            moving.rest(&self.things[index], before);
        }
    }

    /// Returns the lanes in which a robot holds an object.
    #[inline(always)]
    pub fn held_by(&self, robot: usize) -> L::Mask {
        let count = self.things.len();
        let mut holds = L::Mask::from_bits(0);
        if !self.held.is_empty() {
            for object in 0..count {
                holds = holds.or(self.held[robot * count + object]);
            }
        }
        holds
    }

    /// Returns the lanes in which a robot holds this object.
    #[inline(always)]
    pub fn is_held(&self, object: usize) -> L::Mask {
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
    /// Returns the poses of the objects.
    pub fn poses(&self) -> impl Iterator<Item = Pose> + '_ {
        self.moving.iter().map(|moving| Pose {
            at: [moving.x.0, moving.y.0],
            heading: moving.heading.0,
        })
    }

    /// Moves the objects to new poses.
    pub fn put(&mut self, poses: impl Iterator<Item = Pose>) {
        for (moving, pose) in self.moving.iter_mut().zip(poses) {
            let [x, y] = pose.at.map(Number);
            (moving.x, moving.y) = (x, y);
            moving.turn(Number(pose.heading));
        }
    }
}
