//! Objects of a mission: their properties and start positions.

use super::area::{Pose, Start};
use super::color::LedColor;

/// Maximum number of objects in a mission.
pub const MOST_OBJECTS: usize = 64;
/// Number of points along each axis for the mean distance from the middle of a box.
const POINTS: u32 = 64;

/// The outline of an object, seen from above.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Form {
    Disc {
        radius: f32,
    },
    /// Half of the extent along the object's own axes, metres.
    Box {
        half: [f32; 2],
    },
}

impl Form {
    /// Returns the radius of the circumscribed circle, metres.
    pub fn radius(self) -> f32 {
        match self {
            Self::Disc { radius } => radius,
            Self::Box { half: [x, y] } => (x * x + y * y).sqrt(),
        }
    }

    /// Returns the radius of the largest inscribed circle, metres.
    pub fn inner_radius(self) -> f32 {
        match self {
            Self::Disc { radius } => radius,
            Self::Box { half: [x, y] } => x.min(y),
        }
    }

    /// Returns the moment of inertia per unit of mass, m^2.
    pub fn inertia(self) -> f32 {
        match self {
            Self::Disc { radius } => radius * radius / 2.0,
            Self::Box { half: [x, y] } => (x * x + y * y) / 3.0,
        }
    }

    /// Returns the mean distance of the form's points from the middle, metres, which is the lever of friction under
    /// uniform pressure.
    pub fn lever(self) -> f32 {
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

/// Start positions of objects of a kind.
#[derive(Debug, Clone, PartialEq)]
pub enum Places {
    /// One object at a fixed pose.
    Fixed(Pose),
    /// A number of objects, drawn anew for each episode.
    Drawn(Start, usize),
}

/// Objects of the same form and name.
#[derive(Debug, Clone, PartialEq)]
pub struct Kind {
    pub name: String,
    pub form: Form,
    /// Height, metres; the object hides anything lower.
    pub height: f32,
    /// Mass, kg.
    pub mass: f32,
    /// Coefficient of friction with the floor.
    pub friction: f32,
    /// Colour that cameras see.
    pub color: Option<LedColor>,
    pub places: Places,
}

impl Kind {
    pub fn count(&self) -> usize {
        match self.places {
            Places::Fixed(_) => 1,
            Places::Drawn(_, count) => count,
        }
    }
}
