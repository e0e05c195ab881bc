//! Colours of LEDs, lamps, walls and objects, which cameras see.

use serde::Deserialize;

/// A colour that LEDs show and cameras distinguish.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum LedColor {
    Red,
    Green,
    Blue,
    Cyan,
    Magenta,
    Yellow,
}

impl LedColor {
    pub const ALL: [Self; 6] = [
        Self::Red,
        Self::Green,
        Self::Blue,
        Self::Cyan,
        Self::Magenta,
        Self::Yellow,
    ];

    /// Returns the index of the colour.
    pub const fn index(self) -> usize {
        self as usize
    }

    /// Returns the number that represents the colour in lanes; 0 stands for no colour.
    pub const fn code(self) -> f32 {
        (self as usize + 1) as f32
    }

    pub const fn name(self) -> &'static str {
        match self {
            Self::Red => "red",
            Self::Green => "green",
            Self::Blue => "blue",
            Self::Cyan => "cyan",
            Self::Magenta => "magenta",
            Self::Yellow => "yellow",
        }
    }

    /// Returns the colour for pictures, slightly darker than on screens so that it is visible on white.
    pub const fn shown(self) -> &'static str {
        match self {
            Self::Red => "#e02020",
            Self::Green => "#18a818",
            Self::Blue => "#2848e0",
            Self::Cyan => "#10b8c8",
            Self::Magenta => "#d020c0",
            Self::Yellow => "#d8c010",
        }
    }

    /// Returns a paler shade for pictures.
    pub const fn pale(self) -> &'static str {
        match self {
            Self::Red => "#f0a0a0",
            Self::Green => "#98d898",
            Self::Blue => "#a0b0f0",
            Self::Cyan => "#90dce4",
            Self::Magenta => "#e898e0",
            Self::Yellow => "#ece090",
        }
    }

    /// Returns a darker shade for pictures.
    pub const fn dark(self) -> &'static str {
        match self {
            Self::Red => "#781010",
            Self::Green => "#0c5c0c",
            Self::Blue => "#142478",
            Self::Cyan => "#086068",
            Self::Magenta => "#701068",
            Self::Yellow => "#786a08",
        }
    }
}
