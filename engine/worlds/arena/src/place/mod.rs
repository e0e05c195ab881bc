//! Where robots are: walls, floor and lights.

pub(crate) mod area;
mod color;
mod face;
mod object;

use swarmwright_lanes::{Lanes, Mask, Number, number};
use swarmwright_simulation::counter::uniform;

use crate::math::polygon;

pub(crate) use area::{Pose, Start};
pub(crate) use color::LedColor;
pub(crate) use face::{Face, to_face};
pub(crate) use object::{Form, Kind, MOST_OBJECTS, Places};

/// The stream of random numbers of colours.
const COLORS: u64 = 0x636F_6C6F_7273;

/// What is shown around the walls, metres.
const MARGIN: f32 = 0.05;

/// A shape on the floor.
#[derive(Debug, Clone, PartialEq)]
pub(crate) enum Shape {
    Circle {
        center: [f32; 2],
        radius: f32,
    },
    /// Lower left and upper right corner; infinite where it does not end.
    Box {
        low: [f32; 2],
        high: [f32; 2],
    },
    /// Convex, corners counter-clockwise.
    Polygon {
        corners: Vec<[f32; 2]>,
    },
}

impl Shape {
    /// The middle of its extent; infinite or no number where it does not end.
    pub(crate) fn middle(&self) -> [f64; 2] {
        let [low, high] = match self {
            Self::Circle { center, .. } => [*center; 2],
            Self::Box { low, high } => [*low, *high],
            Self::Polygon { corners } => polygon::extent(corners),
        };
        [0, 1].map(|axis| (f64::from(low[axis]) + f64::from(high[axis])) / 2.0)
    }

    /// Whether points lie in it, the edge included.
    #[inline(always)]
    pub(crate) fn holds<L: Lanes>(&self, x: Number<L>, y: Number<L>) -> L::Mask {
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

/// A part of the floor with a colour of its own.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Patch {
    pub name: String,
    pub shape: Shape,
    /// 0 black to 1 white; `None` for black or white by the seed of the episode.
    pub grey: Option<f32>,
}

/// A lamp.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Light {
    /// x, y, z, metres.
    pub at: [f32; 3],
    pub intensity: f32,
    /// What cameras see at its foot.
    pub color: Option<LedColor>,
}

/// A coloured spot on a wall, for cameras alone.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Spot {
    pub at: [f32; 2],
    pub color: LedColor,
    /// The part of the wall that it stands for: unit vector along it, and half of its length, metres.
    pub along: [f32; 2],
    pub half: f32,
}

/// Largest distance of spots on a wall, metres.
const SPOTS: f32 = 0.1;
/// How far spots are in front of the wall, metres: it does not hide them.
const IN_FRONT: f32 = 0.001;

impl Face {
    /// The middles of equal parts of a stretch, which is metres from the first end.
    pub(crate) fn spots(&self, [from, to]: [f32; 2], color: LedColor) -> Vec<Spot> {
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

/// Everything that does not move, and what robots can push.
#[derive(Debug, Clone, PartialEq, Default)]
pub(crate) struct Place {
    /// Corners of the walls around, counter-clockwise.
    pub outline: Vec<[f32; 2]>,
    /// Corners of the boxes within, counter-clockwise.
    pub boxes: Vec<[[f32; 2]; 4]>,
    pub faces: Vec<Face>,
    pub patches: Vec<Patch>,
    /// Of the floor beside the patches.
    pub grey: f32,
    pub lights: Vec<Light>,
    pub spots: Vec<Spot>,
    pub objects: Vec<Kind>,
}

impl Place {
    /// Lower left and upper right corner of all walls, with a margin.
    pub(crate) fn extent(&self) -> [[f32; 2]; 2] {
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

    /// The distance in the plane of a point from the corner of the walls that is farthest from it.
    pub(crate) fn farthest(&self, [x, y, _]: [f32; 3]) -> f32 {
        let corners = self.outline.iter();
        let far = corners.map(|corner| (corner[0] - x).hypot(corner[1] - y));
        far.fold(0.0, f32::max)
    }

    /// Whether a point is inside of the walls and of no box.
    pub(crate) fn is_free(&self, point: [f64; 2]) -> bool {
        let boxed = |corners: &[[f32; 2]; 4]| polygon::contains(corners, point);
        polygon::contains(&self.outline, point) && !self.boxes.iter().any(boxed)
    }

    /// The form of each object, one kind's after another's.
    pub(crate) fn forms(&self) -> impl Iterator<Item = Form> + '_ {
        let same = |kind: &Kind| std::iter::repeat_n(kind.form, kind.count());
        self.objects.iter().flat_map(same)
    }

    /// The patch with this name.
    pub(crate) fn patch(&self, name: &str) -> Option<&Patch> {
        self.patches.iter().find(|patch| patch.name == name)
    }

    /// Its index.
    pub(crate) fn index(&self, name: &str) -> Option<usize> {
        self.patches.iter().position(|patch| patch.name == name)
    }

    /// The colours of the patches in an episode.
    pub(crate) fn colors(&self, seed: u64) -> impl Iterator<Item = f32> + '_ {
        self.patches.iter().enumerate().map(move |(index, patch)| {
            let drawn = || f32::from(u8::from(uniform(seed, COLORS, index as u64) < 0.5));
            patch.grey.unwrap_or_else(drawn)
        })
    }

    /// The colour of the floor at points: that of the last patch that holds them. `colors`: of the patches.
    #[inline(always)]
    pub(crate) fn floor<L: Lanes>(
        &self,
        x: Number<L>,
        y: Number<L>,
        colors: &[Number<L>],
    ) -> Number<L> {
        let mut grey = number(self.grey);
        for (index, patch) in self.patches.iter().enumerate() {
            grey = colors[index].select(grey, patch.shape.holds(x, y));
        }
        grey
    }
}
