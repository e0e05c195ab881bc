//! Distances of robots from a formation.

use serde::Deserialize;

use super::shapes::on_circle;
use super::state::{State, center, square, sum};
use crate::math::polygon;

/// Minimum and maximum number of points along a circle, a polygon or a line.
const POINTS: [usize; 2] = [64, 1024];
/// Number of points for each robot; if robots are evenly spaced, four give the exact mean distance.
const POINTS_PER_ROBOT: usize = 4;
/// Number of directions in which a formation is tried first.
const DIRECTIONS: u32 = 36;
/// Number of times that the angle around the best direction is then halved, down to 0.04 degrees.
const HALVINGS: i32 = 8;

/// A formation as described in a mission. Exactly one of its forms is given.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Formation {
    /// Radius of a circle, metres.
    pub(super) circle: Option<f32>,
    /// Corners of a polygon.
    pub(super) polygon: Option<Vec<[f32; 2]>>,
    /// Ends of a line.
    pub(super) line: Option<[[f32; 2]; 2]>,
    /// A position for each robot.
    pub(super) points: Option<Vec<[f32; 2]>>,
    /// Whether the formation is at the given coordinates; else it is centred on the robots.
    #[serde(default)]
    fixed: bool,
    /// Whether the formation may be rotated; the direction with the smallest deviation counts.
    #[serde(default)]
    turned: bool,
}

impl Formation {
    /// Returns the formation for this many robots.
    #[inline]
    pub(super) fn outline(&self, robots: usize) -> Outline {
        let count = (POINTS_PER_ROBOT * robots).clamp(POINTS[0], POINTS[1]);
        let part = |index: usize| (index as f64 + 0.5) / count as f64;
        if let Some(radius) = self.circle {
            let radius = f64::from(radius);
            let points = (0..count).map(|index| on_circle([0.0; 2], radius, part(index)));
            return Outline {
                points: points.collect(),
                form: Form::Circle { radius },
                centroid: [0.0; 2],
            };
        }
        if let Some(corners) = &self.polygon {
            let corners = polygon::tidy(corners).unwrap_or_default();
            let sides: Vec<Side> = polygon::sides(&corners)
                .map(|side| side.map(|end| end.map(f64::from)))
                .collect();
            return Outline {
                points: polygon::along(&corners, count),
                centroid: centroid(&sides),
                form: Form::Sides(sides),
            };
        }
        if let Some(ends) = self.line {
            let [from, to] = ends.map(|end| end.map(f64::from));
            let at = |index: usize| {
                [0, 1].map(|axis| from[axis] + (to[axis] - from[axis]) * part(index))
            };
            return Outline {
                points: (0..count).map(at).collect(),
                form: Form::Sides(vec![[from, to]]),
                centroid: [0, 1].map(|axis| (from[axis] + to[axis]) / 2.0),
            };
        }
        let points = self.points.iter().flatten();
        let points: Vec<[f64; 2]> = points.map(|point| point.map(f64::from)).collect();
        let count = points.len() as f64;
        Outline {
            centroid: sum(points.iter().copied()).map(|total| total / count),
            form: Form::Points,
            points,
        }
    }
}

/// Both ends of a side, metres.
type Side = [[f64; 2]; 2];

/// Returns the mean of all points on the sides.
#[inline]
fn centroid(sides: &[Side]) -> [f64; 2] {
    let length = |[from, to]: &Side| square(*from, *to).sqrt();
    let total: f64 = sides.iter().map(length).sum();
    let parts = sides.iter().map(|side| {
        let [from, to] = side;
        let weight = length(side) / (2.0 * total);
        [(from[0] + to[0]) * weight, (from[1] + to[1]) * weight]
    });
    sum(parts)
}

#[derive(Debug)]
enum Form {
    /// A circle around the origin.
    Circle {
        radius: f64,
    },
    Sides(Vec<Side>),
    /// Only the points of the outline.
    Points,
}

/// A formation prepared for measurement.
#[derive(Debug)]
pub(super) struct Outline {
    form: Form,
    /// Positions for robots, or evenly spaced points of the form.
    points: Vec<[f64; 2]>,
    centroid: [f64; 2],
}

impl Outline {
    /// Returns the distance from a point to the nearest point of the formation.
    #[inline]
    fn distance(&self, at: [f64; 2]) -> f64 {
        match &self.form {
            Form::Circle { radius } => (square(at, [0.0; 2]).sqrt() - radius).abs(),
            Form::Sides(sides) => {
                let squares = sides.iter().map(|side| square(at, foot(*side, at)));
                squares.fold(f64::INFINITY, f64::min).sqrt()
            }
            Form::Points => {
                let squares = self.points.iter().map(|point| square(at, *point));
                squares.fold(f64::INFINITY, f64::min).sqrt()
            }
        }
    }

    /// Returns the average of the mean distance from formation to robots and the mean distance from robots to
    /// formation.
    #[inline]
    pub(super) fn deviation(&self, robots: &[State], shape: &Formation) -> f64 {
        let center = if shape.fixed {
            self.centroid
        } else {
            center(robots)
        };
        let mut placed = Vec::with_capacity(robots.len());
        // Rotating the robots the opposite way is cheaper than rotating the formation.
        let mut turned = |part: f64| {
            let [cos, sin] = if part == 0.0 {
                [1.0, 0.0]
            } else {
                on_circle([0.0; 2], 1.0, (1.5 + part).fract())
            };
            placed.clear();
            placed.extend(robots.iter().map(|robot| {
                let (dx, dy) = (robot.at[0] - center[0], robot.at[1] - center[1]);
                [
                    self.centroid[0] + dx * cos + dy * sin,
                    self.centroid[1] + dy * cos - dx * sin,
                ]
            }));
            let back: f64 = placed.iter().map(|at| self.distance(*at)).sum();
            let forth = mean_to_nearest(&self.points, &mut placed);
            (forth + back / robots.len() as f64) / 2.0
        };
        let mut least = turned(0.0);
        if !shape.turned {
            return least;
        }
        let mut best = 0.0;
        let mut attempt = |part: f64, best: &mut f64| {
            let value = turned(part);
            if value < least {
                (least, *best) = (value, part);
            }
        };
        let step = 1.0 / f64::from(DIRECTIONS);
        for direction in 1..DIRECTIONS {
            attempt(f64::from(direction) * step, &mut best);
        }
        for halving in 1..=HALVINGS {
            let nearer = step * 0.5_f64.powi(halving);
            let middle = best;
            attempt(middle - nearer, &mut best);
            attempt(middle + nearer, &mut best);
        }
        least
    }
}

/// Returns the point of a side that is nearest to a point.
#[inline]
fn foot([from, to]: Side, at: [f64; 2]) -> [f64; 2] {
    let (dx, dy) = (to[0] - from[0], to[1] - from[1]);
    let length = dx * dx + dy * dy;
    // The line may have length 0.
    let along = if length > 0.0 {
        (((at[0] - from[0]) * dx + (at[1] - from[1]) * dy) / length).clamp(0.0, 1.0)
    } else {
        0.0
    };
    [from[0] + along * dx, from[1] + along * dy]
}

/// Returns the mean distance from points to the nearest of some places. Sorts the places.
#[inline]
fn mean_to_nearest(points: &[[f64; 2]], places: &mut [[f64; 2]]) -> f64 {
    let extent = |axis: usize| {
        let numbers = places.iter().map(|spot| spot[axis]);
        let start = [f64::INFINITY, f64::NEG_INFINITY];
        let [low, high] = numbers.fold(start, |[low, high], number| {
            [low.min(number), high.max(number)]
        });
        high - low
    };
    let axis = usize::from(extent(1) > extent(0));
    places.sort_by(|a, b| a[axis].total_cmp(&b[axis]));
    let nearest = |point: &[f64; 2]| {
        let next = places.partition_point(|spot| spot[axis] < point[axis]);
        let mut least = f64::INFINITY;
        // Search outwards until the distance along the axis alone is too large.
        let mut look = |spot: &[f64; 2]| {
            least = least.min(square(*spot, *point));
            let aside = spot[axis] - point[axis];
            aside * aside > least
        };
        let _ = places[next..].iter().any(&mut look);
        let _ = places[..next].iter().rev().any(&mut look);
        least.sqrt()
    };
    points.iter().map(nearest).sum::<f64>() / points.len() as f64
}
