//! Networks with Hebbian learning, as in FREVO.

mod lanes;

use super::Kind;
use crate::reader::Reader;
use crate::{Activation, MAX_WEIGHTS, OutputRange, SpecificationError};
use serde::Serialize;

const MAX_ITERATIONS: usize = 1000;

/// A recurrent network in which every node is connected to every node, and whose weights learn in each step (FREVO's
/// HebbNet).
///
/// Nodes: sensors, then hidden, then actuators. Weights: the learning rate, then as those of a fully meshed network.
/// The outputs of all nodes and what the weights have become stay from step to step; a reset sets the outputs to 0 and
/// the weights to those of the specification.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Hebbian {
    /// Numbers in.
    pub sensors: usize,
    /// Numbers out.
    pub actuators: usize,
    /// Hidden nodes.
    pub hidden: usize,
    /// Updates of all nodes in a step; learning follows the last one.
    pub iterations: u32,
}

impl Hebbian {
    /// All nodes except sensors.
    fn active(&self) -> usize {
        self.hidden + self.actuators
    }

    /// All nodes, sensors included.
    fn nodes(&self) -> usize {
        self.sensors + self.active()
    }

    /// Weights that learn, or would: those of a node to itself, which are among them, stay as they are.
    fn links(&self) -> usize {
        self.active() * self.nodes()
    }

    /// How many weights learn, as binary32: exact, since there are less than 2^24.
    fn learning(&self) -> f32 {
        (self.active() * (self.nodes() - 1)) as f32
    }
}

/// Half of what a weight learns between nodes with these outputs: the other output less 0.5 is the other factor.
#[inline(always)]
fn half_delta(rate: f32, output: f32) -> f64 {
    f64::from(rate) * (f64::from(output) - 0.5)
}

/// What a weight learns, before the mean is subtracted.
#[inline(always)]
fn delta(half: f64, source: f32) -> f32 {
    (half * (f64::from(source) - 0.5)) as f32
}

impl Kind for Hebbian {
    const SIZE: (&'static str, &'static str) = ("hidden", "use a smaller network");

    fn read(reader: &mut Reader<'_>) -> Result<Self, SpecificationError> {
        Ok(Self {
            sensors: reader.count("sensors", 1, MAX_WEIGHTS)?,
            actuators: reader.count("actuators", 1, MAX_WEIGHTS)?,
            hidden: reader.count("hidden", 0, MAX_WEIGHTS)?,
            iterations: u32::try_from(reader.count("iterations", 1, MAX_ITERATIONS)?)
                .unwrap_or(u32::MAX),
        })
    }

    fn weight_count(&self) -> Option<usize> {
        let active = self.hidden.checked_add(self.actuators)?;
        let row = active.checked_add(self.sensors)?.checked_add(1)?;
        active.checked_mul(row)?.checked_add(1)
    }

    fn sensors(&self) -> usize {
        self.sensors
    }

    fn actuators(&self) -> usize {
        self.actuators
    }

    /// Whether the weights that follow are there yet, the outputs of all nodes, the weights that learn.
    fn state_length(&self) -> usize {
        1 + self.nodes() + self.links()
    }

    /// Outputs of the next iteration, or what the weights learn.
    fn scratch_length(&self) -> usize {
        self.links()
    }

    #[inline]
    fn step(
        &self,
        weights: &[f32],
        state: &mut [f32],
        scratch: &mut [f32],
        sensors: &[f32],
        actuators: &mut [f32],
    ) {
        let nodes = self.nodes();
        let (rate, genes) = (weights[0], &weights[1..]);
        let (begun, rest) = state.split_at_mut(1);
        let (outputs, links) = rest.split_at_mut(nodes);
        if begun[0] == 0.0 {
            begun[0] = 1.0;
            for (row, genes) in links
                .chunks_exact_mut(nodes)
                .zip(genes.chunks_exact(nodes + 1))
            {
                row.copy_from_slice(&genes[1..]);
            }
        }
        outputs[..self.sensors].copy_from_slice(sensors);
        for _ in 0..self.iterations {
            // All nodes are updated at once, from the outputs of the iteration before.
            let rows = links.chunks_exact(nodes).zip(genes.chunks_exact(nodes + 1));
            for (next, (row, genes)) in scratch.iter_mut().zip(rows) {
                let mut sum = 0.0_f32;
                for (weight, output) in row.iter().zip(outputs.iter()) {
                    sum += weight * output;
                }
                *next = Activation::Clamp.apply(genes[0] + sum);
            }
            outputs[self.sensors..].copy_from_slice(&scratch[..self.active()]);
        }
        self.learn(rate, outputs, links, scratch);
        for (actuator, output) in actuators
            .iter_mut()
            .zip(&outputs[self.sensors + self.hidden..])
        {
            *actuator = OutputRange::UNIT.actuator(*output);
        }
    }
}

impl Hebbian {
    /// Changes all weights but those of a node to itself, by numbers whose mean is 0.
    #[inline]
    fn learn(&self, rate: f32, outputs: &[f32], links: &mut [f32], deltas: &mut [f32]) {
        let nodes = self.nodes();
        let mut sum = 0.0_f32;
        for (node, row) in deltas.chunks_exact_mut(nodes).enumerate() {
            let half = half_delta(rate, outputs[self.sensors + node]);
            for (source, to) in row.iter_mut().enumerate() {
                *to = delta(half, outputs[source]);
                if source != self.sensors + node {
                    sum += *to;
                }
            }
        }
        let mean = sum / self.learning();
        let rows = links
            .chunks_exact_mut(nodes)
            .zip(deltas.chunks_exact(nodes));
        for (node, (row, deltas)) in rows.enumerate() {
            for (source, (weight, delta)) in row.iter_mut().zip(deltas).enumerate() {
                if source != self.sensors + node {
                    *weight += delta - mean;
                }
            }
        }
    }
}
