//! Networks that grow as functions of space: compositional pattern-producing networks (K. O. Stanley, Genetic Programming and
//! Evolvable Machines 8(2), 2007).

use swarmwright_controllers::functions::{sigmoid, sin_pi, tanh};

use super::GrowingNetwork;

/// What a node of such a network does to its sum, in binary32.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum PatternFunction {
    /// e^(-a^2), 0..=1.
    Gaussian,
    /// sin(pi a), -1..=1.
    Sine,
    /// Without its sign.
    Absolute,
    /// Hyperbolic tangent, -1..=1.
    Tanh,
    /// Logistic function, 0..=1.
    Sigmoid,
    /// The sum itself.
    Linear,
}

impl PatternFunction {
    /// Every function, in the order of their numbers in a genome.
    pub const ALL: [Self; 6] = [
        Self::Gaussian,
        Self::Sine,
        Self::Absolute,
        Self::Tanh,
        Self::Sigmoid,
        Self::Linear,
    ];

    /// The name in an experiment.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Gaussian => "gaussian",
            Self::Sine => "sine",
            Self::Absolute => "absolute",
            Self::Tanh => "tanh",
            Self::Sigmoid => "sigmoid",
            Self::Linear => "linear",
        }
    }

    /// The node's output for the sum `a`.
    #[must_use]
    pub fn apply(self, a: f32) -> f32 {
        match self {
            Self::Gaussian => rounded(libm::exp(-f64::from(a) * f64::from(a))),
            // Periods are exact: a - 2 n is representable where it matters, and 0 beyond.
            Self::Sine => sin_pi((a - 2.0 * (a / 2.0).round_ties_even()).clamp(-1.0, 1.0)),
            Self::Absolute => a.abs(),
            Self::Tanh => tanh(a),
            Self::Sigmoid => sigmoid(a),
            Self::Linear => a,
        }
    }
}

#[expect(clippy::cast_possible_truncation, reason = "rounding is meant")]
fn rounded(value: f64) -> f32 {
    value as f32
}

/// A node: its function, and where its inputs come from, with their weights.
struct Painter {
    function: PatternFunction,
    inputs: Vec<(usize, f32)>,
}

impl GrowingNetwork {
    /// The outputs of a feed-forward network at points in space, (points, actuators), each -1..=1: the hyperbolic tangent of the sum of
    /// an actuator's node, 0 if that is not a number.
    ///
    /// `points`: rows of coordinates, the sensors. Sums are in binary32, in the order of the connections.
    ///
    /// # Panics
    ///
    /// When the network is recurrent, or the lengths do not fit.
    pub fn pattern(&self, genome: &[f32], points: &[f32], outputs: &mut [f32]) {
        assert!(!self.recurrent && genome.len() == self.genes());
        let rows = points.chunks_exact(self.sensors);
        assert_eq!(rows.len() * self.actuators, outputs.len());
        let nodes = self.painters(genome);
        let first = self.sensors + 1;
        let mut values = vec![0.0_f32; first + nodes.len()];
        values[self.sensors] = 1.0;
        for (row, painted) in rows.zip(outputs.chunks_exact_mut(self.actuators)) {
            values[..self.sensors].copy_from_slice(row);
            for (rank, node) in nodes.iter().enumerate() {
                let mut sum = 0.0;
                for (source, weight) in &node.inputs {
                    sum += weight * values[*source];
                }
                values[first + rank] = node.function.apply(sum);
            }
            let ends = &values[first + nodes.len() - self.actuators..];
            for (output, value) in painted.iter_mut().zip(ends) {
                *output = if value.is_nan() { 0.0 } else { *value };
            }
        }
    }

    /// The nodes in the order of computation, actuators last, with enabled connections alone.
    fn painters(&self, genome: &[f32]) -> Vec<Painter> {
        let network = self.decode(genome);
        let functions = network.hidden.iter().map(|node| node.activation);
        let functions = functions.map(|number| PatternFunction::ALL[number.min(5)]);
        let actuators = std::iter::repeat_n(PatternFunction::Tanh, self.actuators);
        let mut painters: Vec<Painter> = functions
            .chain(actuators)
            .map(|function| Painter {
                function,
                inputs: Vec::new(),
            })
            .collect();
        for connection in network
            .connections
            .iter()
            .filter(|connection| connection.enabled)
        {
            let source = if connection.source < self.first_actuator() {
                connection.source
            } else {
                self.first_actuator() + self.rank(&network, connection.source)
            };
            let target = self.rank(&network, connection.target);
            painters[target].inputs.push((source, connection.weight));
        }
        painters
    }
}
