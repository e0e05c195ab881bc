//! Draws a scene as text for a terminal.

mod canvas;
mod glyphs;
mod ground;

use crate::Scene;
use canvas::Canvas;
use glyphs::{Color, Glyph, Looks};

/// How a scene is drawn.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct TextStyle {
    /// Most characters in a line.
    pub columns: usize,
    /// Most lines, heading and legend included.
    pub rows: usize,
    /// With ANSI colours.
    pub color: bool,
    /// With box drawing and symbols; plain ASCII otherwise.
    pub unicode: bool,
}

impl Default for TextStyle {
    /// A terminal of 80 columns and 24 lines, Unicode, no colour.
    fn default() -> Self {
        Self {
            columns: 80,
            rows: 24,
            color: false,
            unicode: true,
        }
    }
}

/// Smallest map that is worth its border.
const MIN_SIDE: usize = 3;
/// Heading, two borders, legend.
const FRAME_ROWS: usize = 4;
/// A character in a terminal is about twice as high as wide.
const CELL_ASPECT: f64 = 2.0;

/// The scene as lines of at most `style.columns` characters: a heading with message and step, the map with y
/// pointing up (left out where there is no space for one), a legend that counts what is there.
pub fn render(scene: &Scene, style: TextStyle) -> Vec<String> {
    let mut lines = Vec::new();
    let looks = Looks::new(scene, style.unicode);
    let (width, height) = map_size(scene, style);
    let drawn = width >= MIN_SIDE && height >= 1;
    let line_width = if drawn { width + 2 } else { style.columns };
    lines.push(heading(scene, line_width.max(style.columns.min(40))));
    if drawn {
        let mut canvas = Canvas::new(width, height);
        ground::draw(&mut canvas, scene, style.unicode);
        canvas.draw(scene, &looks, style.unicode);
        lines.extend(canvas.framed(style));
    }
    lines.push(legend(scene, &looks, style));
    lines
}

/// Columns and rows inside the border: as large as fits, in the proportions of the world.
fn map_size(scene: &Scene, style: TextStyle) -> (usize, usize) {
    let (w, h) = (f64::from(scene.width), f64::from(scene.height));
    let proper = w.is_finite() && h.is_finite() && w > 0.0 && h > 0.0;
    let (Some(columns), Some(rows)) = (
        style.columns.checked_sub(2),
        style.rows.checked_sub(FRAME_ROWS),
    ) else {
        return (0, 0);
    };
    if !proper {
        return (0, 0);
    }
    let scale = (columns as f64 / w).min(CELL_ASPECT * rows as f64 / h);
    // Narrow worlds keep a visible side.
    let width = ((w * scale).round() as usize).clamp(MIN_SIDE.min(columns), columns);
    let height = ((h * scale / CELL_ASPECT).round() as usize).clamp(1.min(rows), rows);
    (width, height)
}

/// The first `columns` characters; control characters, which could steer the terminal, become spaces.
fn plain(text: &str, columns: usize) -> String {
    text.chars()
        .map(|c| if c.is_control() { ' ' } else { c })
        .take(columns)
        .collect()
}

/// Message on the left, step on the right.
fn heading(scene: &Scene, columns: usize) -> String {
    let step = plain(&format!("step {}", scene.step), columns);
    let used = step.chars().count();
    let message = plain(&scene.message, columns.saturating_sub(used + 2));
    let gap = columns - used - message.chars().count();
    format!("{message}{}{step}", " ".repeat(gap))
}

/// Symbol, name and number of every kind of body, then what lies and stands below them, as many as fit.
fn legend(scene: &Scene, looks: &Looks<'_>, style: TextStyle) -> String {
    let bodies = looks.entries().iter().map(|entry| {
        let name = match (entry.kind, entry.state) {
            (kind, "") => kind.to_owned(),
            ("agent", state) => state.to_owned(),
            (kind, state) => format!("{kind}, {state}"),
        };
        let name = plain(&name, style.columns);
        let words = if matches!(entry.kind, "goal" | "wall") {
            name
        } else {
            format!("{name} {}", entry.count)
        };
        (entry.glyph, words)
    });
    let below = ground::legend(scene, style.unicode).into_iter();
    let mut line = String::new();
    let mut used = 0;
    for (Glyph { symbol, color }, words) in
        bodies.chain(below.map(|(glyph, name)| (glyph, name.to_owned())))
    {
        let gap = if used == 0 { 0 } else { 3 };
        let length = gap + 2 + words.chars().count();
        if used + length > style.columns {
            break;
        }
        used += length;
        line.push_str(&" ".repeat(gap));
        line.push_str(&paint(&symbol.to_string(), color, style.color));
        line.push(' ');
        line.push_str(&words);
    }
    line
}

fn paint(text: &str, color: Color, on: bool) -> String {
    if on {
        format!("\x1b[{}m{text}\x1b[0m", color.code())
    } else {
        text.to_owned()
    }
}
