//! Contacts of robots with each other and with walls, and what they do in a part of a tick.

use swarmwright_lanes::{Lanes, Mask, Number, number};

use super::place::Face;
use super::swarm::SUBSTEP;

/// Length of a part, seconds.
pub(super) const PART: f32 = 2.0 * SUBSTEP;

/// What a contact has for the solver. Impulses are divided by the mass of a robot, of the first kind where two robots touch.
#[derive(Clone, Copy)]
pub(super) struct Contact<L: Lanes> {
    /// From the first robot to the other, or into the wall.
    pub normal: [Number<L>; 2],
    /// The speed of approach at which nothing happens in this part.
    slack: Number<L>,
    /// Impulse of a part along the normal and along the tangent.
    pub pressed: Number<L>,
    pub rubbed: Number<L>,
    /// Whether anything can happen in this part, in any lane.
    pub active: bool,
}

impl<L: Lanes> Contact<L> {
    #[inline(always)]
    pub(super) fn none() -> Self {
        Self {
            normal: [number(0.0); 2],
            slack: number(0.0),
            pressed: number(0.0),
            rubbed: number(0.0),
            active: false,
        }
    }

    /// At the beginning of a part: `way` between points that touch at a distance of `limit` and move with `speed` along it
    /// and across. `fastest`: no two bodies approach each other faster, m/s. `lanes`: where they may touch in this tick. Returns the impulse that the part begins with.
    #[inline(always)]
    pub(super) fn begin(
        &mut self,
        way: [Number<L>; 2],
        speed: [Number<L>; 2],
        (limit, fastest): (f32, f32),
        lanes: L::Mask,
    ) -> [Number<L>; 2] {
        let square = square(way);
        let far = limit + fastest * PART;
        // Middles that lie on each other press in no direction.
        let possible = square
            .lt(number(far * far))
            .and(number(0.0).lt(square))
            .and(lanes);
        self.active = possible.any();
        if !self.active {
            self.pressed = number(0.0);
            self.rubbed = number(0.0);
            return [number(0.0); 2];
        }
        let length = square.sqrt();
        let inverse = (number::<L>(1.0) / length).only_where(possible);
        self.normal = [way[0] * inverse, way[1] * inverse];
        let gap = length - number(limit);
        let closing = -(speed[0] * self.normal[0] + speed[1] * self.normal[1]);
        // Who overlaps after the first of two substeps approaches in that one alone; who does not, at least so fast that it
        // just touches.
        let first = gap.lt(closing * SUBSTEP);
        let slack = (closing * 0.5)
            .select(closing, first)
            .at_least(gap * (1.0 / PART));
        let slack = number::<L>(0.0).select(slack, gap.le(number(0.0)));
        self.slack = slack.select(number(f32::MAX), possible);
        self.pressed = self.pressed.only_where(possible);
        self.rubbed = self.rubbed.only_where(possible);
        self.along(self.pressed, self.rubbed)
    }

    /// The change of impulse that ends the approach, and what friction adds; `approach` and `slip` are the relative
    /// velocities along normal and tangent, `share` is the part of them that each body takes.
    #[inline(always)]
    pub(super) fn solve(
        &mut self,
        approach: Number<L>,
        slip: Number<L>,
        share: f32,
        friction: f32,
    ) -> [Number<L>; 2] {
        let pressed = (self.pressed - (approach + self.slack) * share).at_least(number(0.0));
        let limit = pressed * friction;
        let rubbed = (self.rubbed - slip * share).at_most(limit).at_least(-limit);
        let change = self.along(pressed - self.pressed, rubbed - self.rubbed);
        self.pressed = pressed;
        self.rubbed = rubbed;
        change
    }

    #[inline(always)]
    fn along(&self, pressed: Number<L>, rubbed: Number<L>) -> [Number<L>; 2] {
        let [nx, ny] = self.normal;
        [nx * pressed - ny * rubbed, ny * pressed + nx * rubbed]
    }

    #[inline(always)]
    pub(super) fn touches(&self) -> L::Mask {
        number(0.0).lt(self.pressed)
    }
}

/// A robot and, in each lane, a face of a wall.
#[derive(Clone, Copy)]
pub(super) struct WallContact<L: Lanes> {
    pub robot: u32,
    /// Index of the face; negative in lanes without one.
    pub face: Number<L>,
    middle: [Number<L>; 2],
    along: [Number<L>; 2],
    half: Number<L>,
    pub contact: Contact<L>,
}

impl<L: Lanes> WallContact<L> {
    #[inline(always)]
    pub(super) fn none(robot: u32) -> Self {
        Self {
            robot,
            face: number(-1.0),
            // Far away.
            middle: [number(1e6); 2],
            along: [number(1.0), number(0.0)],
            half: number(0.0),
            contact: Contact::none(),
        }
    }

    /// Takes a face in these lanes.
    #[inline(always)]
    pub(super) fn take(&mut self, index: u32, face: &Face, lanes: L::Mask) {
        self.face = number::<L>(index as f32).select(self.face, lanes);
        for axis in 0..2 {
            self.middle[axis] = number::<L>(face.middle[axis]).select(self.middle[axis], lanes);
            self.along[axis] = number::<L>(face.along[axis]).select(self.along[axis], lanes);
        }
        self.half = number::<L>(face.half).select(self.half, lanes);
    }

    /// Takes over the impulses of the tick before, where the face is the same.
    #[inline(always)]
    pub(super) fn inherit(&mut self, before: &Self) {
        let same = self.face.le(before.face).and(before.face.le(self.face));
        let (contact, before) = (&mut self.contact, &before.contact);
        contact.pressed = before.pressed.select(contact.pressed, same);
        contact.rubbed = before.rubbed.select(contact.rubbed, same);
    }

    /// From a point to the nearest one of the face.
    #[inline(always)]
    pub(super) fn way(&self, [x, y]: [Number<L>; 2]) -> [Number<L>; 2] {
        let (dx, dy) = (x - self.middle[0], y - self.middle[1]);
        let s = dx * self.along[0] + dy * self.along[1];
        let s = s.at_most(self.half).at_least(-self.half);
        [s * self.along[0] - dx, s * self.along[1] - dy]
    }
}

/// From a point to the nearest point of a face.
#[inline(always)]
pub(super) fn to_face<L: Lanes>(face: &Face, x: Number<L>, y: Number<L>) -> [Number<L>; 2] {
    let (dx, dy) = (x - face.middle[0], y - face.middle[1]);
    let s = (dx * face.along[0] + dy * face.along[1]).within(-face.half, face.half);
    [s * face.along[0] - dx, s * face.along[1] - dy]
}

#[inline(always)]
pub(super) fn square<L: Lanes>([x, y]: [Number<L>; 2]) -> Number<L> {
    x * x + y * y
}
