//! The network of EvoStick.

mod lanes;

use super::Kind;
use crate::functions::sigmoid;
use crate::reader::Reader;
use crate::{MAX_WEIGHTS, OutputRange, SpecificationError};
use serde::Serialize;

/// What a sum is multiplied by before the logistic function.
pub(crate) const STEEPNESS: f32 = 4.924273;

/// A network without hidden nodes whose outputs are steep logistic functions (G. Francesca, M. Brambilla, A. Brutschy,
/// V. Trianni and M. Birattari, "AutoMoDe: a novel approach to the automatic design of control software for robot swarms",
/// Swarm Intelligence 8, 2014). Keeps nothing between steps.
///
/// Weights: sensor after sensor, one weight for every output, then one for every output's bias.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Evostick {
    /// Numbers in.
    pub sensors: usize,
    /// Numbers out.
    pub actuators: usize,
}

impl Kind for Evostick {
    const SIZE: (&'static str, &'static str) = ("sensors", "use fewer sensors");

    fn read(reader: &mut Reader<'_>) -> Result<Self, SpecificationError> {
        Ok(Self {
            sensors: reader.count("sensors", 1, MAX_WEIGHTS)?,
            actuators: reader.count("actuators", 1, MAX_WEIGHTS)?,
        })
    }

    fn weight_count(&self) -> Option<usize> {
        self.actuators.checked_mul(self.sensors.checked_add(1)?)
    }

    fn sensors(&self) -> usize {
        self.sensors
    }

    fn actuators(&self) -> usize {
        self.actuators
    }

    fn state_length(&self) -> usize {
        0
    }

    fn scratch_length(&self) -> usize {
        0
    }

    #[inline]
    fn step(
        &self,
        weights: &[f32],
        _state: &mut [f32],
        _scratch: &mut [f32],
        sensors: &[f32],
        actuators: &mut [f32],
    ) {
        // Two at a time, as wheels come in pairs.
        let pairs = self.actuators / 2 * 2;
        for first in (0..pairs).step_by(2) {
            outputs::<2>(weights, first, sensors, actuators);
        }
        if pairs < self.actuators {
            outputs::<1>(weights, pairs, sensors, actuators);
        }
    }
}

/// Some of the outputs; their sums stay in registers.
#[inline]
fn outputs<const N: usize>(weights: &[f32], first: usize, sensors: &[f32], actuators: &mut [f32]) {
    let mut rows = weights.chunks_exact(actuators.len());
    let mut sums = [0.0; N];
    for (input, row) in sensors.iter().zip(&mut rows) {
        let row = &row[first..][..N];
        for output in 0..N {
            sums[output] += row[output] * input;
        }
    }
    let biases = &rows.next().unwrap_or_default()[first..][..N];
    for output in 0..N {
        let number = sigmoid(STEEPNESS * (sums[output] + biases[output]));
        actuators[first + output] = OutputRange::UNIT.actuator(number);
    }
}
