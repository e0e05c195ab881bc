//! Areas and distances for the robots of one episode, measured at fixed points.

use super::state::square;
use crate::place::{Patch, Shape};

/// Spacing of the points of a grid, metres.
const GRID: f64 = 0.02;
/// Number of points along a line or a circle.
const POINTS: u32 = 64;

/// Returns the distance from a point to the nearest robot, at most `most`.
#[inline]
fn nearest(point: [f64; 2], robots: &[[f32; 2]], most: f32) -> f64 {
    let most = f64::from(most);
    let least = robots.iter().fold(most * most, |least, robot| {
        square(point, robot.map(f64::from)).min(least)
    });
    least.sqrt()
}

/// Returns the point of a circle at `share` of its circumference, 0..1.
#[inline]
pub(super) fn on_circle(center: [f32; 2], radius: f64, share: f64) -> [f64; 2] {
    // Uses the project's own functions, so that all machines have the same points.
    let half_turns = (2.0 * share - 1.0) as f32;
    let cos = f64::from(swarmwright_controllers::functions::cos_pi(half_turns));
    let sin = f64::from(swarmwright_controllers::functions::sin_pi(half_turns));
    [
        f64::from(center[0]) + radius * cos,
        f64::from(center[1]) + radius * sin,
    ]
}

/// Returns the area that discs of radius `disc` around robots cover within a circle around the origin, m^2.
#[inline]
pub(super) fn covered_area(robots: &[[f64; 2]], disc: f32, within: f32) -> f64 {
    let (disc, within) = (f64::from(disc), f64::from(within));
    let cells = (2.0 * within / GRID).ceil() as i64;
    let mut covered = 0_u64;
    for row in 0..cells {
        for column in 0..cells {
            let point = [row, column].map(|cell| (cell as f64 + 0.5) * GRID - within);
            if square(point, [0.0; 2]) < within * within
                && robots
                    .iter()
                    .any(|robot| square(point, *robot) <= disc * disc)
            {
                covered += 1;
            }
        }
    }
    covered as f64 * GRID * GRID
}

/// Returns the mean distance from points around the origin to the nearest robot that is on none of the patches.
#[inline]
pub(super) fn distance_around(
    robots: &[[f32; 2]],
    radius: f32,
    most: f32,
    outside: &[&Patch],
) -> f64 {
    let on = |robot: &[f32; 2]| {
        let [x, y] = robot.map(swarmwright_lanes::Number);
        outside.iter().any(|patch| patch.shape.holds::<f32>(x, y))
    };
    let robots: Vec<[f32; 2]> = robots.iter().filter(|robot| !on(robot)).copied().collect();
    let parts = f64::from(POINTS);
    let mut sum = 0.0;
    for ring in 0..POINTS {
        let far = f64::from(radius) * (f64::from(ring) + 0.5) / parts;
        for index in 0..POINTS {
            let point = on_circle([0.0; 2], far, (f64::from(index) + 0.5) / parts);
            sum += nearest(point, &robots, most);
        }
    }
    sum / (parts * parts)
}

/// Returns the mean distance from points of a rectangle to the nearest robot in it.
#[inline]
pub(super) fn distance_inside(robots: &[[f32; 2]], shape: &Shape, most: f32) -> f64 {
    let Shape::Box { low, high } = shape else {
        return f64::from(most);
    };
    let inside = |robot: &&[f32; 2]| {
        (0..2).all(|axis| low[axis] <= robot[axis] && robot[axis] <= high[axis])
    };
    let robots: Vec<[f32; 2]> = robots.iter().filter(inside).copied().collect();
    let parts = f64::from(POINTS);
    let at = |axis: usize, step: u32| {
        let (low, high) = (f64::from(low[axis]), f64::from(high[axis]));
        low + (high - low) * (f64::from(step) + 0.5) / parts
    };
    let mut sum = 0.0;
    for row in 0..POINTS {
        for column in 0..POINTS {
            sum += nearest([at(0, column), at(1, row)], &robots, most);
        }
    }
    sum / (parts * parts)
}

/// Returns the mean distance from points of a circle's rim to the nearest robot that is near the rim.
#[inline]
pub(super) fn distance_rim(robots: &[[f32; 2]], shape: &Shape, margin: f32, most: f32) -> f64 {
    let Shape::Circle { center, radius } = shape else {
        return f64::from(most);
    };
    let on_rim = |robot: &&[f32; 2]| {
        let away = square(center.map(f64::from), robot.map(f64::from)).sqrt() - f64::from(*radius);
        away.abs() <= f64::from(margin)
    };
    let robots: Vec<[f32; 2]> = robots.iter().filter(on_rim).copied().collect();
    let points = 16 * POINTS;
    let mut sum = 0.0;
    for index in 0..points {
        let share = (f64::from(index) + 0.5) / f64::from(points);
        sum += nearest(on_circle(*center, f64::from(*radius), share), &robots, most);
    }
    sum / f64::from(points)
}

/// Returns the mean age of the cells, then increments all ages.
#[inline]
pub(super) fn age(robots: &[[f32; 2]], side: f32, cells: u32, ages: &mut [u32]) -> f64 {
    let width = cells as usize;
    for robot in robots {
        let cell = |at: f32| {
            let cell = ((at / side + 0.5) * cells as f32).floor();
            (cell >= 0.0 && cell < cells as f32).then_some(cell as usize)
        };
        if let (Some(column), Some(row)) = (cell(robot[0]), cell(robot[1])) {
            ages[row * width + column] = 0;
        }
    }
    let sum: u64 = ages.iter().map(|age| u64::from(*age)).sum();
    for age in ages.iter_mut() {
        *age += 1;
    }
    sum as f64 / ages.len() as f64
}
