//! Symbols and colours of what stands in a scene: as characters what `swarmwright/display/_look.py` has for pages.
//! A test of Python holds that both tables name the same kinds, states and colours.

use crate::{Body, Scene};

/// Kinds and states that have a look of their own, in the order of the legend: symbol, its ASCII, colour.
const KNOWN: &[(&str, &str, char, char, Color)] = &[
    ("agent", "", '●', 'o', Color::Free),
    ("agent", "free", '●', 'o', Color::Free),
    ("agent", "arrived", '●', '*', Color::Good),
    ("agent", "caught", '✗', 'x', Color::Lost),
    ("agent", "crashed", '✗', 'x', Color::Lost),
    ("agent", "out", '●', '*', Color::Good),
    ("defender", "", '▲', 'D', Color::Defender),
    ("goal", "", '★', 'G', Color::Good),
    ("exit", "", '░', 'E', Color::Exit),
    ("blockade", "", '█', '#', Color::Blockade),
    ("obstacle", "", '█', '#', Color::Blockade),
];
/// Symbols of kinds that are not there, in the order in which they are seen.
const FREE: [(char, char); 3] = [('◆', '?'), ('⬟', '&'), ('⬢', '%')];
/// Colours of unknown kinds and states, in the order of appearance.
const OTHERS: [Color; 4] = [Color::Other1, Color::Other2, Color::Other3, Color::Other4];

/// Colours, named as in the table.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Color {
    Free,
    Good,
    Lost,
    Defender,
    Exit,
    Blockade,
    Other1,
    Other2,
    Other3,
    Other4,
    /// What a style says.
    Rgb(u8, u8, u8),
}

impl Color {
    /// ANSI "select graphic rendition" code: of 256 colours the nearest to the table's that shows on any ground.
    pub(super) fn code(self) -> String {
        let code = match self {
            Self::Rgb(red, green, blue) => return format!("38;2;{red};{green};{blue}"),
            Self::Free => "38;5;32",
            Self::Good => "38;5;36",
            Self::Lost => "38;5;245",
            Self::Defender => "38;5;202",
            Self::Exit => "38;5;214",
            Self::Blockade => "38;5;242",
            Self::Other1 => "38;5;175",
            Self::Other2 => "38;5;74",
            Self::Other3 => "38;5;142",
            Self::Other4 => "1",
        };
        code.to_owned()
    }

    /// Of `#rrggbb`.
    fn read(text: &str) -> Option<Self> {
        let digits = text.strip_prefix('#').filter(|digits| digits.len() == 6)?;
        let number = u32::from_str_radix(digits, 16).ok()?;
        let [_, red, green, blue] = number.to_be_bytes();
        Some(Self::Rgb(red, green, blue))
    }
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Glyph {
    pub symbol: char,
    pub color: Color,
}

/// Whether a body is more than an LED that is off.
pub(super) fn is_shown(body: &Body) -> bool {
    body.kind != "led" || !body.state.is_empty()
}

/// Whether a body is a coloured stretch of a wall, whose heading is the direction of a line.
pub(super) fn is_stretch(body: &Body) -> bool {
    body.kind == "wall" && body.heading.is_some()
}

/// A kind and a state in a scene, what it looks like, and how many there are.
pub(super) struct Entry<'a> {
    pub kind: &'a str,
    pub state: &'a str,
    pub glyph: Glyph,
    pub count: usize,
}

/// What everything in a scene looks like.
///
/// A kind without a look of its own gets a symbol, and a state without one a colour, in the order in which they
/// are seen.
pub(super) struct Looks<'a>(Vec<Entry<'a>>);

impl<'a> Looks<'a> {
    pub(super) fn new(scene: &'a Scene, unicode: bool) -> Self {
        let mut entries: Vec<Entry<'a>> = Vec::new();
        let (mut kinds, mut unknown): (Vec<&str>, usize) = (Vec::new(), 0);
        let pick = |fancy, ascii| if unicode { fancy } else { ascii };
        for body in scene.bodies.iter().filter(|body| is_shown(body)) {
            let (kind, state) = (&*body.kind, &*body.state);
            if let Some(entry) = entries
                .iter_mut()
                .find(|e| e.kind == kind && e.state == state)
            {
                entry.count += 1;
                continue;
            }
            let entry = KNOWN.iter().find(|k| k.0 == kind && k.1 == state);
            let mut glyph = if let Some(&(_, _, fancy, ascii, color)) = entry {
                Glyph {
                    symbol: pick(fancy, ascii),
                    color,
                }
            } else {
                let color = OTHERS[unknown % OTHERS.len()];
                unknown += 1;
                let (fancy, ascii) = if let Some(of_kind) = KNOWN.iter().find(|k| k.0 == kind) {
                    (of_kind.2, of_kind.3)
                } else {
                    let index = kinds.iter().position(|k| *k == kind).unwrap_or_else(|| {
                        kinds.push(kind);
                        kinds.len() - 1
                    });
                    FREE[index % FREE.len()]
                };
                Glyph {
                    symbol: pick(fancy, ascii),
                    color,
                }
            };
            let of = |state: &str| {
                let mut styles = scene.styles.iter();
                styles.find(|style| style.kind == kind && style.state == state)
            };
            let style = of(state).or_else(|| of(""));
            if let Some(color) = style.and_then(|style| Color::read(&style.color)) {
                glyph.color = color;
            }
            entries.push(Entry {
                kind,
                state,
                glyph,
                count: 1,
            });
        }
        // Known ones first, in their order; a stable sort keeps the others as they were seen.
        entries.sort_by_key(|e| {
            KNOWN
                .iter()
                .position(|k| k.0 == e.kind && k.1 == e.state)
                .unwrap_or(KNOWN.len())
        });
        Self(entries)
    }

    /// The look of a body of the scene.
    pub(super) fn glyph(&self, body: &Body) -> Glyph {
        self.0
            .iter()
            .find(|e| e.kind == body.kind && e.state == body.state)
            .map_or(
                Glyph {
                    symbol: '?',
                    color: Color::Other4,
                },
                |e| e.glyph,
            )
    }

    /// Every kind and state that is there, in the order of the legend.
    pub(super) fn entries(&self) -> &[Entry<'a>] {
        &self.0
    }
}

/// Whether a body fills a cell of a grid.
pub(super) fn fills_cell(kind: &str) -> bool {
    matches!(kind, "blockade" | "exit")
}

/// Fills the radius of a body.
pub(super) fn halo(glyph: Glyph, unicode: bool) -> Glyph {
    Glyph {
        symbol: if unicode { '·' } else { '.' },
        color: glyph.color,
    }
}

/// Arrows counter-clockwise from east, with their ASCII equivalents.
const ARROWS: [(char, char); 8] = [
    ('→', '>'),
    ('↗', '/'),
    ('↑', '^'),
    ('↖', '\\'),
    ('←', '<'),
    ('↙', '/'),
    ('↓', 'v'),
    ('↘', '\\'),
];

/// Where a body looks, of a circle; other shapes say what it is.
pub(super) fn arrow(glyph: Glyph, heading: f32, unicode: bool) -> Glyph {
    if !matches!(glyph.symbol, '●' | 'o') {
        return glyph;
    }
    let turn = f64::from(heading) / std::f64::consts::TAU;
    // The cast makes NaN 0.
    let eighth = ((turn - turn.floor()) * 8.0).round() as usize % ARROWS.len();
    let (fancy, ascii) = ARROWS[eighth];
    Glyph {
        symbol: if unicode { fancy } else { ascii },
        color: glyph.color,
    }
}
