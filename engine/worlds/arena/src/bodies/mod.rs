//! Bodies that move: robots, and objects that they push. Their motion within a tick is computed in `contacts`.

mod objects;

use std::ops::Range;

use swarmwright_lanes::{Lanes, Mask, Number, number};

use crate::place::{Kind, Pose};
use crate::robots::Team;

pub use objects::{FASTEST, Moving, Object, Objects, Point, Surface, Touch};

/// Robots, with one vector of lanes for each quantity and robot, and objects.
pub struct Bodies<L: Lanes> {
    /// Position, metres.
    pub x: Vec<Number<L>>,
    pub y: Vec<Number<L>>,
    /// Heading in half turns, -1..=1, with its cosine and sine.
    pub heading: Vec<Number<L>>,
    pub cos: Vec<Number<L>>,
    pub sin: Vec<Number<L>>,
    /// Velocity, m/s.
    pub vx: Vec<Number<L>>,
    pub vy: Vec<Number<L>>,
    /// Angular velocity, rad/s.
    pub spin: Vec<Number<L>>,
    pub objects: Objects<L>,
    /// Lanes in which each robot is caught; empty if the mission has no captures.
    pub caught: Vec<L::Mask>,
    /// Names of the flags.
    pub flags: Vec<String>,
    /// Lanes in which each robot carries each flag, flag by flag.
    pub carried: Vec<L::Mask>,
    /// Lanes in which each flag was brought home in this tick.
    pub brought: Vec<L::Mask>,
    /// Names of the robot kinds, with the index range of each.
    kinds: Vec<(String, Range<usize>)>,
}

impl<L: Lanes> Bodies<L> {
    pub fn new(team: &Team, objects: &[Kind]) -> Self {
        let robots = team.len();
        let zeros = || vec![number(0.0); robots];
        Self {
            x: zeros(),
            y: zeros(),
            heading: zeros(),
            cos: zeros(),
            sin: zeros(),
            vx: zeros(),
            vy: zeros(),
            spin: zeros(),
            objects: Objects::new(objects, if team.gripper().is_some() { robots } else { 0 }),
            caught: Vec::new(),
            flags: Vec::new(),
            carried: Vec::new(),
            brought: Vec::new(),
            kinds: team.named().collect(),
        }
    }

    /// Number of robots.
    #[inline(always)]
    pub fn len(&self) -> usize {
        self.x.len()
    }

    /// Returns the indices of the robots of a kind, or of all robots.
    #[inline(always)]
    pub fn named(&self, name: Option<&str>) -> Range<usize> {
        let Some(name) = name else {
            return 0..self.len();
        };
        for (kind, robots) in &self.kinds {
            if kind == name {
                return robots.clone();
            }
        }
        0..0
    }

    /// Returns the lanes in which a robot carries a flag.
    #[inline(always)]
    pub fn carries(&self, robot: usize) -> L::Mask {
        let mut carries = L::Mask::from_bits(0);
        for flag in 0..self.brought.len() {
            carries = carries.or(self.carried[flag * self.len() + robot]);
        }
        carries
    }

    /// Returns the names of the robot kinds, with the index range of each.
    #[inline(always)]
    pub fn kinds(&self) -> &[(String, Range<usize>)] {
        &self.kinds
    }

    /// Returns the vector from one robot to another.
    #[inline(always)]
    pub fn between(&self, from: usize, to: usize) -> [Number<L>; 2] {
        [self.x[to] - self.x[from], self.y[to] - self.y[from]]
    }
}

impl Bodies<f32> {
    /// Returns the poses of the robots.
    pub fn poses(&self) -> impl Iterator<Item = Pose> + '_ {
        (0..self.len()).map(|index| Pose {
            at: [self.x[index].0, self.y[index].0],
            heading: self.heading[index].0,
        })
    }
}
