//! Layered feed-forward networks.

mod lanes;

use super::Kind;
use crate::reader::Reader;
use crate::{Activation, MAX_WEIGHTS, OutputRange, SpecificationError};
use serde::Serialize;

/// A feed-forward network: sensors, any number of hidden layers, actuators. Keeps nothing between steps.
///
/// Weights: layer after layer, node after node: the bias, then one weight for every output of the layer below.
/// The activation applies to every layer, to the last one only where `output_activation` is left out.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Layered {
    /// Numbers in.
    pub sensors: usize,
    /// Numbers out.
    pub actuators: usize,
    /// Nodes of each hidden layer, from the sensors up.
    pub hidden: Vec<usize>,
    /// What every node does to its sum.
    pub activation: Activation,
    /// What the nodes of the last layer do instead.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub output_activation: Option<Activation>,
    /// Network outputs that become actuators -1 to 1.
    pub output_range: OutputRange,
}

impl Layered {
    /// Nodes of each layer above the sensors, and what they do to their sums.
    fn layers(&self) -> impl Iterator<Item = (usize, Activation)> + '_ {
        let hidden = self.hidden.iter().map(|nodes| (*nodes, self.activation));
        let last = self.output_activation.unwrap_or(self.activation);
        hidden.chain([(self.actuators, last)])
    }

    fn widest(&self) -> usize {
        self.layers()
            .fold(self.sensors, |widest, (nodes, _)| widest.max(nodes))
    }
}

impl Kind for Layered {
    const SIZE: (&'static str, &'static str) = ("hidden", "use a smaller network");

    fn read(reader: &mut Reader<'_>) -> Result<Self, SpecificationError> {
        Ok(Self {
            sensors: reader.count("sensors", 1, MAX_WEIGHTS)?,
            actuators: reader.count("actuators", 1, MAX_WEIGHTS)?,
            hidden: reader.counts("hidden", 1, MAX_WEIGHTS)?,
            activation: reader.activation(&Activation::ALL)?,
            output_activation: reader.output_activation(&Activation::ALL)?,
            output_range: reader.output_range()?,
        })
    }

    fn weight_count(&self) -> Option<usize> {
        let mut below = self.sensors;
        let mut count = 0_usize;
        for (nodes, _) in self.layers() {
            count = count.checked_add(nodes.checked_mul(below.checked_add(1)?)?)?;
            below = nodes;
        }
        Some(count)
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

    /// The outputs of two neighbouring layers.
    fn scratch_length(&self) -> usize {
        2 * self.widest()
    }

    #[inline]
    fn step(
        &self,
        weights: &[f32],
        _state: &mut [f32],
        scratch: &mut [f32],
        sensors: &[f32],
        actuators: &mut [f32],
    ) {
        let (mut below, mut above) = scratch.split_at_mut(self.widest());
        below[..sensors.len()].copy_from_slice(sensors);
        let mut width = self.sensors;
        let mut rest = weights;
        for (nodes, activation) in self.layers() {
            let (layer, behind) = rest.split_at(nodes * (width + 1));
            for (output, row) in above.iter_mut().zip(layer.chunks_exact(width + 1)) {
                let mut sum = 0.0_f32;
                for (weight, input) in row[1..].iter().zip(below.iter()) {
                    sum += weight * input;
                }
                *output = activation.apply(row[0] + sum);
            }
            (below, above) = (above, below);
            (width, rest) = (nodes, behind);
        }
        for (actuator, output) in actuators.iter_mut().zip(below.iter()) {
            *actuator = self.output_range.actuator(*output);
        }
    }
}
