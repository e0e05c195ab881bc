//! Networks with given connections, as FREVO's NEAT computes them.

mod lanes;

use super::Kind;
use crate::functions::exp;
use crate::reader::{Reader, wrong};
use crate::{MAX_WEIGHTS, OutputRange, SpecificationError};
use serde::Serialize;

const MAX_ITERATIONS: usize = 1000;

/// A recurrent network whose nodes hear those that a list names (FREVO's NEAT, after K. O. Stanley and R. Miikkulainen, "Evolving
/// neural networks through augmenting topologies", Evolutionary Computation 10, 2002).
///
/// Nodes: sensors, then hidden, then actuators. Weights: for every node that is not a sensor, in that order, the bias, one
/// weight for each node that it hears, and for an actuator the slope of its sigmoid. Nodes are computed one after the
/// other, from the outputs that there are, in binary64; the outputs of all nodes stay from step to step.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Neat {
    /// Numbers in.
    pub sensors: usize,
    /// Numbers out.
    pub actuators: usize,
    /// What each node but the sensors hears, in the order in which it is added: numbers of nodes.
    pub sources: Vec<Vec<usize>>,
    /// Updates of all nodes in a step.
    pub iterations: u32,
}

impl Neat {
    /// How many nodes are hidden.
    fn hidden(&self) -> usize {
        self.sources.len() - self.actuators
    }
}

/// Binary32 numbers that together keep an output from step to step: its bits.
const KEPT: usize = 2;

#[inline]
fn pack_output(output: f64) -> [f32; KEPT] {
    let bits = output.to_bits();
    [bits >> 32, bits & u64::from(u32::MAX)].map(|half| f32::from_bits(half as u32))
}

#[inline]
fn unpack_output([high, low]: [f32; KEPT]) -> f64 {
    f64::from_bits(u64::from(high.to_bits()) << 32 | u64::from(low.to_bits()))
}

/// The output of a node for the sum of what it hears: with a slope the logistic function, without one the hyperbolic
/// tangent.
#[inline]
fn activation(slope: Option<f32>, sum: f64) -> f64 {
    if let Some(slope) = slope {
        1.0 / (1.0 + exp(-f64::from(slope) * sum))
    } else if sum < -20.0 {
        -1.0
    } else if sum > 20.0 {
        1.0
    } else {
        let e = exp(-2.0 * sum);
        (1.0 - e) / (1.0 + e)
    }
}

impl Kind for Neat {
    const SIZE: (&'static str, &'static str) = ("sources", "use a smaller network");

    fn read(reader: &mut Reader<'_>) -> Result<Self, SpecificationError> {
        let sensors = reader.count("sensors", 1, MAX_WEIGHTS)?;
        let actuators = reader.count("actuators", 1, MAX_WEIGHTS)?;
        let sources = reader.lists("sources", |rows| (sensors + rows).saturating_sub(1))?;
        if sources.len() < actuators {
            return Err(wrong(
                "sources",
                format!(
                    "{} lists found, expected one for each hidden node and each of the {actuators} actuators",
                    sources.len()
                ),
            ));
        }
        Ok(Self {
            sensors,
            actuators,
            sources,
            iterations: u32::try_from(reader.count("iterations", 1, MAX_ITERATIONS)?)
                .unwrap_or(u32::MAX),
        })
    }

    fn weight_count(&self) -> Option<usize> {
        Some(self.sources.iter().map(|row| 1 + row.len()).sum::<usize>() + self.actuators)
    }

    fn sensors(&self) -> usize {
        self.sensors
    }

    fn actuators(&self) -> usize {
        self.actuators
    }

    /// The outputs of all nodes but the sensors.
    fn state_length(&self) -> usize {
        KEPT * self.sources.len()
    }

    fn scratch_length(&self) -> usize {
        0
    }

    #[inline]
    fn step(
        &self,
        weights: &[f32],
        state: &mut [f32],
        _scratch: &mut [f32],
        sensors: &[f32],
        actuators: &mut [f32],
    ) {
        let hidden = self.hidden();
        for _ in 0..self.iterations {
            let mut weights = weights.iter();
            let mut next = || weights.next().copied().unwrap_or_default();
            for (node, row) in self.sources.iter().enumerate() {
                let bias = next();
                let mut sum = 0.0;
                for source in row {
                    let heard = match source.checked_sub(self.sensors) {
                        None => f64::from(sensors[*source]),
                        Some(at) => unpack_output([state[KEPT * at], state[KEPT * at + 1]]),
                    };
                    sum += heard * f64::from(next());
                }
                sum += f64::from(bias);
                let slope = (node >= hidden).then(&mut next);
                let parts = pack_output(activation(slope, sum));
                state[KEPT * node..][..KEPT].copy_from_slice(&parts);
            }
        }
        for (actuator, parts) in actuators
            .iter_mut()
            .zip(state[KEPT * hidden..].chunks_exact(KEPT))
        {
            *actuator = OutputRange::UNIT.actuator(unpack_output([parts[0], parts[1]]) as f32);
        }
    }
}
