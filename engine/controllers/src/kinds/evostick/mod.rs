//! The network of EvoStick.

mod lanes;
mod read;

use super::Kind;
use crate::functions::sigmoid;
use crate::reader::Reader;
use crate::{OutputRange, SpecificationError};
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
    const SIZE: (&'static str, &'static str) = ("sensors", "take fewer sensors");

    fn read(reader: &mut Reader<'_>) -> Result<Self, SpecificationError> {
        read::read(reader)
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
        actuators.fill(0.0);
        let mut rows = weights.chunks_exact(self.actuators);
        for (input, row) in sensors.iter().zip(&mut rows) {
            for (sum, weight) in actuators.iter_mut().zip(row) {
                *sum += weight * input;
            }
        }
        for (actuator, bias) in actuators.iter_mut().zip(rows.next().unwrap_or_default()) {
            let output = sigmoid(STEEPNESS * (*actuator + bias));
            *actuator = OutputRange::UNIT.actuator(output);
        }
    }
}
