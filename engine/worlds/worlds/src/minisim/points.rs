//! Positions on the map.

/// A position, x and y.
pub(super) type Point = [f32; 2];

pub(super) fn squared_distance(from: Point, to: Point) -> f32 {
    let (dx, dy) = (to[0] - from[0], to[1] - from[1]);
    dx * dx + dy * dy
}
