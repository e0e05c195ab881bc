//! A steering rule written by hand: to the goal, and around the closest defender.

use super::{Point, distance};

/// Side on which an agent evades a defender.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Evasion {
    Away,
    Left,
    Right,
}

/// The rule's own parameters; the module above has its arithmetic.
#[derive(Debug, Clone, Copy)]
pub(super) struct Rule {
    /// How much a defender counts, against the goal's 1, when it is as close as can be.
    pub avoidance: f32,
    /// From which distance on a defender counts.
    pub radius: f32,
    pub evasion: Evasion,
}

impl Rule {
    /// The direction of an agent, of any length.
    pub fn way(&self, from: Point, goal: Point, defender: Option<Point>) -> Point {
        let d = distance(from, goal);
        let mut way = if d > 0.0 {
            [(goal[0] - from[0]) / d, (goal[1] - from[1]) / d]
        } else {
            [0.0; 2]
        };
        let Some(defender) = defender else {
            return way;
        };
        let r = distance(from, defender);
        if r > 0.0 && r < self.radius {
            let e = [defender[0] - from[0], defender[1] - from[1]];
            let v = match self.evasion {
                Evasion::Away => [-e[0], -e[1]],
                Evasion::Left => [-e[1], e[0]],
                Evasion::Right => [e[1], -e[0]],
            };
            let s = self.avoidance * (1.0 - r / self.radius);
            way[0] += s * (v[0] / r);
            way[1] += s * (v[1] / r);
        }
        way
    }
}
