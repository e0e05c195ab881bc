//! Poses and start regions.

use swarmwright_controllers::functions::{cos_pi, sin_pi};

/// Position and heading of a robot or object.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Pose {
    /// Position, metres.
    pub at: [f32; 2],
    /// Heading in half turns, -1..1.
    pub heading: f32,
}

/// A start region for robots or objects: a disc, a rectangle, or the part of the disc that lies in the rectangle.
#[derive(Debug, Clone, PartialEq)]
pub struct Start {
    /// Middle and radius, metres.
    pub disc: Option<([f32; 2], f32)>,
    /// Lower left and upper right corners, metres.
    pub rectangle: Option<([f32; 2], [f32; 2])>,
}

/// Returns a pose in the region, chosen by three numbers in 0..1.
pub fn pose(start: &Start, [a, b, c]: [f32; 3]) -> Pose {
    let at = match (start.disc, start.rectangle) {
        (Some((center, radius)), _) => {
            // For a uniform distribution in the disc, the larger number gives the radius, and the quotient of both
            // gives the angle.
            let (low, high) = if a < b { (a, b) } else { (b, a) };
            let angle = if high > 0.0 { 2.0 * (low / high) } else { 0.0 };
            let angle = if angle > 1.0 { angle - 2.0 } else { angle };
            let far = radius * high;
            [
                center[0] + far * cos_pi(angle),
                center[1] + far * sin_pi(angle),
            ]
        }
        (None, Some((low, high))) => [
            low[0] + (high[0] - low[0]) * a,
            low[1] + (high[1] - low[1]) * b,
        ],
        (None, None) => [0.0; 2],
    };
    Pose {
        at,
        heading: 2.0 * c - 1.0,
    }
}

/// Returns whether a point lies in the rectangle; true if there is none.
pub fn within(at: [f32; 2], start: &Start) -> bool {
    start.rectangle.is_none_or(|(low, high)| {
        (0..2).all(|axis| low[axis] <= at[axis] && at[axis] <= high[axis])
    })
}
