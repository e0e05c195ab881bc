//! The place of a mission: walls, floor, obstacles and lights.

use swarmwright_simulation::ParameterError;
use swarmwright_simulation::parameters::wrong;

use super::limits::{FARTHEST, coordinates, length, required};
use super::objects;
use super::overlap::is_within;
use super::start::{check_circle, ends};
use crate::math::polygon;
use crate::missions::text::{
    Color, Floor, Lamp, Named, Obstacle, PatchText, SideColor, Text, Walls,
};
use crate::mistakes::{Mistakes, items, part};
use crate::place::{Face, Light, Patch, Place, Shape, Spot};

/// Maximum number of coloured spots in a mission, because cameras check each of them.
const MOST_SPOTS: usize = 1000;

/// Reads the place. If its walls are invalid, it has none, and checks that need walls are skipped.
pub(super) fn place(text: &Text, mistakes: &mut Mistakes) -> Place {
    let mut layout = Place::default();
    let walls = required(text.walls.as_ref(), "walls", "{rectangle: [4, 3]}");
    if let Some(walls) = mistakes.take(walls) {
        let built = build(&walls, &mut layout);
        mistakes.take(built);
    }
    for (at, obstacle) in items(text.obstacles.as_ref(), "mission.obstacles", mistakes) {
        mistakes.take(add_obstacle(&at, &obstacle, &mut layout));
    }
    objects::add(text.objects.as_ref(), &mut layout, mistakes);
    let floor = text
        .floor
        .as_ref()
        .map(|floor| part(floor, "mission.floor"));
    let floor: Floor = floor
        .and_then(|floor| mistakes.take(floor))
        .unwrap_or_default();
    layout.grey = mistakes.take(ground(&floor)).unwrap_or_default();
    for (at, patch) in items(floor.patches.as_ref(), "mission.floor.patches", mistakes) {
        mistakes.take(add_patch(&at, &patch, &mut layout));
    }
    for (at, lamp) in items(text.lights.as_ref(), "mission.lights", mistakes) {
        mistakes.take(add_light(&at, &lamp, &mut layout));
    }
    if layout.spots.len() > MOST_SPOTS {
        let count = layout.spots.len();
        mistakes.add(wrong(
            "mission.walls.colors",
            format!(
                "{count} coloured spots found, one for 0.1 m of walls and obstacles, at most {MOST_SPOTS} are possible"
            ),
        ));
    }
    layout
}

fn build(walls: &Walls, layout: &mut Place) -> Result<(), ParameterError> {
    let outline = outline(walls)?;
    let convex = polygon::is_convex(&outline);
    length("mission.walls.height", walls.height)?;
    layout.faces = sides(&outline, walls.height, Some(convex));
    layout.outline = outline;
    for (index, stretch) in walls.colors.iter().enumerate() {
        let at = format!("mission.walls.colors[{index}]");
        layout.spots.extend(colored(&at, stretch, &layout.faces)?);
    }
    Ok(())
}

fn add_obstacle(at: &str, obstacle: &Obstacle, layout: &mut Place) -> Result<(), ParameterError> {
    coordinates(&format!("{at}.center"), &obstacle.center)?;
    for size in obstacle.size {
        length(&format!("{at}.size"), size)?;
    }
    coordinates(&format!("{at}.angle"), &[obstacle.angle])?;
    length(&format!("{at}.height"), obstacle.height)?;
    let corners = corners(obstacle);
    let shape = Shape::Polygon {
        corners: corners.to_vec(),
    };
    if !is_within(layout, &shape) {
        return Err(wrong(at, "the box lies outside the walls"));
    }
    let faces = sides(&corners, obstacle.height, None);
    if let Some(color) = obstacle.color {
        let spots = |face: &Face| face.spots([0.0, 2.0 * face.half], color);
        layout.spots.extend(faces.iter().flat_map(spots));
    }
    layout.faces.extend(faces);
    layout.boxes.push(corners);
    Ok(())
}

fn ground(floor: &Floor) -> Result<f32, ParameterError> {
    let at = "mission.floor.color";
    let color = floor.color.as_ref().map(|color| part(color, at));
    let color = color.transpose()?.unwrap_or(Color::Named(Named::Grey));
    let level = color.level();
    grey(
        at,
        level.ok_or_else(|| wrong(at, "only patches can be random"))?,
    )
}

fn add_patch(at: &str, patch: &PatchText, layout: &mut Place) -> Result<(), ParameterError> {
    if layout.patch(&patch.name).is_some() {
        return Err(wrong(
            at,
            format!(
                "another patch is already named {:?}; choose another name",
                patch.name
            ),
        ));
    }
    let shape = shape(at, patch)?;
    if !is_within(layout, &shape) {
        return Err(wrong(
            at,
            format!("the patch {:?} lies outside the walls", patch.name),
        ));
    }
    let level = patch.color.level();
    layout.patches.push(Patch {
        name: patch.name.clone(),
        shape,
        grey: level
            .map(|level| grey(&format!("{at}.color"), level))
            .transpose()?,
    });
    Ok(())
}

fn add_light(at: &str, lamp: &Lamp, layout: &mut Place) -> Result<(), ParameterError> {
    coordinates(&format!("{at}.at"), &lamp.at)?;
    if lamp.at[2] < 0.0 {
        return Err(wrong(
            &format!("{at}.at"),
            format!("{} found as height, expected at least 0", lamp.at[2]),
        ));
    }
    if !(0.0..=FARTHEST).contains(&lamp.intensity) {
        return Err(wrong(
            &format!("{at}.intensity"),
            format!("{} found, expected 0 to {FARTHEST}", lamp.intensity),
        ));
    }
    layout.lights.push(Light {
        at: lamp.at,
        intensity: lamp.intensity,
        color: lamp.color,
    });
    Ok(())
}

/// Returns the coloured spots of a stretch of a wall.
fn colored(at: &str, stretch: &SideColor, sides: &[Face]) -> Result<Vec<Spot>, ParameterError> {
    let Some(side) = sides.get(stretch.side) else {
        return Err(wrong(
            &format!("{at}.side"),
            format!(
                "{} found, but the walls have the sides 0 to {}",
                stretch.side,
                sides.len() - 1
            ),
        ));
    };
    let whole = 2.0 * side.half;
    let (from, to) = (stretch.from, stretch.to.unwrap_or(whole));
    // A written length may differ from that of the side by rounding.
    if !(0.0 <= from && from < to && to <= whole * 1.0001) {
        return Err(wrong(
            at,
            format!("from {from} to {to} found, expected metres along the side, 0 to {whole}"),
        ));
    }
    Ok(side.spots([from, to.min(whole)], stretch.color))
}

fn grey(path: &str, level: f32) -> Result<f32, ParameterError> {
    if (0.0..=1.0).contains(&level) {
        return Ok(level);
    }
    Err(wrong(
        path,
        format!("{level} found, expected 0 (black) to 1 (white)"),
    ))
}

fn shape(at: &str, patch: &PatchText) -> Result<Shape, ParameterError> {
    match (&patch.circle, &patch.rectangle, &patch.polygon) {
        (None, None, Some(corners)) => {
            let at = format!("{at}.polygon");
            coordinates(&at, corners.as_flattened())?;
            let corners = polygon::tidy(corners).map_err(|reason| wrong(&at, reason))?;
            if !polygon::is_convex(&corners) {
                return Err(wrong(
                    &at,
                    "the polygon has a corner that points inwards; expected a convex polygon, or several",
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
        _ => Err(wrong(at, "expected circle, or rectangle, or polygon")),
    }
}

/// Returns the corners of the outer walls, counter-clockwise.
fn outline(walls: &Walls) -> Result<Vec<[f32; 2]>, ParameterError> {
    match (walls.sides, walls.apothem, walls.rectangle, &walls.corners) {
        (Some(sides), Some(apothem), None, None) => {
            if !(3..=1000).contains(&sides) {
                return Err(wrong(
                    "mission.walls.sides",
                    format!("{sides} found, expected 3 to 1000"),
                ));
            }
            length("mission.walls.apothem", apothem)?;
            let radius = f64::from(apothem) / (std::f64::consts::PI / f64::from(sides)).cos();
            let corner = |corner: u32| {
                let angle = (f64::from(corner) - 0.5) / f64::from(sides);
                let (sin, cos) = (2.0 * std::f64::consts::PI * angle).sin_cos();
                [(radius * cos) as f32, (radius * sin) as f32]
            };
            Ok((0..sides).map(corner).collect())
        }
        (None, None, Some([width, height]), None) => {
            length("mission.walls.rectangle[0]", width)?;
            length("mission.walls.rectangle[1]", height)?;
            let [x, y] = [width / 2.0, height / 2.0];
            Ok(vec![[-x, -y], [x, -y], [x, y], [-x, y]])
        }
        (None, None, None, Some(corners)) => {
            coordinates("mission.walls.corners", corners.as_flattened())?;
            polygon::tidy(corners).map_err(|reason| wrong("mission.walls.corners", reason))
        }
        _ => Err(wrong(
            "mission.walls",
            "expected sides and apothem, or rectangle, or corners",
        )),
    }
}

/// Returns the faces of a polygon with counter-clockwise corners. `inside` is whether the polygon is convex, for faces
/// seen from inside; `None` for faces seen from outside.
fn sides(corners: &[[f32; 2]], height: f32, inside: Option<bool>) -> Vec<Face> {
    let next = corners.iter().cycle().skip(1);
    let side = |(from, to): (&[f32; 2], &[f32; 2])| match inside {
        Some(convex) => Face::new(*from, *to, height, convex),
        None => Face::new(*to, *from, height, false),
    };
    corners.iter().zip(next).map(side).collect()
}

/// Returns the corners of a box, counter-clockwise.
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
