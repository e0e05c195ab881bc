//! Start regions of robots or objects, as described in a mission.

use swarmwright_simulation::ParameterError;
use swarmwright_simulation::parameters::wrong;

use super::limits::{coordinates, length};
use super::overlap::is_within;
use crate::missions::text::{Circle, Rectangle, StartText};
use crate::place::{Place, Shape, Start};

/// Reads a start region.
pub(super) fn start(at: &str, text: &StartText, layout: &Place) -> Result<Start, ParameterError> {
    let disc = text.disc.as_ref();
    if let Some(disc) = disc {
        check_circle(&format!("{at}.disc"), disc)?;
    }
    let rectangle = match &text.rectangle {
        Some(rectangle) => {
            let at = format!("{at}.rectangle");
            coordinates(&format!("{at}.x"), &rectangle.x)?;
            coordinates(&format!("{at}.y"), &rectangle.y)?;
            Some(ends(&at, rectangle)?)
        }
        None => None,
    };
    let start = Start {
        disc: disc.map(|disc| (disc.center, disc.radius)),
        rectangle,
    };
    let shape = match (start.disc, start.rectangle) {
        (Some((center, radius)), _) => Shape::Circle { center, radius },
        (None, Some((low, high))) => Shape::Box { low, high },
        (None, None) => {
            return Err(wrong(
                at,
                "expected disc, or rectangle, or both for the part of the disc in the rectangle",
            ));
        }
    };
    if !is_within(layout, &shape) {
        return Err(wrong(at, "lies outside the walls"));
    }
    Ok(start)
}

pub(super) fn check_circle(at: &str, circle: &Circle) -> Result<(), ParameterError> {
    coordinates(&format!("{at}.center"), &circle.center)?;
    length(&format!("{at}.radius"), circle.radius)
}

/// Returns the lower left and upper right corners.
pub(super) fn ends(
    at: &str,
    rectangle: &Rectangle,
) -> Result<([f32; 2], [f32; 2]), ParameterError> {
    for (axis, [low, high]) in [("x", rectangle.x), ("y", rectangle.y)] {
        coordinates(&format!("{at}.{axis}"), &[low, high])?;
        if low >= high {
            return Err(wrong(
                &format!("{at}.{axis}"),
                format!("[{low}, {high}] found, expected the lower number first"),
            ));
        }
    }
    let ([left, right], [low, high]) = (rectangle.x, rectangle.y);
    Ok(([left, low], [right, high]))
}
