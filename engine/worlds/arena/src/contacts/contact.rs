//! A contact of a robot with another robot or with a wall, and its impulses in a part of a tick.

use swarmwright_lanes::{Lanes, Mask, Number, number};

use super::super::math::functions::square;
use super::super::time::{PART, SUBSTEP};

/// Fraction of the smaller radius by which robots may overlap before they are pushed apart; ARGoS leaves overlaps of
/// that size.
const TOLERANCE: f32 = 0.2;
/// Fraction of the excess overlap that is removed in a part.
pub const SHARE: f32 = 0.2;

/// A contact for the solver. Impulses are divided by the mass of the robot; if two robots touch, by the mass of the
/// first kind.
#[derive(Clone, Copy)]
pub struct Contact<L: Lanes> {
    /// Unit vector from the first robot to the other robot, or into the wall.
    pub normal: [Number<L>; 2],
    /// Speed of approach up to which the contact exerts no force in this part.
    slack: Number<L>,
    /// Impulses of a part along the normal and along the tangent.
    pub pressed: Number<L>,
    pub rubbed: Number<L>,
    /// Lanes in which the contact can act in this part, as bits.
    pub active: u64,
}

impl<L: Lanes> Contact<L> {
    #[inline(always)]
    pub fn none() -> Self {
        Self {
            normal: [number(0.0); 2],
            slack: number(0.0),
            pressed: number(0.0),
            rubbed: number(0.0),
            active: 0,
        }
    }

    /// Begins a part of a tick, and returns the impulse that it starts with.
    ///
    /// `way` is the vector between two points that touch at a distance of `limit`; `speed` is their relative velocity.
    /// `fastest` is the maximum speed of approach, m/s, and `smaller` the smaller radius.
    #[inline(always)]
    pub fn begin(
        &mut self,
        way: [Number<L>; 2],
        speed: [Number<L>; 2],
        (limit, smaller, fastest): (Number<L>, Number<L>, f32),
    ) -> [Number<L>; 2] {
        let square = square(way);
        let far = limit + fastest * PART;
        // If the middles coincide, there is no normal.
        let possible = square.lt(far * far).and(number(0.0).lt(square));
        self.active = possible.bits();
        if self.active == 0 {
            self.pressed = number(0.0);
            self.rubbed = number(0.0);
            return [number(0.0); 2];
        }
        let length = square.sqrt();
        let inverse = (number::<L>(1.0) / length).only_where(possible);
        self.normal = [way[0] * inverse, way[1] * inverse];
        let gap = length - limit;
        let closing = -(speed[0] * self.normal[0] + speed[1] * self.normal[1]);
        // Bodies that overlap after the first of two substeps may approach for that substep only; others may approach
        // until they just touch.
        let first = gap.lt(closing * SUBSTEP);
        let slack = (closing * 0.5)
            .select(closing, first)
            .at_least(gap * (1.0 / PART));
        let slack = number::<L>(0.0).select(slack, gap.le(number(0.0)));
        let deep = (gap + smaller * TOLERANCE).at_most(number(0.0));
        let slack = slack + deep * (SHARE / PART);
        self.slack = slack.select(number(f32::MAX), possible);
        self.pressed = self.pressed.only_where(possible);
        self.rubbed = self.rubbed.only_where(possible);
        self.along(self.pressed, self.rubbed)
    }

    /// Returns the change of impulse that stops the approach, with friction. `approach` and `slip` are the relative
    /// velocities along the normal and the tangent, `share` is the fraction of them that each body takes.
    #[inline(always)]
    pub fn solve(
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

    /// Returns the contact of a single lane.
    #[inline(always)]
    pub fn lane(&self, lane: usize) -> Contact<f32> {
        let [nx, ny] = &self.normal;
        Contact {
            normal: [Number(nx.lane(lane)), Number(ny.lane(lane))],
            slack: Number(self.slack.lane(lane)),
            pressed: Number(self.pressed.lane(lane)),
            rubbed: Number(self.rubbed.lane(lane)),
            active: 1,
        }
    }

    /// Sets the impulses of a lane.
    #[inline(always)]
    pub fn set_lane(&mut self, lane: usize, [pressed, rubbed]: [f32; 2]) {
        self.pressed.set_lane(lane, pressed);
        self.rubbed.set_lane(lane, rubbed);
    }

    #[inline(always)]
    fn along(&self, pressed: Number<L>, rubbed: Number<L>) -> [Number<L>; 2] {
        let [nx, ny] = self.normal;
        [nx * pressed - ny * rubbed, ny * pressed + nx * rubbed]
    }

    #[inline(always)]
    pub fn touches(&self) -> L::Mask {
        number(0.0).lt(self.pressed)
    }
}

/// Limits a velocity to `most`, m/s, for bodies that are squeezed out between heavier ones.
#[inline(always)]
pub fn slow_down<L: Lanes>(velocity: &mut [Number<L>; 2], most: f32) {
    let [x, y] = *velocity;
    let square = square([x, y]);
    let faster = square.gt(number(most * most));
    if !faster.any() {
        return;
    }
    let part = number::<L>(most) / square.sqrt();
    *velocity = [(x * part).select(x, faster), (y * part).select(y, faster)];
}
