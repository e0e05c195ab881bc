//! Distances of discs and corners of boxes to objects and walls.

use swarmwright_lanes::{Lanes, Mask, Number, number};

use super::super::bodies::{Moving, Object};
use super::super::math::functions::{absolute, square};
use super::super::place::{Face, Form, to_face};

/// Depth behind a face of an obstacle from which a corner of a box counts as being on the obstacle's other side,
/// metres.
const BEHIND: f32 = 0.005;

/// Position of a point relative to a surface.
pub struct Gap<L: Lanes> {
    pub normal: [Number<L>; 2],
    pub size: Number<L>,
    /// Vector from the middle of the surface's body to the point of contact.
    pub arm: [Number<L>; 2],
    pub valid: L::Mask,
}

/// Returns the distance from the rim of a disc to an object, metres. `at` is the middle of the disc.
#[inline(always)]
pub fn gap<L: Lanes>(
    object: &Object,
    moving: &Moving<L>,
    [x, y]: [Number<L>; 2],
    radius: f32,
) -> Number<L> {
    let gap = to_object(object, moving, [x - moving.x, y - moving.y], radius);
    gap.size.select(number(f32::MAX), gap.valid)
}

/// Returns the gap between an object and a disc of this radius. `way` is the vector from the middle of the object to
/// that of the disc.
#[inline(always)]
pub fn to_object<L: Lanes>(
    object: &Object,
    moving: &Moving<L>,
    way: [Number<L>; 2],
    radius: f32,
) -> Gap<L> {
    #[expect(clippy::disallowed_names, reason = "the number 1")]
    let (zero, one) = (number::<L>(0.0), number::<L>(1.0));
    match object.form {
        Form::Disc { radius: own } => {
            let length = square(way).sqrt();
            let valid = zero.lt(length);
            let inverse = (one / length).only_where(valid);
            let normal = [way[0] * inverse, way[1] * inverse];
            Gap {
                normal,
                size: length - number(own + radius),
                arm: [normal[0] * own, normal[1] * own],
                valid,
            }
        }
        Form::Box { half: [hx, hy] } => {
            let [x, y] = moving.within(way);
            // The nearest point of the box.
            let (px, py) = (x.within(-hx, hx), y.within(-hy, hy));
            let (dx, dy) = (x - px, y - py);
            let length = square([dx, dy]).sqrt();
            let outside = zero.lt(length);
            // For a point inside the box, the nearest side.
            let (depth_x, depth_y) = (number(hx) - absolute(x), number(hy) - absolute(y));
            let across = depth_x.lt(depth_y);
            let (left, below) = (x.lt(zero), y.lt(zero));
            let (sign_x, sign_y) = ((-one).select(one, left), (-one).select(one, below));
            let inverse = (one / length).only_where(outside);
            let nx = (dx * inverse).select(sign_x.only_where(across), outside);
            let ny = (dy * inverse).select(zero.select(sign_y, across), outside);
            let depth = depth_x.select(depth_y, across);
            let size = length.select(-depth, outside) - number(radius);
            let on_x = (sign_x * hx).select(px, across);
            let on_y = py.select(sign_y * hy, across);
            let arm = [px.select(on_x, outside), py.select(on_y, outside)];
            Gap {
                normal: moving.out([nx, ny]),
                size,
                arm: moving.out(arm),
                valid: zero.le(zero),
            }
        }
    }
}

/// Returns the gap between a face and a disc of this radius, or the corner of a box.
#[inline(always)]
pub fn to_wall<L: Lanes>(face: &Face, [x, y]: [Number<L>; 2], radius: f32, corner: bool) -> Gap<L> {
    let zero = number::<L>(0.0);
    let arm = [zero; 2];
    if !corner {
        let way = to_face(face, x, y);
        let length = square(way).sqrt();
        let valid = zero.lt(length);
        let inverse = (number::<L>(-1.0) / length).only_where(valid);
        let mut normal = [way[0] * inverse, way[1] * inverse];
        let mut size = length - number(radius);
        let ahead = face.ahead(x, y);
        let outside = ahead.lt(zero);
        if face.outer && outside.any() {
            // Pull back a body that was pressed out of the arena.
            let [ax, ay] = face.along;
            normal[0] = number::<L>(-ay).select(normal[0], outside);
            normal[1] = number::<L>(ax).select(normal[1], outside);
            size = (ahead - number(radius)).select(size, outside);
        }
        return Gap {
            normal,
            size,
            arm,
            valid,
        };
    }
    let ahead = face.ahead(x, y);
    let [ax, ay] = face.along;
    // Behind the outer wall of a convex arena, and beside its ends, a corner still touches it.
    let valid = if face.outer {
        zero.le(zero)
    } else {
        let side = (x - face.middle[0]) * ax + (y - face.middle[1]) * ay;
        let beside = absolute(side).le(number(face.half));
        beside.and(number(-BEHIND).lt(ahead))
    };
    Gap {
        normal: [number(-ay), number(ax)],
        size: ahead,
        arm,
        valid,
    }
}
