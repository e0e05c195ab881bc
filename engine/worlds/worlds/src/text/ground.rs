//! Floor, walls and lights in characters.

use super::canvas::Canvas;
use super::glyphs::{Color, Glyph};
use crate::{Patch, Scene};

/// A symbol, its ASCII, a colour, and what the legend says.
type Entry = (char, char, Color, &'static str);

const BLACK: Entry = ('░', ':', Color::Lost, "black floor");
const WHITE: Entry = ('·', '.', Color::Lost, "white floor");
const WALL: Entry = ('█', '#', Color::Blockade, "wall");
const LIGHT: Entry = ('☼', '*', Color::Exit, "light");

/// Points on a wall for each character that it crosses.
const FINE: f32 = 2.0;
/// Most points on a wall: it may be long where the world is small.
const MOST: f32 = 10_000.0;

fn glyph((fancy, ascii, color, _): Entry, unicode: bool) -> Glyph {
    Glyph {
        symbol: if unicode { fancy } else { ascii },
        color,
    }
}

/// What a colour of the floor is drawn as; nothing for grey.
fn of_grey(grey: f32) -> Option<Entry> {
    (grey < 0.25)
        .then_some(BLACK)
        .or((grey > 0.75).then_some(WHITE))
}

/// Draws what lies below all bodies.
pub(super) fn draw(canvas: &mut Canvas, scene: &Scene, unicode: bool) {
    let floor = scene.floor.iter();
    let within = |point: [f32; 2]| {
        let mut floor = scene.floor.iter();
        floor.all(|floor| floor.points.is_empty() || holds(floor, point))
    };
    for patch in floor.chain(&scene.patches) {
        let inside = |point| within(point) && (patch.points.is_empty() || holds(patch, point));
        let mark = of_grey(patch.grey).map(|entry| glyph(entry, unicode));
        canvas.fill(scene, mark, inside);
    }
    let wall = glyph(WALL, unicode);
    let [w, h] = canvas.character(scene);
    for barrier in &scene.walls {
        if barrier.solid {
            canvas.fill(scene, Some(wall), |point| {
                in_polygon(&barrier.points, point)
            });
        }
        let closing = barrier.solid.then(|| barrier.points.first()).flatten();
        let next = barrier.points.iter().skip(1).chain(closing);
        for ([ax, ay], [bx, by]) in barrier.points.iter().zip(next) {
            let parts = FINE * ((bx - ax) / w).abs().max(((by - ay) / h).abs());
            let parts = parts.ceil().clamp(1.0, MOST);
            for part in 0..=parts as u32 {
                let share = part as f32 / parts;
                canvas.point(
                    scene,
                    [ax + share * (bx - ax), ay + share * (by - ay)],
                    wall,
                );
            }
        }
    }
    for light in scene.lights.iter().filter(|light| light.intensity > 0.0) {
        canvas.point(scene, [light.x, light.y], glyph(LIGHT, unicode));
    }
}

/// Returns the kinds of ground in a scene, for the legend.
pub(super) fn legend(scene: &Scene, unicode: bool) -> Vec<(Glyph, &'static str)> {
    let floors = scene.floor.iter().chain(&scene.patches);
    let greys: Vec<&str> = floors
        .filter_map(|patch| of_grey(patch.grey))
        .map(|e| e.3)
        .collect();
    let entries = [
        (BLACK, greys.contains(&BLACK.3)),
        (WHITE, greys.contains(&WHITE.3)),
        (WALL, !scene.walls.is_empty()),
        (
            LIGHT,
            scene.lights.iter().any(|light| light.intensity > 0.0),
        ),
    ];
    let listed = entries.into_iter().filter(|(_, is_shown)| *is_shown);
    listed
        .map(|(entry, _)| (glyph(entry, unicode), entry.3))
        .collect()
}

fn holds(patch: &Patch, [x, y]: [f32; 2]) -> bool {
    match patch.points[..] {
        [] => true,
        [[cx, cy]] => {
            let (dx, dy) = (x - cx, y - cy);
            dx * dx + dy * dy <= patch.radius * patch.radius
        }
        _ => in_polygon(&patch.points, [x, y]),
    }
}

/// Whether a ray to the right crosses an odd number of sides.
fn in_polygon(corners: &[[f32; 2]], [x, y]: [f32; 2]) -> bool {
    let next = corners.iter().cycle().skip(1);
    let crossed = corners.iter().zip(next).filter(|([ax, ay], [bx, by])| {
        (*ay > y) != (*by > y) && x < ax + (y - ay) / (by - ay) * (bx - ax)
    });
    crossed.count() % 2 == 1
}
