//! Objects that robots push: discs and boxes that stand on the floor, held by Coulomb friction.

mod gap;
mod grip;
mod place;
mod sight;
mod touch;

use swarmwright_controllers::functions::lanes::{cos_pi, sin_pi};
use swarmwright_lanes::{Lanes, MOST_LANES, Mask, Number, number};

use super::contact::{FASTEST, PART, slow_down};
use super::robot::{LedColor, TICK};
use super::start::{Pose, Start};
use super::team::Team;
pub(super) use place::{corners, distance, draw, free, overlap};
use touch::Touch;

/// Most objects of a mission.
pub(super) const MOST_OBJECTS: usize = 64;
/// m/s^2.
const GRAVITY: f32 = 9.81;
/// Points in each direction over which distances from the middle of a box are averaged.
const POINTS: u32 = 64;

/// What an object looks like from above.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Form {
    Disc {
        radius: f32,
    },
    /// Half of the extent along its own axes, metres.
    Box {
        half: [f32; 2],
    },
}

impl Form {
    /// Radius of the circle around it, metres.
    pub(super) fn radius(self) -> f32 {
        match self {
            Self::Disc { radius } => radius,
            Self::Box { half: [x, y] } => (x * x + y * y).sqrt(),
        }
    }

    /// Radius of the largest circle in it, metres.
    fn inner_radius(self) -> f32 {
        match self {
            Self::Disc { radius } => radius,
            Self::Box { half: [x, y] } => x.min(y),
        }
    }

    /// Moment of inertia of a kilogram, m^2.
    fn inertia(self) -> f32 {
        match self {
            Self::Disc { radius } => radius * radius / 2.0,
            Self::Box { half: [x, y] } => (x * x + y * y) / 3.0,
        }
    }

    /// The mean distance of its points from the middle, metres: the lever of the friction of an even pressure.
    fn lever(self) -> f32 {
        match self {
            Self::Disc { radius } => radius * (2.0 / 3.0),
            Self::Box { half } => {
                let part = |index: u32| (f64::from(index) + 0.5) / f64::from(POINTS);
                let [w, h] = half.map(f64::from);
                let sum: f64 = (0..POINTS * POINTS)
                    .map(|index| [w * part(index % POINTS), h * part(index / POINTS)])
                    .map(|[x, y]| (x * x + y * y).sqrt())
                    .sum();
                (sum / f64::from(POINTS * POINTS)) as f32
            }
        }
    }
}

/// Where objects of a kind are at the start.
#[derive(Debug, Clone, PartialEq)]
pub(super) enum Places {
    /// One, always there.
    Fixed(Pose),
    /// So many, drawn anew for each episode.
    Drawn(Start, usize),
}

/// Objects of the same form and name.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Kind {
    pub name: String,
    pub form: Form,
    /// Metres; it hides what lies lower.
    pub height: f32,
    /// Kilograms.
    pub mass: f32,
    /// Coefficient of friction with the floor.
    pub friction: f32,
    /// What cameras see.
    pub color: Option<LedColor>,
    pub places: Places,
}

impl Kind {
    pub(super) fn count(&self) -> usize {
        match self.places {
            Places::Fixed(_) => 1,
            Places::Drawn(_, count) => count,
        }
    }
}

/// What an object is.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Object {
    /// Index of its kind.
    pub kind: usize,
    pub form: Form,
    pub height: f32,
    /// Radius of the circle around it, metres.
    pub radius: f32,
    pub color: Option<LedColor>,
    /// Nothing pushes it faster, m/s, so that it does not go through a wall.
    fastest: f32,
    /// 1 / kg, and 1 / (kg m^2).
    light: f32,
    nimble: f32,
    /// (s/m)^2 and (s/rad)^2: 1 over the square of the largest change by the friction of the floor in a part.
    loose: [f32; 2],
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
pub(super) struct Moving<L> {
    pub x: Number<L>,
    pub y: Number<L>,
    /// Half turns, -1..=1, with its cosine and sine.
    pub heading: Number<L>,
    pub cos: Number<L>,
    pub sin: Number<L>,
    /// m/s.
    velocity: [Number<L>; 2],
    /// rad/s.
    spin: Number<L>,
    /// What the friction of the floor gives in this part: m/s along x and y, rad/s.
    load: [Number<L>; 3],
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
    fn out(&self, [x, y]: [Number<L>; 2]) -> [Number<L>; 2] {
        [x * self.cos - y * self.sin, x * self.sin + y * self.cos]
    }

    /// The other way round.
    #[inline(always)]
    fn within(&self, [x, y]: [Number<L>; 2]) -> [Number<L>; 2] {
        [x * self.cos + y * self.sin, y * self.cos - x * self.sin]
    }

    #[inline(always)]
    fn turn(&mut self, heading: Number<L>) {
        let heading = (heading - number(2.0)).select(heading, heading.gt(number(1.0)));
        self.heading = (heading + 2.0).select(heading, heading.lt(number(-1.0)));
        self.cos = Number(cos_pi(self.heading.0));
        self.sin = Number(sin_pi(self.heading.0));
    }

    /// Whether it moves in any lane.
    #[inline(always)]
    fn moves(&self) -> bool {
        let zero = number(0.0);
        let [vx, vy] = self.velocity;
        let mut some = false;
        for number in [vx, vy, self.spin] {
            some |= number.lt(zero).or(zero.lt(number)).any();
        }
        some
    }

    /// The friction of the floor ends the motion, as far as it can: force and torque lie within an ellipsoid.
    #[inline(always)]
    fn rest(&mut self, object: &Object, before: [Number<L>; 3]) {
        let [vx, vy] = self.velocity;
        let wanted = [before[0] - vx, before[1] - vy, before[2] - self.spin];
        let [x, y, turn] = wanted;
        let used = (x * x + y * y) * object.loose[0] + turn * turn * object.loose[1];
        let part = (number::<L>(1.0) / used.sqrt()).at_most(number(1.0));
        self.load = [x * part, y * part, turn * part];
        self.velocity[0] += self.load[0] - before[0];
        self.velocity[1] += self.load[1] - before[1];
        self.spin += self.load[2] - before[2];
    }
}

/// The objects of as many episodes as there are lanes.
pub(super) struct Objects<L: Lanes> {
    pub things: Vec<Object>,
    pub moving: Vec<Moving<L>>,
    /// What may touch in this tick, ascending by its key, and what could in the one before.
    touches: [Vec<Touch<L>>; 2],
    /// Whether anything can happen in this tick.
    awake: bool,
    /// By robot and object: in which lanes it is held; empty where robots have no grippers.
    held: Vec<L::Mask>,
}

impl<L: Lanes> Default for Objects<L> {
    fn default() -> Self {
        Self::new(&[], 0)
    }
}

impl<L: Lanes> Objects<L> {
    /// `grippers`: robots, where some of them have one.
    pub(super) fn new(kinds: &[Kind], grippers: usize) -> Self {
        let mut things = Vec::new();
        for (index, kind) in kinds.iter().enumerate() {
            things.extend((0..kind.count()).map(|_| Object::new(index, kind)));
        }
        Self {
            moving: vec![Moving::at_rest(); things.len()],
            held: vec![L::Mask::from_bits(0); grippers * things.len()],
            things,
            touches: [Vec::new(), Vec::new()],
            awake: false,
        }
    }

    /// Goes to the start of an episode in each lane.
    #[inline(always)]
    pub(super) fn start(&mut self, mut pose: impl FnMut(usize, usize) -> Pose) {
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
    pub(super) fn any(&self) -> bool {
        !self.things.is_empty()
    }

    /// Whether anything can happen in this tick.
    #[inline(always)]
    pub(super) fn awake(&self) -> bool {
        self.awake
    }

    /// The friction of the floor, at the beginning of a part or again in one of its passes.
    #[inline(always)]
    pub(super) fn rest(&mut self, again: bool) {
        if !self.awake {
            return;
        }
        for index in 0..self.moving.len() {
            let moving = &mut self.moving[index];
            let before = if again { moving.load } else { [number(0.0); 3] };
            moving.rest(&self.things[index], before);
        }
    }

    /// The motion of a part.
    #[inline(always)]
    pub(super) fn advance(&mut self, team: &Team) {
        if !self.awake {
            return;
        }
        let fastest = touch::way(team) / TICK;
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

impl Objects<f32> {
    /// Where they are.
    pub(super) fn poses(&self) -> impl Iterator<Item = Pose> + '_ {
        self.moving.iter().map(|moving| Pose {
            at: [moving.x.0, moving.y.0],
            heading: moving.heading.0,
        })
    }

    /// All are elsewhere.
    pub(super) fn put(&mut self, poses: impl Iterator<Item = Pose>) {
        for (moving, pose) in self.moving.iter_mut().zip(poses) {
            let [x, y] = pose.at.map(Number);
            (moving.x, moving.y) = (x, y);
            moving.turn(Number(pose.heading));
        }
    }
}
