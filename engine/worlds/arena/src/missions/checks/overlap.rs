//! Checks that shapes lie within the walls.

use crate::math::polygon;
use crate::place::{Place, Shape};

/// Number of grid points along each axis.
const SAMPLES: u32 = 41;

/// Returns whether a shape has points inside a polygon.
pub(super) fn overlaps(outline: &[[f32; 2]], shape: &Shape) -> bool {
    let [low, high] = polygon::extent(outline);
    let is_in = |point: [f64; 2]| polygon::contains(outline, point);
    let (extent, thin) = match shape {
        Shape::Circle { center, radius } => {
            let far = polygon::distance(outline, *center);
            let thin = is_in(center.map(f64::from)) || far < f64::from(*radius);
            let ends = [-radius, *radius].map(|by| center.map(|middle| middle + by));
            (ends, thin)
        }
        Shape::Box {
            low: from,
            high: to,
        } => {
            // An unbounded side is clipped beyond the walls.
            let from = [0, 1].map(|axis| from[axis].max(low[axis] - 1.0));
            let to = [0, 1].map(|axis| to[axis].min(high[axis] + 1.0));
            let corners = [from, [to[0], from[1]], to, [from[0], to[1]]];
            ([from, to], crosses(outline, &corners))
        }
        Shape::Polygon { corners } => (polygon::extent(corners), crosses(outline, corners)),
    };
    thin || is_sampled(outline, shape, [low, high], extent)
}

/// Returns whether a convex polygon, however thin, crosses a side of the outline or has its middle inside.
fn crosses(outline: &[[f32; 2]], corners: &[[f32; 2]]) -> bool {
    let middle = [0, 1].map(|axis| {
        let sum: f64 = corners.iter().map(|corner| f64::from(corner[axis])).sum();
        sum / corners.len() as f64
    });
    polygon::contains(outline, middle) || polygon::cross(outline, corners)
}

/// Returns whether both contain a point of a grid over their common extent. This detects overlap if corners and sides
/// coincide.
fn is_sampled(
    outline: &[[f32; 2]],
    shape: &Shape,
    [mut low, mut high]: [[f32; 2]; 2],
    [from, to]: [[f32; 2]; 2],
) -> bool {
    for axis in 0..2 {
        low[axis] = low[axis].max(from[axis]);
        high[axis] = high[axis].min(to[axis]);
    }
    if low[0] >= high[0] || low[1] >= high[1] {
        return false;
    }
    (0..SAMPLES * SAMPLES).any(|index| {
        let at = |axis: usize, step: u32| {
            let part = (step as f32 + 0.5) / SAMPLES as f32;
            low[axis] + (high[axis] - low[axis]) * part
        };
        let point = [at(0, index % SAMPLES), at(1, index / SAMPLES)];
        let [x, y] = point.map(swarmwright_lanes::Number);
        shape.holds::<f32>(x, y) && polygon::contains(outline, point.map(f64::from))
    })
}

/// Returns whether a part of a shape lies within the walls; true if the walls are unknown.
pub(super) fn is_within(layout: &Place, shape: &Shape) -> bool {
    layout.outline.is_empty() || overlaps(&layout.outline, shape)
}
