//! Start positions of objects: outside walls and apart from each other.

use swarmwright_controllers::functions::{cos_pi, sin_pi};
use swarmwright_lanes::Number;
use swarmwright_simulation::counter::uniform;

use crate::place::area::{pose, within};
use crate::place::{Face, Form, Kind, MOST_OBJECTS, Place, Places, Pose, to_face};

/// Number of random draws for an object before it is reported as not fitting.
const TRIES: u64 = 2_000;
/// Identifies the random stream for objects.
const STREAM: u64 = 0x6F62_6A65_6374_7300;

/// Draws the poses of all objects, kind by kind. Objects without a fixed place are kept apart from walls and other
/// objects.
///
/// # Errors
/// Returns the index of the kind whose objects do not all fit, and how many of them did.
pub fn draw(kinds: &[Kind], layout: &Place, seed: u64) -> Result<Vec<Pose>, (usize, usize)> {
    let fixed = kinds.iter().filter_map(|kind| match kind.places {
        Places::Fixed(pose) => Some((kind.form, pose)),
        Places::Drawn(..) => None,
    });
    let mut occupied: Vec<(Form, Pose)> = fixed.collect();
    let mut poses = Vec::new();
    for (index, kind) in kinds.iter().enumerate() {
        let (start, count) = match &kind.places {
            Places::Fixed(pose) => {
                poses.push(*pose);
                continue;
            }
            Places::Drawn(start, count) => (start, *count),
        };
        for placed in 0..count {
            let number = (index * MOST_OBJECTS + placed) as u64;
            let pose = (0..TRIES)
                .map(|attempt| {
                    let of = |part| uniform(seed, STREAM, (number * TRIES + attempt) * 4 + part);
                    pose(start, [of(0), of(1), of(2)])
                })
                .find(|pose| {
                    let candidate = (kind.form, *pose);
                    within(pose.at, start)
                        && free(candidate, layout)
                        && !occupied.iter().any(|other| overlap(candidate, *other))
                });
            let pose = pose.ok_or((index, placed))?;
            occupied.push((kind.form, pose));
            poses.push(pose);
        }
    }
    Ok(poses)
}

/// Returns the corners of a box, counter-clockwise.
pub fn corners([x, y]: [f32; 2], pose: Pose) -> [[f32; 2]; 4] {
    let (cos, sin) = (cos_pi(pose.heading), sin_pi(pose.heading));
    let corner = |x: f32, y: f32| {
        [
            pose.at[0] + x * cos - y * sin,
            pose.at[1] + x * sin + y * cos,
        ]
    };
    [corner(-x, -y), corner(x, -y), corner(x, y), corner(-x, y)]
}

/// Returns whether an object is entirely inside the walls and outside obstacles.
pub fn free((form, pose): (Form, Pose), layout: &Place) -> bool {
    let off = |face: &Face| match form {
        Form::Disc { radius } => {
            let [x, y] = pose.at.map(Number);
            let [x, y] = to_face::<f32>(face, x, y).map(|number| number.0);
            x * x + y * y >= radius * radius
        }
        Form::Box { half } => {
            let [from, to] = face.ends();
            let across = [-face.along[1], face.along[0]];
            apart(&corners(half, pose), &[from, to], &[across])
                || apart(&corners(half, pose), &[from, to], &axes(pose))
        }
    };
    layout.faces.iter().all(off) && layout.is_free(pose.at.map(f64::from))
}

/// Returns whether two objects overlap.
pub fn overlap((a, at): (Form, Pose), (b, other): (Form, Pose)) -> bool {
    match (a, b) {
        (Form::Disc { radius }, _) => distance((b, other), at.at) < radius,
        (_, Form::Disc { radius }) => distance((a, at), other.at) < radius,
        (Form::Box { half: first }, Form::Box { half: second }) => {
            let (first, second) = (corners(first, at), corners(second, other));
            !apart(&first, &second, &axes(at)) && !apart(&first, &second, &axes(other))
        }
    }
}

/// Returns the distance from a point to the rim of an object, metres; 0 inside.
pub fn distance((form, pose): (Form, Pose), [x, y]: [f32; 2]) -> f32 {
    let [dx, dy] = [x - pose.at[0], y - pose.at[1]];
    match form {
        Form::Disc { radius } => ((dx * dx + dy * dy).sqrt() - radius).max(0.0),
        Form::Box { half } => {
            let (cos, sin) = (cos_pi(pose.heading), sin_pi(pose.heading));
            let ax = ((dx * cos + dy * sin).abs() - half[0]).max(0.0);
            let ay = ((dy * cos - dx * sin).abs() - half[1]).max(0.0);
            (ax * ax + ay * ay).sqrt()
        }
    }
}

/// Returns the directions of the sides of a box.
fn axes(pose: Pose) -> [[f32; 2]; 2] {
    let (cos, sin) = (cos_pi(pose.heading), sin_pi(pose.heading));
    [[cos, sin], [-sin, cos]]
}

/// Returns whether the projections of two sets of points on one of these axes are disjoint (separating axis theorem).
fn apart(first: &[[f32; 2]], second: &[[f32; 2]], axes: &[[f32; 2]]) -> bool {
    axes.iter().any(|[ax, ay]| {
        let extent = |points: &[[f32; 2]]| {
            let start = (f32::INFINITY, f32::NEG_INFINITY);
            points.iter().fold(start, |(low, high), [x, y]| {
                let at = x * ax + y * ay;
                (low.min(at), high.max(at))
            })
        };
        let ((low, high), (least, most)) = (extent(first), extent(second));
        high <= least || most <= low
    })
}
