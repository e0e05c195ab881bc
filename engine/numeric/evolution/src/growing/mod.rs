//! The genetic operators of networks that grow, after NEAT (K. O. Stanley and R. Miikkulainen, "Evolving neural networks through
//! augmenting topologies", Evolutionary Computation 10, 2002).

mod genome;
mod pattern;

use crate::stream::Stream;
use genome::{Connection, Node};

pub(crate) use genome::Network;
pub use pattern::PatternFunction;

/// Connections that a mutation tries to add before it gives up.
const TRIALS: usize = 20;
/// Probability that a connection which one of two parents has disabled stays disabled.
const STAYS_DISABLED: f64 = 0.75;
/// Genomes with fewer connections are small: these are compared as they are, larger ones relative to their size.
const SMALL: usize = 20;
/// Probability that a small network splits a connection without hidden nodes, if it has one.
const PREFERS_OLD: f64 = 0.7;
/// How many times as large as an initial weight one becomes at most.
const MOST_RANGES: f64 = 8.0;
/// Share of the mutated weights that are drawn anew.
const ANEW: f64 = 0.1;

/// Networks with room to grow: a genome has genes for as many nodes and connections as there may be, see `Growing` of the crate
/// of controllers.
#[derive(Debug, Clone, PartialEq)]
pub struct GrowingNetwork {
    /// Numbers in, at least 1.
    pub sensors: usize,
    /// Numbers out, at least 1.
    pub actuators: usize,
    /// Most hidden nodes.
    pub nodes: usize,
    /// Most connections, at least those between all sensors, the bias, and all actuators.
    pub connections: usize,
    /// Whether connections may lead anywhere.
    pub recurrent: bool,
    /// Activations of hidden nodes, by their numbers; new nodes draw one of them. At least one.
    pub activations: Vec<usize>,
    /// The highest number of an activation.
    pub last_activation: usize,
    /// Weights start within +-range.
    pub weight_range: f64,
    /// Probability that a mutation splits a connection by a new node.
    pub add_node: f64,
    /// Probability that it adds a connection.
    pub add_connection: f64,
    /// Probability that it enables or disables a connection.
    pub toggle: f64,
}

/// Probabilities and size of changes of weights.
#[derive(Debug, Clone, Copy)]
pub struct WeightMutation {
    /// Probability that a mutation changes weights.
    pub genomes: f64,
    /// Probability that it changes each of them.
    pub each: f64,
    /// Largest change, in units of the range.
    pub severity: f64,
}

/// Coefficients of the compatibility distance.
#[derive(Debug, Clone, Copy)]
pub struct Compatibility {
    /// Coefficient of the connections that only one of the genomes has.
    pub disjoint: f64,
    /// Coefficient of the mean difference of weights of matching connections.
    pub weights: f64,
}

/// The connections of a genome in the order of their identities, with their weights.
pub(crate) type Aligned = Vec<(u64, f32)>;

impl GrowingNetwork {
    /// A network in which every sensor and the bias are connected with every actuator.
    pub fn initial(&self, stream: &mut Stream, genome: &mut [f32]) {
        let mut network = Network {
            hidden: Vec::new(),
            connections: Vec::new(),
        };
        for target in self.first_actuator()..self.first_hidden() {
            for source in 0..=self.sensors {
                network.connections.push(Connection {
                    source,
                    target,
                    weight: rounded(stream.uniform(self.weight_range)),
                    enabled: true,
                });
            }
        }
        self.encode(&network, genome);
    }

    /// Adds a node, adds a connection, toggles one, and changes weights, each with its probability.
    pub(crate) fn mutate(
        &self,
        network: &mut Network,
        stream: &mut Stream,
        weights: WeightMutation,
    ) {
        // Each has its own word, whatever comes of it.
        let [node, connection, toggle, weight] = std::array::from_fn(|_| stream.unit());
        if node < self.add_node {
            self.split_connection(network, stream);
        }
        if connection < self.add_connection {
            self.add_connection(network, stream);
        }
        if toggle < self.toggle {
            let chosen = index(stream, network.connections.len().max(1));
            if let Some(connection) = network.connections.get_mut(chosen) {
                connection.enabled = !connection.enabled;
            }
        }
        if weight < weights.genomes {
            self.mutate_weights(network, stream, weights);
        }
    }

    /// Moves weights from where they are, or from 0.
    fn mutate_weights(&self, network: &mut Network, stream: &mut Stream, how: WeightMutation) {
        for connection in &mut network.connections {
            let [chosen, anew] = std::array::from_fn(|_| stream.unit());
            let change = stream.uniform(how.severity * self.weight_range);
            if chosen < how.each {
                let before = if anew < ANEW {
                    0.0
                } else {
                    f64::from(connection.weight)
                };
                let limit = MOST_RANGES * self.weight_range;
                connection.weight = rounded((before + change).clamp(-limit, limit));
            }
        }
    }

    /// Splits an enabled connection, but for one from the bias: a new node takes its input with the weight 1, and gives its output with
    /// the weight of the connection, which is disabled.
    fn split_connection(&self, network: &mut Network, stream: &mut Stream) {
        if network.hidden.len() == self.nodes || network.connections.len() + 2 > self.connections {
            return;
        }
        let connections = network.connections.iter().enumerate();
        let mut candidates: Vec<usize> = connections
            .filter(|(_, connection)| connection.enabled && connection.source != self.sensors)
            .map(|(index, _)| index)
            .collect();
        if candidates.is_empty() {
            return;
        }
        // As in the paper's code, networks with few connections mostly split the oldest, lest new nodes follow on each other.
        if network.connections.len() < SMALL && stream.unit() < PREFERS_OLD {
            let first = self.first_hidden();
            let is_old = |connection: &Connection| connection.source.max(connection.target) < first;
            if candidates
                .iter()
                .any(|index| is_old(&network.connections[*index]))
            {
                candidates.retain(|index| is_old(&network.connections[*index]));
            }
        }
        let chosen = candidates[index(stream, candidates.len())];
        let activation = self.activations[index(stream, self.activations.len())];
        let key = self.key(network, &network.connections[chosen]);
        let marking = self.marking(network, key);
        network.connections[chosen].enabled = false;
        // Ahead of the node that it leads to, so that a feed-forward network stays in order.
        let first = self.first_hidden();
        let target = network.connections[chosen].target;
        let new = if target < first {
            first + network.hidden.len()
        } else {
            target
        };
        network.hidden.insert(
            new - first,
            Node {
                marking,
                activation,
            },
        );
        for connection in &mut network.connections {
            for end in [&mut connection.source, &mut connection.target] {
                *end += usize::from(*end >= new);
            }
        }
        let split = network.connections[chosen];
        network.connections.push(Connection {
            target: new,
            weight: 1.0,
            enabled: true,
            ..split
        });
        network.connections.push(Connection {
            source: new,
            enabled: true,
            ..split
        });
    }

    /// Connects two nodes that are not connected yet.
    fn add_connection(&self, network: &mut Network, stream: &mut Stream) {
        if network.connections.len() == self.connections {
            return;
        }
        let last = self.first_hidden() + network.hidden.len();
        for _ in 0..TRIALS {
            let source = index(stream, last);
            let target = self.first_actuator() + index(stream, last - self.first_actuator());
            let weight = rounded(stream.uniform(self.weight_range));
            let mut others = network.connections.iter();
            let is_new = others.all(|other| (other.source, other.target) != (source, target));
            if !is_new || !self.is_possible(source) {
                continue;
            }
            network.connections.push(Connection {
                source,
                target,
                weight,
                enabled: true,
            });
            if self.recurrent || self.sort(network) {
                return;
            }
            network.connections.pop();
        }
    }

    /// The first parent with weights, and disabled connections, of the second one. It has the genes that only one of them has,
    /// so it should be the fitter one.
    pub(crate) fn cross(&self, fitter: &Network, other: &Network, stream: &mut Stream) -> Network {
        let mut genes: Vec<(u64, usize)> = (0..)
            .zip(&other.connections)
            .map(|(index, connection)| (self.key(other, connection), index))
            .collect();
        genes.sort_unstable();
        let mut child = fitter.clone();
        for connection in &mut child.connections {
            let key = self.key(fitter, connection);
            if let Ok(matching) = genes.binary_search_by_key(&key, |gene| gene.0) {
                let partner = other.connections[genes[matching].1];
                let [side, disabled] = std::array::from_fn(|_| stream.unit());
                if side < 0.5 {
                    connection.weight = partner.weight;
                }
                let both = connection.enabled && partner.enabled;
                connection.enabled = both || disabled >= STAYS_DISABLED;
            }
        }
        child
    }

    /// What [`difference`] compares.
    pub(crate) fn aligned(&self, network: &Network) -> Aligned {
        let connections = network.connections.iter();
        let mut aligned: Aligned = connections
            .map(|connection| (self.key(network, connection), connection.weight))
            .collect();
        aligned.sort_unstable_by_key(|gene| gene.0);
        aligned
    }

    /// How different two genomes are.
    #[must_use]
    pub fn distance(&self, genome: &[f32], other: &[f32], by: Compatibility) -> f64 {
        let [first, second] = [genome, other].map(|genome| self.aligned(&self.decode(genome)));
        difference(&first, &second, by)
    }

    /// A mutated copy of a genome.
    pub fn mutated(
        &self,
        parent: &[f32],
        stream: &mut Stream,
        weights: WeightMutation,
        child: &mut [f32],
    ) {
        if weights.each <= 0.0 {
            return child.copy_from_slice(parent); // nothing is to be changed
        }
        let mut network = self.decode(parent);
        self.mutate(&mut network, stream, weights);
        self.encode(&network, child);
    }

    /// The first parent with weights of the second one.
    pub fn crossover(
        &self,
        mother: &[f32],
        father: &[f32],
        stream: &mut Stream,
        child: &mut [f32],
    ) {
        let crossed = self.cross(&self.decode(mother), &self.decode(father), stream);
        self.encode(&crossed, child);
    }
}

/// The compatibility distance of two genomes.
#[expect(clippy::cast_precision_loss, reason = "counts are below 2^53")]
pub(crate) fn difference(first: &Aligned, second: &Aligned, by: Compatibility) -> f64 {
    let (mut rest, mut matching, mut sum) = (second.iter().peekable(), 0_usize, 0.0);
    for (key, weight) in first {
        while rest.next_if(|gene| gene.0 < *key).is_some() {}
        if let Some((_, other)) = rest.next_if(|gene| gene.0 == *key) {
            sum += (f64::from(*weight) - f64::from(*other)).abs();
            matching += 1;
        }
    }
    let disjoint = first.len() + second.len() - 2 * matching;
    let larger = first.len().max(second.len());
    let size = if larger < SMALL { 1 } else { larger };
    by.disjoint * disjoint as f64 / size as f64 + by.weights * sum / matching.max(1) as f64
}

#[expect(clippy::cast_possible_truncation, reason = "it is below a usize")]
pub(crate) fn index(stream: &mut Stream, below: usize) -> usize {
    stream.integer(below as u64) as usize
}

#[expect(clippy::cast_possible_truncation, reason = "rounding is meant")]
fn rounded(value: f64) -> f32 {
    value as f32
}

impl Compatibility {
    /// As Stanley and Miikkulainen compare genomes.
    pub const PAPER: Self = Self {
        disjoint: 1.0,
        weights: 0.4,
    };
}
