//! From what a mission says to what it means, with complaints that name the place.

mod objects;
mod overlap;

use std::collections::BTreeMap;

use super::super::failures;
use super::super::metrics::{self, Metric};
use super::super::place::{Face, Light, Patch, Place, Shape, Spot};
use super::super::polygon;
use super::super::settings::{LONGEST, mismatch_at, with_place};
use super::super::start::Start;
use super::super::team::Team;
use super::Mission;
use super::text::{
    Circle, Fitness, Obstacle, PatchText, Rectangle, SideColor, StartText, Sum, Text, Walls,
};
use swarmwright_simulation::ParameterError;
use swarmwright_simulation::parameters::wrong;

use overlap::overlaps;

/// Largest coordinate, metres.
const FARTHEST: f32 = 1000.0;
/// Coloured spots of a mission, at most: cameras look at each.
const MOST_SPOTS: usize = 1000;

/// A complaint about a part of a mission.
fn wrong_in(place: impl std::fmt::Display, reason: impl Into<String>) -> ParameterError {
    wrong(&format!("mission.{place}"), reason)
}

/// Checks that numbers are coordinates, not too far away.
fn coordinates(place: &str, numbers: &[f32]) -> Result<(), ParameterError> {
    let far = |number: &&f32| number.is_nan() || number.abs() > FARTHEST;
    match numbers.iter().find(far) {
        Some(number) => Err(wrong_in(
            place,
            format!("{number} found, expected numbers from -{FARTHEST} to {FARTHEST}"),
        )),
        None => Ok(()),
    }
}

/// Checks that a length is one.
fn length(place: &str, number: f32) -> Result<(), ParameterError> {
    if number > 0.0 && number <= FARTHEST {
        return Ok(());
    }
    Err(wrong_in(
        place,
        format!("{number} found, expected a number above 0, at most {FARTHEST}"),
    ))
}

/// Reads what is written.
pub(super) fn check(text: Text) -> Result<Mission, ParameterError> {
    if !(0.1..=LONGEST).contains(&text.duration) {
        return Err(wrong_in(
            "duration",
            format!(
                "{} found, expected seconds, 0.1 to {LONGEST}",
                text.duration
            ),
        ));
    }
    let team = Team::of_mission(text.robots.as_ref(), text.robot.as_ref())?;
    let failures = match &text.failures {
        Some(list) => failures::read(list, "mission.failures")?,
        None => Vec::new(),
    };
    let place = place(&text)?;
    let start = start("start", &text.start, &place)?;
    let mut metrics: Vec<(String, Metric)> = Vec::new();
    for (name, value) in text.metrics {
        metrics::check_name(&name).map_err(|reason| wrong_in("metrics", reason))?;
        let at = format!("mission.metrics.{name}");
        let metric: Metric =
            swarmwright_values::read_kind(&value).map_err(|mismatch| mismatch_at(&at, mismatch))?;
        metric
            .check(&place)
            .map_err(|error| with_place(&at, error))?;
        metrics.push((name, metric));
    }
    let (offset, given) = match text.fitness {
        Fitness::Metric(name) => (0.0, BTreeMap::from([(name, 1.0)])),
        Fitness::Sum(Sum { offset, factors }) => (offset, factors),
    };
    let mut others = metrics::general();
    others.retain(|(name, _)| !metrics.iter().any(|(known, _)| known == name));
    for name in given.keys() {
        if let Some(index) = others.iter().position(|(known, _)| known == name) {
            metrics.push(others.remove(index));
        } else if !metrics.iter().any(|(known, _)| known == name) {
            let names = metrics.iter().chain(&others);
            let names: Vec<_> = names.map(|(name, _)| name.as_str()).collect();
            let hint = match metrics::check_name(name) {
                Ok(()) => "",
                Err(_) => "; expressions of metrics are for the experiment's own fitness",
            };
            return Err(wrong_in(
                "fitness",
                format!(
                    "no metric is named {name:?}; there is {}{hint}",
                    names.join(", ")
                ),
            ));
        }
    }
    let factor = |(name, _): &(String, Metric)| given.get(name).copied().unwrap_or(0.0);
    let factors: Vec<f64> = metrics.iter().map(factor).collect();
    if let Some(number) = factors.iter().chain([&offset]).find(|n| !n.is_finite()) {
        return Err(wrong_in(
            "fitness",
            format!("{number} found, expected a finite number"),
        ));
    }
    Ok(Mission {
        title: text.title.unwrap_or_else(|| "Arena".to_owned()),
        duration: text.duration,
        team,
        failures,
        place,
        start,
        counted: metrics.len(),
        metrics: metrics.into_iter().chain(others).collect(),
        offset,
        factors,
    })
}

fn place(text: &Text) -> Result<Place, ParameterError> {
    let outline = outline(&text.walls)?;
    let convex = polygon::is_convex(&outline);
    length("walls.height", text.walls.height)?;
    let level = text.floor.color.level();
    let level = level.ok_or_else(|| wrong_in("floor.color", "only patches can be random"))?;
    let mut place = Place {
        faces: sides(&outline, text.walls.height, Some(convex)),
        outline,
        grey: grey("floor.color", level)?,
        ..Place::default()
    };
    for (index, stretch) in text.walls.colors.iter().enumerate() {
        let spots = colored(&format!("walls.colors[{index}]"), stretch, &place.faces)?;
        place.spots.extend(spots);
    }
    for (index, obstacle) in text.obstacles.iter().enumerate() {
        let at = format!("obstacles[{index}]");
        coordinates(&format!("{at}.center"), &obstacle.center)?;
        for size in obstacle.size {
            length(&format!("{at}.size"), size)?;
        }
        coordinates(&format!("{at}.angle"), &[obstacle.angle])?;
        length(&format!("{at}.height"), obstacle.height)?;
        let corners = corners(obstacle);
        if !overlaps(
            &place.outline,
            &Shape::Polygon {
                corners: corners.to_vec(),
            },
        ) {
            return Err(wrong_in(at, "the box lies outside of the walls"));
        }
        let faces = sides(&corners, obstacle.height, None);
        if let Some(color) = obstacle.color {
            let spots = |face: &Face| face.spots([0.0, 2.0 * face.half], color);
            place.spots.extend(faces.iter().flat_map(spots));
        }
        place.faces.extend(faces);
        place.boxes.push(corners);
    }
    objects::add(&text.objects, &mut place)?;
    for (index, patch) in text.floor.patches.iter().enumerate() {
        let at = format!("floor.patches[{index}]");
        if place.patch(&patch.name).is_some() {
            return Err(wrong_in(
                at,
                format!("another patch is named {:?}, too", patch.name),
            ));
        }
        let shape = shape(&at, patch)?;
        if !overlaps(&place.outline, &shape) {
            return Err(wrong_in(
                at,
                format!("the patch {:?} lies outside of the walls", patch.name),
            ));
        }
        let level = patch.color.level();
        place.patches.push(Patch {
            name: patch.name.clone(),
            shape,
            grey: level
                .map(|level| grey(&format!("{at}.color"), level))
                .transpose()?,
        });
    }
    for (index, lamp) in text.lights.iter().enumerate() {
        let at = format!("lights[{index}]");
        coordinates(&format!("{at}.at"), &lamp.at)?;
        if lamp.at[2] < 0.0 {
            return Err(wrong_in(
                format_args!("{at}.at"),
                format!("{} found as height, expected at least 0", lamp.at[2]),
            ));
        }
        if !(0.0..=FARTHEST).contains(&lamp.intensity) {
            return Err(wrong_in(
                format_args!("{at}.intensity"),
                format!("{} found, expected 0 to {FARTHEST}", lamp.intensity),
            ));
        }
        place.lights.push(Light {
            at: lamp.at,
            intensity: lamp.intensity,
            color: lamp.color,
        });
    }
    if place.spots.len() > MOST_SPOTS {
        return Err(wrong_in(
            "walls.colors",
            format!(
                "{} coloured spots found, one for 0.1 m of walls and obstacles, at most {MOST_SPOTS} are possible",
                place.spots.len()
            ),
        ));
    }
    Ok(place)
}

/// What cameras see of a stretch of a wall.
fn colored(at: &str, stretch: &SideColor, sides: &[Face]) -> Result<Vec<Spot>, ParameterError> {
    let Some(side) = sides.get(stretch.side) else {
        return Err(wrong_in(
            format_args!("{at}.side"),
            format!(
                "{} found, but the walls have the sides 0 to {}",
                stretch.side,
                sides.len() - 1
            ),
        ));
    };
    let whole = 2.0 * side.half;
    let (from, to) = (stretch.from, stretch.to.unwrap_or(whole));
    // A length that is written is not always that of the side to the last bit.
    if !(0.0 <= from && from < to && to <= whole * 1.0001) {
        return Err(wrong_in(
            at,
            format!("from {from} to {to} found, expected metres along the side, 0 to {whole}"),
        ));
    }
    Ok(side.spots([from, to.min(whole)], stretch.color))
}

fn grey(place: &str, level: f32) -> Result<f32, ParameterError> {
    if (0.0..=1.0).contains(&level) {
        return Ok(level);
    }
    Err(wrong_in(
        place,
        format!("{level} found, expected 0 (black) to 1 (white)"),
    ))
}

fn shape(at: &str, patch: &PatchText) -> Result<Shape, ParameterError> {
    match (&patch.circle, &patch.rectangle, &patch.polygon) {
        (None, None, Some(corners)) => {
            let at = format!("{at}.polygon");
            coordinates(&at, corners.as_flattened())?;
            let corners = polygon::tidy(corners).map_err(|reason| wrong_in(&at, reason))?;
            if !polygon::is_convex(&corners) {
                return Err(wrong_in(
                    at,
                    "the polygon has a corner that points inwards; expected a convex one, or several of them",
                ));
            }
            Ok(Shape::Polygon { corners })
        }
        (Some(circle), None, None) => {
            check_circle(&format!("{at}.circle"), circle)?;
            Ok(Shape::Circle {
                center: circle.center,
                radius: circle.radius,
            })
        }
        (None, Some(rectangle), None) => {
            let (low, high) = ends(&format!("{at}.rectangle"), rectangle)?;
            Ok(Shape::Box { low, high })
        }
        _ => Err(wrong_in(at, "expected circle, or rectangle, or polygon")),
    }
}

fn check_circle(at: &str, circle: &Circle) -> Result<(), ParameterError> {
    coordinates(&format!("{at}.center"), &circle.center)?;
    length(&format!("{at}.radius"), circle.radius)
}

/// Lower left and upper right corner.
fn ends(at: &str, rectangle: &Rectangle) -> Result<([f32; 2], [f32; 2]), ParameterError> {
    for (axis, [low, high]) in [("x", rectangle.x), ("y", rectangle.y)] {
        coordinates(&format!("{at}.{axis}"), &[low, high])?;
        if low >= high {
            return Err(wrong_in(
                format_args!("{at}.{axis}"),
                format!("[{low}, {high}] found, expected the lower number first"),
            ));
        }
    }
    let ([left, right], [low, high]) = (rectangle.x, rectangle.y);
    Ok(([left, low], [right, high]))
}

fn start(at: &str, text: &StartText, place: &Place) -> Result<Start, ParameterError> {
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
            return Err(wrong_in(
                at,
                "expected disc, or rectangle, or both: the part of the disc in the rectangle",
            ));
        }
    };
    if !overlaps(&place.outline, &shape) {
        return Err(wrong_in(at, "it lies outside of the walls"));
    }
    Ok(start)
}

/// The corners of the walls around, counter-clockwise.
fn outline(walls: &Walls) -> Result<Vec<[f32; 2]>, ParameterError> {
    match (walls.sides, walls.apothem, walls.rectangle, &walls.corners) {
        (Some(sides), Some(apothem), None, None) => {
            if !(3..=1000).contains(&sides) {
                return Err(wrong_in(
                    "walls.sides",
                    format!("{sides} found, expected 3 to 1000"),
                ));
            }
            length("walls.apothem", apothem)?;
            let radius = f64::from(apothem) / (std::f64::consts::PI / f64::from(sides)).cos();
            let corner = |corner: u32| {
                let angle = (f64::from(corner) - 0.5) / f64::from(sides);
                let (sin, cos) = (2.0 * std::f64::consts::PI * angle).sin_cos();
                [(radius * cos) as f32, (radius * sin) as f32]
            };
            Ok((0..sides).map(corner).collect())
        }
        (None, None, Some([width, height]), None) => {
            length("walls.rectangle[0]", width)?;
            length("walls.rectangle[1]", height)?;
            let [x, y] = [width / 2.0, height / 2.0];
            Ok(vec![[-x, -y], [x, -y], [x, y], [-x, y]])
        }
        (None, None, None, Some(corners)) => {
            coordinates("walls.corners", corners.as_flattened())?;
            polygon::tidy(corners).map_err(|reason| wrong_in("walls.corners", reason))
        }
        _ => Err(wrong_in(
            "walls",
            "expected sides and apothem, or rectangle, or corners",
        )),
    }
}

/// The sides of a polygon with counter-clockwise corners: seen from inside, with whether it is convex, or from outside.
fn sides(corners: &[[f32; 2]], height: f32, inside: Option<bool>) -> Vec<Face> {
    let next = corners.iter().cycle().skip(1);
    let side = |(from, to): (&[f32; 2], &[f32; 2])| match inside {
        Some(convex) => Face::new(*from, *to, height, convex),
        None => Face::new(*to, *from, height, false),
    };
    corners.iter().zip(next).map(side).collect()
}

/// The corners of a box, counter-clockwise.
fn corners(obstacle: &Obstacle) -> [[f32; 2]; 4] {
    let (sin, cos) = f64::from(obstacle.angle).to_radians().sin_cos();
    let [w, h] = obstacle.size.map(|size| f64::from(size) / 2.0);
    let corner = |x: f64, y: f64| {
        [
            (f64::from(obstacle.center[0]) + x * cos - y * sin) as f32,
            (f64::from(obstacle.center[1]) + x * sin + y * cos) as f32,
        ]
    };
    [corner(-w, -h), corner(w, -h), corner(w, h), corner(-w, h)]
}
