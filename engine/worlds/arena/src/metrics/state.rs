//! The robots of one episode at one moment, in binary64.

use swarmwright_lanes::{Lanes, MOST_LANES};

use crate::bodies::Bodies;

/// The state of a robot.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub(super) struct State {
    /// Position, metres.
    pub(super) at: [f64; 2],
    /// Heading, a unit vector.
    pub(super) heading: [f64; 2],
    /// Velocity, m/s.
    pub(super) velocity: [f64; 2],
}

/// Writes the robots of the first lane, then those of the second lane, and so on.
#[inline(always)]
pub(super) fn gather<L: Lanes>(bodies: &Bodies<L>, states: &mut Vec<State>) {
    let count = bodies.len();
    states.clear();
    states.resize(count * L::WIDTH, State::default());
    for index in 0..count {
        let mut lanes = [[0.0; MOST_LANES]; 6];
        let quantities = [
            &bodies.x[index],
            &bodies.y[index],
            &bodies.cos[index],
            &bodies.sin[index],
            &bodies.vx[index],
            &bodies.vy[index],
        ];
        for (lanes, quantity) in lanes.iter_mut().zip(quantities) {
            quantity.store(lanes);
        }
        for lane in 0..L::WIDTH {
            let [x, y, cos, sin, vx, vy] = lanes.map(|lanes| f64::from(lanes[lane]));
            states[lane * count + index] = State {
                at: [x, y],
                heading: [cos, sin],
                velocity: [vx, vy],
            };
        }
    }
}

pub(super) fn square(a: [f64; 2], b: [f64; 2]) -> f64 {
    let (dx, dy) = (a[0] - b[0], a[1] - b[1]);
    dx * dx + dy * dy
}

pub(super) fn length([x, y]: [f64; 2]) -> f64 {
    (x * x + y * y).sqrt()
}

/// Returns the sum of vectors.
pub(super) fn sum(vectors: impl Iterator<Item = [f64; 2]>) -> [f64; 2] {
    vectors.fold([0.0; 2], |[x, y], vector| [x + vector[0], y + vector[1]])
}

pub(super) fn center(robots: &[State]) -> [f64; 2] {
    let count = robots.len() as f64;
    sum(robots.iter().map(|robot| robot.at)).map(|total| total / count)
}
