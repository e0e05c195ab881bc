//! A grid of characters over the map.

use super::glyphs::{Glyph, Looks, arrow, fills_cell, halo, is_shown, is_stretch};
use super::{TextStyle, paint};
use crate::{Body, Scene};

pub(super) struct Canvas {
    width: usize,
    height: usize,
    /// Row after row from the top; None is empty.
    cells: Vec<Option<Glyph>>,
}

impl Canvas {
    pub(super) fn new(width: usize, height: usize) -> Self {
        Self {
            width,
            height,
            cells: vec![None; width * height],
        }
    }

    /// Draws radii first and symbols above them, each in the order of the bodies.
    pub(super) fn draw(&mut self, scene: &Scene, looks: &Looks<'_>, unicode: bool) {
        let has_disc = |body: &&Body| is_shown(body) && !is_stretch(body);
        for body in scene.bodies.iter().filter(has_disc) {
            self.disc(scene, body, halo(looks.glyph(body), unicode));
        }
        for body in scene.bodies.iter().filter(|body| is_shown(body)) {
            let mark = looks.glyph(body);
            if fills_cell(&body.kind) {
                self.square(scene, body, mark);
            }
            let heading = body.heading.filter(|_| !is_stretch(body));
            let mark = heading.map_or(mark, |heading| arrow(mark, heading, unicode));
            self.point(scene, [body.x, body.y], mark);
        }
    }

    /// Marks the character at a place, or the nearest one of places outside.
    pub(super) fn point(&mut self, scene: &Scene, [x, y]: [f32; 2], mark: Glyph) {
        let column = cell(x / scene.width, self.width);
        let row = cell(1.0 - y / scene.height, self.height);
        self.cells[row * self.width + column] = Some(mark);
    }

    /// Marks the characters whose middle is at a place that `inside` accepts; none: empties them.
    pub(super) fn fill(
        &mut self,
        scene: &Scene,
        mark: Option<Glyph>,
        inside: impl Fn([f32; 2]) -> bool,
    ) {
        let [w, h] = self.character(scene);
        for row in 0..self.height {
            for column in 0..self.width {
                let y = scene.height - (row as f32 + 0.5) * h;
                if inside([(column as f32 + 0.5) * w, y]) {
                    self.cells[row * self.width + column] = mark;
                }
            }
        }
    }

    /// Width and height of a character in the world.
    pub(super) fn character(&self, scene: &Scene) -> [f32; 2] {
        [
            scene.width / self.width as f32,
            scene.height / self.height as f32,
        ]
    }

    /// Marks the characters whose middle lies within the cell of a grid that the body is in the middle of.
    fn square(&mut self, scene: &Scene, body: &Body, mark: Glyph) {
        let [w, h] = self.character(scene);
        for row in within(scene.height - body.y, h, self.height) {
            for column in within(body.x, w, self.width) {
                self.cells[row * self.width + column] = Some(mark);
            }
        }
    }

    /// Marks the cells whose middle lies within the body's radius.
    fn disc(&mut self, scene: &Scene, body: &Body, mark: Glyph) {
        let [w, h] = self.character(scene);
        let columns = span(body.x, body.radius, w, self.width);
        let top = scene.height - body.y;
        for row in span(top, body.radius, h, self.height) {
            for column in columns.clone() {
                let (dx, dy) = (
                    (column as f32 + 0.5) * w - body.x,
                    (row as f32 + 0.5) * h - top,
                );
                if dx * dx + dy * dy <= body.radius * body.radius {
                    self.cells[row * self.width + column] = Some(mark);
                }
            }
        }
    }

    /// The rows with a border.
    pub(super) fn framed(&self, style: TextStyle) -> Vec<String> {
        let [
            left_top,
            right_top,
            left_bottom,
            right_bottom,
            flat,
            upright,
        ] = if style.unicode {
            ['┌', '┐', '└', '┘', '─', '│']
        } else {
            ['+', '+', '+', '+', '-', '|']
        };
        let edge = |left: char, right: char| {
            format!("{left}{}{right}", flat.to_string().repeat(self.width))
        };
        let row = |cells: &[Option<Glyph>]| {
            let symbol = |c: &Option<Glyph>| {
                c.map_or_else(
                    || " ".to_owned(),
                    |g| paint(&g.symbol.to_string(), g.color, style.color),
                )
            };
            format!(
                "{upright}{}{upright}",
                cells.iter().map(symbol).collect::<String>()
            )
        };
        let rows = self.cells.chunks_exact(self.width).map(row);
        [edge(left_top, right_top)]
            .into_iter()
            .chain(rows)
            .chain([edge(left_bottom, right_bottom)])
            .collect()
    }
}

/// The cell of `count` that holds the fraction; the last one for 1, the nearest one outside 0..=1.
fn cell(fraction: f32, count: usize) -> usize {
    // A cast to an integer saturates and makes NaN 0.
    ((fraction * count as f32) as usize).min(count - 1)
}

/// Cells of size `size` that reach within `radius` of `middle`.
fn span(middle: f32, radius: f32, size: f32, count: usize) -> std::ops::Range<usize> {
    let (low, high) = ((middle - radius) / size, (middle + radius) / size);
    low.max(0.0) as usize..(high.max(0.0).ceil() as usize).min(count)
}

/// Characters of size `size` whose middle is less than half a cell away from `middle`.
fn within(middle: f32, size: f32, count: usize) -> std::ops::Range<usize> {
    let bound = |edge: f32| ((edge / size - 0.5).ceil().max(0.0) as usize).min(count);
    bound(middle - 0.5)..bound(middle + 0.5)
}
