//! Objects as a mission has them: what they look like, and where they start.

use super::area::{Pose, Start};
use super::color::LedColor;

/// Most objects of a mission.
pub(crate) const MOST_OBJECTS: usize = 64;
/// Points in each direction over which distances from the middle of a box are averaged.
const POINTS: u32 = 64;

/// What an object looks like from above.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) enum Form {
    Disc {
        radius: f32,
    },
    /// Half of the extent along its own axes, metres.
    Box {
        half: [f32; 2],
    },
}

impl Form {
    /// Radius of the circle around it, metres.
    pub(crate) fn radius(self) -> f32 {
        match self {
            Self::Disc { radius } => radius,
            Self::Box { half: [x, y] } => (x * x + y * y).sqrt(),
        }
    }

    /// Radius of the largest circle in it, metres.
    pub(crate) fn inner_radius(self) -> f32 {
        match self {
            Self::Disc { radius } => radius,
            Self::Box { half: [x, y] } => x.min(y),
        }
    }

    /// Moment of inertia of a kilogram, m^2.
    pub(crate) fn inertia(self) -> f32 {
        match self {
            Self::Disc { radius } => radius * radius / 2.0,
            Self::Box { half: [x, y] } => (x * x + y * y) / 3.0,
        }
    }

    /// The mean distance of its points from the middle, metres: the lever of the friction of an even pressure.
    pub(crate) fn lever(self) -> f32 {
        match self {
            Self::Disc { radius } => radius * (2.0 / 3.0),
            Self::Box { half } => {
                let part = |index: u32| (f64::from(index) + 0.5) / f64::from(POINTS);
                let [w, h] = half.map(f64::from);
                let sum: f64 = (0..POINTS * POINTS)
                    .map(|index| [w * part(index % POINTS), h * part(index / POINTS)])
                    .map(|[x, y]| (x * x + y * y).sqrt())
                    .sum();
                (sum / f64::from(POINTS * POINTS)) as f32
            }
        }
    }
}

/// Where objects of a kind are at the start.
#[derive(Debug, Clone, PartialEq)]
pub(crate) enum Places {
    /// One, always there.
    Fixed(Pose),
    /// So many, drawn anew for each episode.
    Drawn(Start, usize),
}

/// Objects of the same form and name.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Kind {
    pub name: String,
    pub form: Form,
    /// Metres; it hides what lies lower.
    pub height: f32,
    /// Kilograms.
    pub mass: f32,
    /// Coefficient of friction with the floor.
    pub friction: f32,
    /// What cameras see.
    pub color: Option<LedColor>,
    pub places: Places,
}

impl Kind {
    pub(crate) fn count(&self) -> usize {
        match self.places {
            Places::Fixed(_) => 1,
            Places::Drawn(_, count) => count,
        }
    }
}
