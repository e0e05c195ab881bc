//! The colour of the floor, as the reference model filters it.

use swarmwright_lanes::{Lanes, Number, number};

use crate::bodies::Bodies;
use crate::math::random::noise;
use crate::place::Place;
use crate::robots::GroundSensors;

/// Ticks whose readings count.
const WINDOW: usize = 5;
/// The share of the readings that a colour needs more of.
const ENOUGH: f32 = 2.0 / 3.0;
/// A reading below is black.
const BLACK: f32 = 0.03;
/// A reading above is white.
const WHITE: f32 = 0.85;

/// Readings of the last ticks.
pub(crate) struct GroundWindow<L> {
    /// By robot and tick of the window: readings that were black, and white.
    counts: Vec<[[Number<L>; 2]; WINDOW]>,
    /// By robot: 0 black, 0.5 grey, 1 white.
    pub seen: Vec<Number<L>>,
    /// Of the robot that looked last.
    pub readings: Vec<Number<L>>,
}

impl<L: Lanes> GroundWindow<L> {
    pub(crate) fn new(robots: usize) -> Self {
        Self {
            counts: vec![[[number(0.0); 2]; WINDOW]; robots],
            seen: vec![number(0.5); robots],
            readings: Vec::new(),
        }
    }

    #[inline(always)]
    pub(crate) fn clear(&mut self) {
        self.counts.fill([[number(0.0); 2]; WINDOW]);
    }

    /// A robot looks at the floor.
    #[inline(always)]
    pub(crate) fn read(
        &mut self,
        sensors: &GroundSensors,
        (layout, colors): (&Place, &[Number<L>]),
        bodies: &Bodies<L>,
        index: usize,
        tick: u32,
        units: &[Number<L>],
    ) {
        let (x, y) = (bodies.x[index], bodies.y[index]);
        let (cos, sin) = (bodies.cos[index], bodies.sin[index]);
        self.readings.clear();
        let (mut black, mut white) = (number(0.0), number(0.0));
        for (index, point) in sensors.points.iter().enumerate() {
            let unit = units[index];
            let grey = layout.floor(
                x + (cos * point[0] - sin * point[1]),
                y + (sin * point[0] + cos * point[1]),
                colors,
            );
            let reading = (grey + noise(unit, sensors.noise)).within(0.0, 1.0);
            self.readings.push(reading);
            black = black.add_where(number(1.0), reading.lt(number(BLACK)));
            white = white.add_where(number(1.0), number(WHITE).lt(reading));
        }
        let counts = &mut self.counts[index];
        counts[tick as usize % WINDOW] = [black, white];
        let (mut black, mut white) = (number(0.0), number(0.0));
        for count in counts.iter() {
            black += count[0];
            white += count[1];
        }
        let enough = number((WINDOW * sensors.points.len()) as f32 * ENOUGH);
        let shade = number::<L>(1.0).select(number(0.5), enough.lt(white));
        self.seen[index] = number::<L>(0.0).select(shade, enough.lt(black));
    }
}
