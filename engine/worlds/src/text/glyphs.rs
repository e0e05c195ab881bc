//! Symbols and colours of what stands in a scene.

/// Kinds and states, in the order of the legend.
pub(super) const KINDS: &[(&str, &str)] = &[
    ("agent", "free"),
    ("agent", "arrived"),
    ("agent", "caught"),
    ("agent", "crashed"),
    ("agent", "out"),
    ("defender", ""),
    ("goal", ""),
    ("exit", ""),
    ("blockade", ""),
    ("obstacle", ""),
];

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Color {
    Default,
    Agent,
    Arrived,
    Caught,
    Defender,
    Faint,
}

impl Color {
    /// ANSI "select graphic rendition" code.
    pub(super) fn code(self) -> &'static str {
        match self {
            Self::Default => "0",
            Self::Agent => "1;36",
            Self::Arrived => "1;32",
            Self::Caught => "1;31",
            Self::Defender => "1;33",
            Self::Faint => "2",
        }
    }
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Glyph {
    pub symbol: char,
    pub color: Color,
}

/// The symbol of a body; a question mark for kinds without one.
pub(super) fn glyph(kind: &str, state: &str, unicode: bool) -> Glyph {
    let (fancy, ascii, color) = match (kind, state) {
        ("agent", "arrived" | "out") => ('★', '*', Color::Arrived),
        ("agent", "caught" | "crashed") => ('✗', 'x', Color::Caught),
        ("agent", _) => ('●', 'o', Color::Agent),
        ("defender", _) => ('◆', 'D', Color::Defender),
        ("goal", _) => ('◎', 'G', Color::Arrived),
        ("exit", _) => ('░', 'E', Color::Arrived),
        ("blockade" | "obstacle", _) => ('█', '#', Color::Faint),
        _ => ('?', '?', Color::Default),
    };
    Glyph {
        symbol: if unicode { fancy } else { ascii },
        color,
    }
}

/// Whether a body fills a cell of a grid.
pub(super) fn fills_cell(kind: &str) -> bool {
    matches!(kind, "blockade" | "exit")
}

/// Fills the radius of a body.
pub(super) fn halo(kind: &str, unicode: bool) -> Glyph {
    let color = glyph(kind, "", unicode).color;
    Glyph {
        symbol: if unicode { '·' } else { '.' },
        color,
    }
}
