//! Networks that grow, as NEAT evolves them: the weights are the genes of nodes and connections.

mod lanes;

use super::Kind;
use super::evostick::STEEPNESS;
use crate::functions::sigmoid;
use crate::reader::{Reader, wrong};
use crate::{Activation, MAX_WEIGHTS, OutputRange, SpecificationError};
use serde::{Serialize, Serializer};

/// Numbers of a gene of a hidden node: the historical marking, the activation, the number of inputs.
const OF_NODE: usize = 3;
/// Numbers of a gene of a connection: source, weight, whether it is enabled.
const OF_CONNECTION: usize = 3;

/// The activation of a node: NEAT's steepened sigmoid, or one of the other networks.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum NodeActivation {
    /// sigmoid(4.924273 a), 0..=1.
    SteepSigmoid,
    /// See [`Activation`].
    Other(Activation),
}

impl NodeActivation {
    /// Every activation, in the order of their numbers in a genome.
    pub const ALL: [Self; 6] = [
        Self::SteepSigmoid,
        Self::Other(Activation::Tanh),
        Self::Other(Activation::Sigmoid),
        Self::Other(Activation::Relu),
        Self::Other(Activation::Clamp),
        Self::Other(Activation::Linear),
    ];

    /// The name in a specification.
    pub fn name(self) -> &'static str {
        match self {
            Self::SteepSigmoid => "steep_sigmoid",
            Self::Other(activation) => activation.name(),
        }
    }

    #[inline]
    fn apply(self, sum: f32) -> f32 {
        match self {
            Self::SteepSigmoid => sigmoid(STEEPNESS * sum),
            Self::Other(activation) => activation.apply(sum),
        }
    }
}

impl Serialize for NodeActivation {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        self.name().serialize(serializer)
    }
}

/// A network with room to grow (K. O. Stanley and R. Miikkulainen, "Evolving neural networks through augmenting topologies",
/// Evolutionary Computation 10, 2002).
///
/// Nodes: sensors, the bias, whose output is 1, actuators, then hidden nodes. Weights: the number of hidden nodes; for each actuator the
/// number of its inputs; for each of `nodes` hidden nodes its historical marking, which is not used here, its activation and
/// the number of its inputs; for each of `connections` connections its source, its weight, and whether it is enabled. Connections
/// are in the order of the nodes that they lead to, the hidden ones first. Of all but weights the whole part counts, limited to
/// what is possible, so that any weights are a network.
///
/// A feed-forward network computes hidden nodes in their order, then actuators; a recurrent one computes all nodes at
/// once, from the outputs of the step before.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Growing {
    /// Numbers in.
    pub sensors: usize,
    /// Numbers out.
    pub actuators: usize,
    /// Most hidden nodes.
    pub nodes: usize,
    /// Most connections.
    pub connections: usize,
    /// Whether nodes take outputs of the step before.
    pub recurrent: bool,
    /// What actuators do to their sums.
    pub output_activation: NodeActivation,
    /// Outputs that become actuators -1 to 1.
    pub output_range: OutputRange,
}

/// What a step reads and writes, of one controller or of one lane.
trait Cells {
    fn sensor(&self, index: usize) -> f32;
    /// The output of a node, which stays until it is computed again.
    fn output(&self, index: usize) -> f32;
    fn set_output(&mut self, index: usize, value: f32);
}

impl Growing {
    /// Nodes that are computed.
    fn computed(&self) -> usize {
        self.actuators + self.nodes
    }

    /// Computes all nodes. Outputs are those of actuators and hidden nodes, which in a recurrent network are followed by those of
    /// this step.
    #[inline(always)]
    fn update(&self, weights: &[f32], cells: &mut impl Cells) {
        let Self {
            sensors, actuators, ..
        } = *self;
        let hidden = limited(weights[0], self.nodes);
        let (inputs, rest) = weights[1..].split_at(actuators);
        let (nodes, mut connections) = rest.split_at(OF_NODE * self.nodes);
        let first = if self.recurrent { self.computed() } else { 0 };
        if !self.recurrent {
            for index in 0..actuators + hidden {
                cells.set_output(index, 0.0);
            }
        }
        let last = sensors + actuators + hidden;
        let mut node = |index: usize, inputs: f32, activation: NodeActivation| {
            let count = limited(inputs, connections.len() / OF_CONNECTION);
            let (own, others) = connections.split_at(OF_CONNECTION * count);
            connections = others;
            let mut sum = 0.0;
            for connection in own.chunks_exact(OF_CONNECTION) {
                if limited(connection[2], 1) == 1 {
                    let source = limited(connection[0], last);
                    let input = match source.checked_sub(sensors) {
                        None => cells.sensor(source),
                        Some(0) => 1.0,
                        Some(at) => cells.output(at - 1),
                    };
                    sum += connection[1] * input;
                }
            }
            cells.set_output(first + index, activation.apply(sum));
        };
        for (index, gene) in nodes.chunks_exact(OF_NODE).take(hidden).enumerate() {
            let activation = limited(gene[1], NodeActivation::ALL.len() - 1);
            node(actuators + index, gene[2], NodeActivation::ALL[activation]);
        }
        for (index, inputs) in inputs.iter().enumerate() {
            node(index, *inputs, self.output_activation);
        }
        if self.recurrent {
            for index in 0..actuators + hidden {
                cells.set_output(index, cells.output(first + index));
            }
        }
    }
}

/// The whole part of a number, limited to 0..=highest.
#[inline]
fn limited(number: f32, highest: usize) -> usize {
    // `as` rounds towards 0, and limits.
    (number as usize).min(highest)
}

/// One controller: its sensors, and its outputs.
struct Single<'a>(&'a [f32], &'a mut [f32]);

impl Cells for Single<'_> {
    #[inline]
    fn sensor(&self, index: usize) -> f32 {
        self.0[index]
    }

    #[inline]
    fn output(&self, index: usize) -> f32 {
        self.1[index]
    }

    #[inline]
    fn set_output(&mut self, index: usize, value: f32) {
        self.1[index] = value;
    }
}

impl Kind for Growing {
    const SIZE: (&'static str, &'static str) = ("connections", "use a smaller network");

    fn read(reader: &mut Reader<'_>) -> Result<Self, SpecificationError> {
        Ok(Self {
            sensors: reader.count("sensors", 1, MAX_WEIGHTS)?,
            actuators: reader.count("actuators", 1, MAX_WEIGHTS)?,
            nodes: reader.count("nodes", 0, MAX_WEIGHTS)?,
            connections: reader.count("connections", 1, MAX_WEIGHTS)?,
            recurrent: reader.read("recurrent", "true or false")?,
            output_activation: activation(reader)?,
            output_range: reader.output_range()?,
        })
    }

    fn weight_count(&self) -> Option<usize> {
        Some(1 + self.actuators + OF_NODE * self.nodes + OF_CONNECTION * self.connections)
    }

    fn sensors(&self) -> usize {
        self.sensors
    }

    fn actuators(&self) -> usize {
        self.actuators
    }

    /// The outputs of actuators and hidden nodes; twice if all are computed from those of the step before.
    fn state_length(&self) -> usize {
        self.computed() * (1 + usize::from(self.recurrent))
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
        self.update(weights, &mut Single(sensors, state));
        for (actuator, output) in actuators.iter_mut().zip(&*state) {
            *actuator = self.output_range.actuator(*output);
        }
    }
}

fn activation(reader: &mut Reader<'_>) -> Result<NodeActivation, SpecificationError> {
    let names = NodeActivation::ALL.map(NodeActivation::name);
    let expected = format!("one of {}", names.join(", "));
    let text = reader.text("output_activation", &expected)?;
    let activation = NodeActivation::ALL.into_iter().find(|a| a.name() == text);
    activation.ok_or_else(|| {
        wrong(
            "output_activation",
            format!("{text:?} found, expected {expected}"),
        )
    })
}
