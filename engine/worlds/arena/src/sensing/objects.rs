//! Occlusion by objects, and intersections of rays with them.

use std::ops::Range;

use swarmwright_lanes::{Lanes, Mask, Number, number};

use crate::bodies::{Bodies, Moving, Object, Objects};
use crate::math::functions::absolute;
use crate::place::{Form, Light};
use crate::robots::Proximity;

/// Minimum magnitude of the components of a direction, which avoids division by 0.
const LEAST: f32 = 1e-12;

/// The section of a line inside an object, in multiples of the line's direction; undefined in lanes where `meets` is
/// false.
struct Crossing<L: Lanes> {
    from: Number<L>,
    to: Number<L>,
    meets: L::Mask,
}

impl<L: Lanes> Objects<L> {
    /// Shortens the rays of a robot that hit an object. `readings` has the distance from the start of each ray.
    #[inline(always)]
    pub fn shorten(
        &self,
        sensors: &Proximity,
        bodies: &Bodies<L>,
        index: usize,
        readings: &mut [Number<L>],
    ) {
        let (x, y) = (bodies.x[index], bodies.y[index]);
        let (cos, sin) = (bodies.cos[index], bodies.sin[index]);
        for object in 0..self.things.len() {
            let (item, moving) = (&self.things[object], &self.moving[object]);
            let way = [moving.x - x, moving.y - y];
            let reach = sensors.start + sensors.range + item.radius;
            let close = (way[0] * way[0] + way[1] * way[1]).lt(number(reach * reach));
            if !close.any() {
                continue;
            }
            for ray in 0..readings.len() {
                let [ax, ay] = sensors.rays[ray].along;
                let along = [cos * ax - sin * ay, sin * ax + cos * ay];
                let line = cross(item, moving, way, along);
                let distance = line.from - number(sensors.start);
                let visible = line
                    .meets
                    .and(number(sensors.least()).le(distance))
                    .and(close);
                let nearest = readings[ray];
                readings[ray] = distance.select(nearest, visible).at_most(nearest);
            }
        }
    }

    /// Returns the lanes in which an object stands between a point and the end of `way`.
    #[inline(always)]
    pub fn hide(&self, at: [Number<L>; 2], way: [Number<L>; 2]) -> L::Mask {
        self.hide_by(0..self.things.len(), at, way)
    }

    /// Same as [`Self::hide`] for an object as the target, which does not hide itself.
    #[inline(always)]
    pub fn hide_object(&self, object: usize, at: [Number<L>; 2], way: [Number<L>; 2]) -> L::Mask {
        let before = self.hide_by(0..object, at, way);
        before.or(self.hide_by(object + 1..self.things.len(), at, way))
    }

    #[inline(always)]
    fn hide_by(
        &self,
        objects: Range<usize>,
        [x, y]: [Number<L>; 2],
        way: [Number<L>; 2],
    ) -> L::Mask {
        let mut hidden = L::Mask::from_bits(0);
        for object in objects {
            let (item, moving) = (&self.things[object], &self.moving[object]);
            let line = cross(item, moving, [moving.x - x, moving.y - y], way);
            let between = number(0.0).lt(line.to).and(line.from.lt(number(1.0)));
            hidden = hidden.or(line.meets.and(between));
        }
        hidden
    }

    /// Returns the lanes in which an object intersects the line from the foot of a robot to a lamp.
    #[inline(always)]
    pub fn shade(&self, [x, y]: [Number<L>; 2], light: &Light) -> L::Mask {
        let way = [number(light.at[0]) - x, number(light.at[1]) - y];
        let mut hidden = L::Mask::from_bits(0);
        for object in 0..self.things.len() {
            let (item, moving) = (&self.things[object], &self.moving[object]);
            // Up to this fraction of the way the line is below the top of the object.
            let below = number((item.height / light.at[2]).min(1.0));
            let line = cross(item, moving, [moving.x - x, moving.y - y], way);
            let inside = number(0.0).le(line.from).and(line.from.le(below));
            hidden = hidden.or(line.meets.and(inside));
        }
        hidden
    }
}

/// Returns the crossing of a line with an object. `way` is the vector from the start of the line to the middle of the
/// object.
#[inline(always)]
fn cross<L: Lanes>(
    object: &Object,
    moving: &Moving<L>,
    way: [Number<L>; 2],
    along: [Number<L>; 2],
) -> Crossing<L> {
    match object.form {
        Form::Disc { radius } => {
            let square = along[0] * along[0] + along[1] * along[1];
            let forward = way[0] * along[0] + way[1] * along[1];
            let aside = way[0] * along[1] - way[1] * along[0];
            let depth = square * (radius * radius) - aside * aside;
            let meets = number(0.0).lt(depth);
            let half = depth.at_least(number(0.0)).sqrt();
            let inverse = (number::<L>(1.0) / square).only_where(meets);
            Crossing {
                from: (forward - half) * inverse,
                to: (forward + half) * inverse,
                meets,
            }
        }
        Form::Box { half } => {
            let (way, along) = (moving.within(way), moving.within(along));
            let (mut from, mut to) = (number(f32::MIN), number(f32::MAX));
            for axis in 0..2 {
                let least = absolute(along[axis]).lt(number(LEAST));
                let inverse = number::<L>(1.0) / number(LEAST).select(along[axis], least);
                let first = (way[axis] - number(half[axis])) * inverse;
                let second = (way[axis] + half[axis]) * inverse;
                from = first.at_most(second).at_least(from);
                to = first.at_least(second).at_most(to);
            }
            Crossing {
                from,
                to,
                meets: from.lt(to),
            }
        }
    }
}
