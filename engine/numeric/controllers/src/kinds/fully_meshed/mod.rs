//! Fully meshed networks, as in FREVO.

mod lanes;

use super::Kind;
use crate::reader::Reader;
use crate::{Activation, MAX_WEIGHTS, OutputRange, SpecificationError};
use serde::Serialize;

const ACTIVATIONS: [Activation; 4] = [
    Activation::Clamp,
    Activation::Sigmoid,
    Activation::Tanh,
    Activation::Relu,
];
const MAX_ITERATIONS: usize = 1000;

/// A recurrent network in which every node is connected to every node (FREVO's FullyMeshedNet).
///
/// Nodes: sensors, then hidden, then actuators. Weights: for every node except sensors, in that order: the bias,
/// then one weight from every node (sensors, hidden, actuators, itself included). The outputs of all nodes stay
/// from step to step; a reset sets them to 0.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct FullyMeshed {
    /// Numbers in.
    pub sensors: usize,
    /// Numbers out.
    pub actuators: usize,
    /// Hidden nodes.
    pub hidden: usize,
    /// What every node does to its sum.
    pub activation: Activation,
    /// Updates of all nodes in a step.
    pub iterations: u32,
    /// Network outputs that become actuators -1 to 1.
    pub output_range: OutputRange,
}

impl FullyMeshed {
    /// All nodes, sensors included.
    fn nodes(&self) -> usize {
        self.sensors + self.hidden + self.actuators
    }
}

impl Kind for FullyMeshed {
    const SIZE: (&'static str, &'static str) = ("hidden", "use a smaller network");

    fn read(reader: &mut Reader<'_>) -> Result<Self, SpecificationError> {
        Ok(Self {
            sensors: reader.count("sensors", 1, MAX_WEIGHTS)?,
            actuators: reader.count("actuators", 1, MAX_WEIGHTS)?,
            hidden: reader.count("hidden", 0, MAX_WEIGHTS)?,
            activation: reader.activation(&ACTIVATIONS)?,
            iterations: u32::try_from(reader.count("iterations", 1, MAX_ITERATIONS)?)
                .unwrap_or(u32::MAX),
            output_range: reader.output_range()?,
        })
    }

    fn weight_count(&self) -> Option<usize> {
        let active = self.hidden.checked_add(self.actuators)?;
        active.checked_mul(active.checked_add(self.sensors)?.checked_add(1)?)
    }

    fn sensors(&self) -> usize {
        self.sensors
    }

    fn actuators(&self) -> usize {
        self.actuators
    }

    /// The outputs of all nodes.
    fn state_length(&self) -> usize {
        self.nodes()
    }

    fn scratch_length(&self) -> usize {
        self.nodes()
    }

    #[inline]
    fn step(
        &self,
        weights: &[f32],
        outputs: &mut [f32],
        scratch: &mut [f32],
        sensors: &[f32],
        actuators: &mut [f32],
    ) {
        outputs[..sensors.len()].copy_from_slice(sensors);
        for _ in 0..self.iterations {
            // All nodes are updated at once, from the outputs of the iteration before.
            for (next, row) in scratch[self.sensors..]
                .iter_mut()
                .zip(weights.chunks_exact(self.nodes() + 1))
            {
                let mut sum = 0.0_f32;
                for (weight, output) in row[1..].iter().zip(outputs.iter()) {
                    sum += weight * output;
                }
                *next = self.activation.apply(row[0] + sum);
            }
            outputs[self.sensors..].copy_from_slice(&scratch[self.sensors..]);
        }
        for (actuator, output) in actuators
            .iter_mut()
            .zip(&outputs[self.sensors + self.hidden..])
        {
            *actuator = self.output_range.actuator(*output);
        }
    }
}
