//! Code shared by behaviours that follow a sum of vectors.

use swarmwright_lanes::Lanes;

use crate::kinds::modules::lanes::length;
use crate::kinds::modules::{SHORT, STATE_LIMITS, Sensed, limited};

/// What the vectors are multiplied by before they are added.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Pull {
    pub light: f32,
    /// Of what attracts to neighbours, times the state's parameter alpha ...
    pub neighbours: f32,
    /// ... and times its square.
    pub squared: f32,
    pub obstacles: f32,
}

pub(super) const NONE: Pull = Pull {
    light: 0.0,
    neighbours: 0.0,
    squared: 0.0,
    obstacles: 0.0,
};

/// The speeds of both wheels.
pub(super) fn act(pull: Pull, row: &[f32], sensed: &Sensed) -> [f32; 2] {
    let alpha = limited(row[2], STATE_LIMITS[2]);
    let neighbours = (pull.neighbours + pull.squared * alpha) * alpha;
    let sum = |axis: usize| {
        pull.light * sensed.light[axis]
            + neighbours * sensed.attraction[axis]
            + pull.obstacles * sensed.proximity[axis]
    };
    steer(sum(0), sum(1))
}

/// Wheels that turn the robot towards a vector: the outer one at full speed.
fn steer(x: f32, y: f32) -> [f32; 2] {
    let length = (x * x + y * y).sqrt();
    let short = length < SHORT;
    let (x, y) = if short { (1.0, 0.0) } else { (x, y) };
    let length = if short { 1.0 } else { length };
    let inner = x / length;
    let inner = if inner.is_nan() { 0.0 } else { inner };
    let inner = if inner > 1.0 { 1.0 } else { inner };
    let inner = if inner < -1.0 { -1.0 } else { inner };
    if y > 0.0 { [inner, 1.0] } else { [1.0, inner] }
}

/// Factors of the lanes, which follow different vectors.
pub(super) struct LanePull<L> {
    light: L,
    neighbours: L,
    squared: L,
    obstacles: L,
}

impl<L: Lanes> LanePull<L> {
    #[inline(always)]
    pub(super) fn none() -> Self {
        let zero = L::splat(0.0);
        Self {
            light: zero,
            neighbours: zero,
            squared: zero,
            obstacles: zero,
        }
    }

    /// Takes the factors of these lanes.
    #[inline(always)]
    pub(super) fn set(&mut self, pull: Pull, lanes: L::Mask) {
        self.light = L::splat(pull.light).select(self.light, lanes);
        self.neighbours = L::splat(pull.neighbours).select(self.neighbours, lanes);
        self.squared = L::splat(pull.squared).select(self.squared, lanes);
        self.obstacles = L::splat(pull.obstacles).select(self.obstacles, lanes);
    }

    /// As [`act`].
    #[inline(always)]
    pub(super) fn act(&self, alpha: L, sensors: &[L]) -> [L; 2] {
        let neighbours = self.neighbours.add(self.squared.mul(alpha)).mul(alpha);
        let sum = |axis: usize| {
            self.light
                .mul(sensors[2 + axis])
                .add(neighbours.mul(sensors[6 + axis]))
                .add(self.obstacles.mul(sensors[axis]))
        };
        steer_in_lanes(sum(0), sum(1))
    }
}

#[inline(always)]
fn steer_in_lanes<L: Lanes>(x: L, y: L) -> [L; 2] {
    #[expect(clippy::disallowed_names, reason = "the number 1")]
    let (zero, one) = (L::splat(0.0), L::splat(1.0));
    let length = length([x, y]);
    let short = length.lt(L::splat(SHORT));
    let (x, y) = (one.select(x, short), zero.select(y, short));
    let inner = x.div(one.select(length, short));
    let inner = zero.select(inner, inner.is_nan());
    let inner = inner.at_most(one).at_least(one.neg());
    let to_left = zero.lt(y);
    [inner.select(one, to_left), one.select(inner, to_left)]
}
