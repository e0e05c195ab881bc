//! The colour of the floor, filtered as in the reference model.

use swarmwright_lanes::{Lanes, Number, number};

use crate::bodies::Bodies;
use crate::math::random::noise;
use crate::place::Place;
use crate::robots::GroundSensors;

/// Number of ticks whose readings are considered.
const WINDOW: usize = 5;
/// Share of the readings that a colour must exceed.
const ENOUGH: f32 = 2.0 / 3.0;
/// Readings below this are black.
const BLACK: f32 = 0.03;
/// Readings above this are white.
const WHITE: f32 = 0.85;

/// Ground readings of the last ticks.
pub struct GroundWindow<L> {
    /// Numbers of black and white readings, by robot and tick of the window.
    counts: Vec<[[Number<L>; 2]; WINDOW]>,
    /// Filtered colour for each robot: 0 black, 0.5 grey, 1 white.
    pub seen: Vec<Number<L>>,
    /// Readings of the robot that was processed last.
    pub readings: Vec<Number<L>>,
}

impl<L: Lanes> GroundWindow<L> {
    pub fn new(robots: usize) -> Self {
        Self {
            counts: vec![[[number(0.0); 2]; WINDOW]; robots],
            seen: vec![number(0.5); robots],
            readings: Vec::new(),
        }
    }

    #[inline(always)]
    pub fn clear(&mut self) {
        self.counts.fill([[number(0.0); 2]; WINDOW]);
    }

    /// Reads the ground sensors of a robot.
    #[inline(always)]
    pub fn read(
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
