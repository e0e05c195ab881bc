//! The place of a mission: walls, floor, lights and objects.

pub mod area;
mod color;
mod face;
mod object;

use swarmwright_lanes::{Lanes, Mask, Number, number};
use swarmwright_simulation::counter::uniform;

use crate::math::polygon;

pub use area::{Pose, Start};
pub use color::LedColor;
pub use face::{Face, to_face};
pub use object::{Form, Kind, MOST_OBJECTS, Places};

/// Identifies the random stream for colours.
const COLORS: u64 = 0x636F_6C6F_7273;

/// Margin around the walls in pictures, metres.
const MARGIN: f32 = 0.05;

/// A shape on the floor.
#[derive(Debug, Clone, PartialEq)]
pub enum Shape {
    Circle {
        center: [f32; 2],
        radius: f32,
    },
    /// Lower left and upper right corners; infinite where unbounded.
    Box {
        low: [f32; 2],
        high: [f32; 2],
    },
    /// A convex polygon with counter-clockwise corners.
    Polygon {
        corners: Vec<[f32; 2]>,
    },
}

impl Shape {
    /// Returns the middle of the bounding box; infinite or NaN if unbounded.
    #[inline]
    pub fn middle(&self) -> [f64; 2] {
        let [low, high] = match self {
            Self::Circle { center, .. } => [*center; 2],
            Self::Box { low, high } => [*low, *high],
            Self::Polygon { corners } => polygon::extent(corners),
        };
        [0, 1].map(|axis| (f64::from(low[axis]) + f64::from(high[axis])) / 2.0)
    }

    /// Returns whether points lie in the shape, including its edge.
    #[inline(always)]
    pub fn holds<L: Lanes>(&self, x: Number<L>, y: Number<L>) -> L::Mask {
        match self {
            Self::Circle { center, radius } => {
                let (dx, dy) = (x - center[0], y - center[1]);
                (dx * dx + dy * dy).le(number(radius * radius))
            }
            Self::Box { low, high } => {
                let x_in = number(low[0]).le(x).and(x.le(number(high[0])));
                let y_in = number(low[1]).le(y).and(y.le(number(high[1])));
                x_in.and(y_in)
            }
            Self::Polygon { corners } => {
                let mut inside = L::Mask::from_bits(u64::MAX);
                for (index, [ax, ay]) in corners.iter().enumerate() {
                    let [bx, by] = corners[(index + 1) % corners.len()];
                    let left = (y - *ay) * (bx - ax) - (x - *ax) * (by - ay);
                    inside = inside.and(number(0.0).le(left));
                }
                inside
            }
        }
    }
}

/// A part of the floor with its own colour.
#[derive(Debug, Clone, PartialEq)]
pub struct Patch {
    pub name: String,
    pub shape: Shape,
    /// Grey level from 0 (black) to 1 (white); `None` for black or white, chosen by the seed of the episode.
    pub grey: Option<f32>,
}

/// A lamp.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Light {
    /// Position x, y, z, metres.
    pub at: [f32; 3],
    pub intensity: f32,
    /// Colour that cameras see at the lamp's foot.
    pub color: Option<LedColor>,
}

/// A coloured spot on a wall, visible only to cameras.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Spot {
    pub at: [f32; 2],
    pub color: LedColor,
    /// The part of the wall that the spot represents: unit vector along it, and half of its length, metres.
    pub along: [f32; 2],
    pub half: f32,
}

/// Maximum spacing of spots on a wall, metres.
const SPOTS: f32 = 0.1;
/// Distance of spots in front of the wall, metres, so that the wall does not hide them.
const IN_FRONT: f32 = 0.001;

impl Face {
    /// Divides a stretch into equal parts, and returns a spot at the middle of each. The stretch is in metres from the
    /// first end.
    pub fn spots(&self, [from, to]: [f32; 2], color: LedColor) -> Vec<Spot> {
        let count = ((to - from) / SPOTS).ceil().max(1.0) as usize;
        let part = (to - from) / count as f32;
        let spot = |index: usize| {
            let along = from + (index as f32 + 0.5) * part - self.half;
            let [x, y] = self.along;
            Spot {
                at: [
                    self.middle[0] + along * x - IN_FRONT * y,
                    self.middle[1] + along * y + IN_FRONT * x,
                ],
                color,
                along: self.along,
                half: part / 2.0,
            }
        };
        (0..count).map(spot).collect()
    }
}

/// Everything that does not move by itself: the surroundings, and the objects that robots can push.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Place {
    /// Corners of the outer walls, counter-clockwise.
    pub outline: Vec<[f32; 2]>,
    /// Corners of the obstacles, counter-clockwise.
    pub boxes: Vec<[[f32; 2]; 4]>,
    pub faces: Vec<Face>,
    pub patches: Vec<Patch>,
    /// Grey level of the floor outside the patches.
    pub grey: f32,
    pub lights: Vec<Light>,
    pub spots: Vec<Spot>,
    pub objects: Vec<Kind>,
}

impl Place {
    /// Returns the lower left and upper right corners of the bounding box of all walls, with a margin.
    pub fn extent(&self) -> [[f32; 2]; 2] {
        let (mut low, mut high) = ([f32::INFINITY; 2], [f32::NEG_INFINITY; 2]);
        for face in &self.faces {
            for axis in 0..2 {
                for end in face.ends() {
                    low[axis] = low[axis].min(end[axis] - MARGIN);
                    high[axis] = high[axis].max(end[axis] + MARGIN);
                }
            }
        }
        [low, high]
    }

    /// Returns the distance in the plane from a point to the farthest corner of the outer walls.
    pub fn farthest(&self, [x, y, _]: [f32; 3]) -> f32 {
        let corners = self.outline.iter();
        let far = corners.map(|corner| (corner[0] - x).hypot(corner[1] - y));
        far.fold(0.0, f32::max)
    }

    /// Returns whether a point is inside the outer walls and outside all obstacles.
    pub fn is_free(&self, point: [f64; 2]) -> bool {
        let boxed = |corners: &[[f32; 2]; 4]| polygon::contains(corners, point);
        polygon::contains(&self.outline, point) && !self.boxes.iter().any(boxed)
    }

    /// Returns the form of each object, kind by kind.
    pub fn forms(&self) -> impl Iterator<Item = Form> + '_ {
        let same = |kind: &Kind| std::iter::repeat_n(kind.form, kind.count());
        self.objects.iter().flat_map(same)
    }

    /// Returns the patch with this name.
    #[inline]
    pub fn patch(&self, name: &str) -> Option<&Patch> {
        self.patches.iter().find(|patch| patch.name == name)
    }

    /// Returns the index of the patch with this name.
    #[inline]
    pub fn index(&self, name: &str) -> Option<usize> {
        self.patches.iter().position(|patch| patch.name == name)
    }

    /// Returns the colours of the patches in an episode.
    #[inline]
    pub fn colors(&self, seed: u64) -> impl Iterator<Item = f32> + '_ {
        self.patches.iter().enumerate().map(move |(index, patch)| {
            let drawn = || f32::from(u8::from(uniform(seed, COLORS, index as u64) < 0.5));
            patch.grey.unwrap_or_else(drawn)
        })
    }

    /// Returns the colour of the floor at points, which is that of the last patch that contains them. `colors` are
    /// those of the patches.
    #[inline(always)]
    pub fn floor<L: Lanes>(&self, x: Number<L>, y: Number<L>, colors: &[Number<L>]) -> Number<L> {
        let mut grey = number(self.grey);
        for (index, patch) in self.patches.iter().enumerate() {
            grey = colors[index].select(grey, patch.shape.holds(x, y));
        }
        grey
    }
}
