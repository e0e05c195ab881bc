//! Faces of walls.

use swarmwright_lanes::{Lanes, Number};

/// A face of a wall. Robots are in front of it, on the side of its normal, or pass its ends.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Face {
    /// Middle, metres.
    pub middle: [f32; 2],
    /// Unit vector from one end to the other.
    pub along: [f32; 2],
    /// Half of the length, metres.
    pub half: f32,
    /// Height, metres; the face hides anything lower.
    pub height: f32,
    /// Whether the face is a side of a convex arena: no robot is behind it, and it never lies between two robots.
    pub outer: bool,
}

impl Face {
    pub fn new(from: [f32; 2], to: [f32; 2], height: f32, outer: bool) -> Self {
        let [dx, dy] = [to[0] - from[0], to[1] - from[1]];
        let length = (dx * dx + dy * dy).sqrt();
        Self {
            middle: [(from[0] + to[0]) / 2.0, (from[1] + to[1]) / 2.0],
            along: [dx / length, dy / length],
            half: length / 2.0,
            height,
            outer,
        }
    }
}

impl Face {
    /// Returns the distance of points in front of the face's line.
    #[inline(always)]
    pub fn ahead<L: Lanes>(&self, x: Number<L>, y: Number<L>) -> Number<L> {
        (y - self.middle[1]) * self.along[0] - (x - self.middle[0]) * self.along[1]
    }

    /// Returns both ends.
    #[inline]
    pub fn ends(&self) -> [[f32; 2]; 2] {
        [-self.half, self.half].map(|end| {
            let [x, y] = self.middle;
            [x + end * self.along[0], y + end * self.along[1]]
        })
    }
}

/// Returns the vector from a point to the nearest point of a face.
#[inline(always)]
pub fn to_face<L: Lanes>(face: &Face, x: Number<L>, y: Number<L>) -> [Number<L>; 2] {
    let (dx, dy) = (x - face.middle[0], y - face.middle[1]);
    let s = (dx * face.along[0] + dy * face.along[1]).within(-face.half, face.half);
    [s * face.along[0] - dx, s * face.along[1] - dy]
}
