//! Genomes of networks that grow, decoded and encoded.

use std::cmp::Reverse;
use std::collections::BinaryHeap;

use super::GrowingNetwork;

/// Numbers of a gene of a hidden node: the historical marking, the activation, the number of inputs.
const OF_NODE: usize = 3;
/// Numbers of a gene of a connection: source, weight, whether it is enabled.
const OF_CONNECTION: usize = 3;
/// Markings are whole numbers from 1 that binary32 holds exactly.
const MARKINGS: u32 = 1 << 24;

/// A hidden node.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Node {
    pub marking: u32,
    pub activation: usize,
}

/// A connection between nodes, by their numbers: sensors, bias, actuators, hidden nodes.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Connection {
    pub source: usize,
    pub target: usize,
    pub weight: f32,
    pub enabled: bool,
}

/// A decoded genome.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Network {
    pub(super) hidden: Vec<Node>,
    pub(super) connections: Vec<Connection>,
}

impl Network {
    /// Number of connections, disabled ones included.
    pub(crate) fn connections(&self) -> usize {
        self.connections.len()
    }
}

/// The whole part of a gene, limited to 0..=highest.
#[expect(
    clippy::cast_possible_truncation,
    clippy::cast_sign_loss,
    reason = "`as` rounds towards 0, and limits"
)]
fn limited(gene: f32, highest: usize) -> usize {
    (gene as usize).min(highest)
}

#[expect(
    clippy::cast_precision_loss,
    reason = "counts and markings are below 2^24"
)]
fn gene(number: usize) -> f32 {
    number as f32
}

impl GrowingNetwork {
    /// Number of genes.
    #[must_use]
    pub fn genes(&self) -> usize {
        1 + self.actuators + OF_NODE * self.nodes + OF_CONNECTION * self.connections
    }

    /// Number of the first actuator: sensors and the bias come before.
    pub(super) fn first_actuator(&self) -> usize {
        self.sensors + 1
    }

    /// Number of the first hidden node.
    pub(super) fn first_hidden(&self) -> usize {
        self.first_actuator() + self.actuators
    }

    /// Where a node that is not an input stands in the order of computation.
    pub(super) fn rank(&self, network: &Network, node: usize) -> usize {
        match node.checked_sub(self.first_hidden()) {
            Some(hidden) => hidden,
            None => network.hidden.len() + node - self.first_actuator(),
        }
    }

    /// Whether a network of this form may have the connection, cycles aside.
    pub(super) fn is_possible(&self, source: usize) -> bool {
        self.recurrent || !(self.first_actuator()..self.first_hidden()).contains(&source)
    }

    /// The network that a genome stands for. Connections that operators never make are left out: a second one between
    /// the same nodes, and in a feed-forward network one from an actuator or from a node that is computed later.
    pub(crate) fn decode(&self, genome: &[f32]) -> Network {
        let count = limited(genome[0], self.nodes);
        let (inputs, rest) = genome[1..].split_at(self.actuators);
        let (nodes, mut connections) = rest.split_at(OF_NODE * self.nodes);
        let nodes = nodes.chunks_exact(OF_NODE).take(count);
        let last = self.first_hidden() + count - 1;
        // The last target that each source was connected with.
        let mut targets = vec![None; last + 1];
        let mut network = Network {
            hidden: Vec::with_capacity(count),
            connections: Vec::with_capacity(self.connections),
        };
        let hidden = nodes.clone().enumerate();
        let hidden = hidden.map(|(index, node)| (self.first_hidden() + index, node[2]));
        let actuators = inputs.iter().enumerate();
        let actuators = actuators.map(|(index, inputs)| (self.first_actuator() + index, *inputs));
        for (target, inputs) in hidden.chain(actuators) {
            let inputs = limited(inputs, connections.len() / OF_CONNECTION);
            let (own, others) = connections.split_at(OF_CONNECTION * inputs);
            connections = others;
            for numbers in own.chunks_exact(OF_CONNECTION) {
                let source = limited(numbers[0], last);
                let is_new = targets[source] != Some(target);
                let later = !self.recurrent
                    && source >= self.first_hidden()
                    && target >= self.first_hidden()
                    && source >= target;
                if is_new && !later && self.is_possible(source) {
                    targets[source] = Some(target);
                    network.connections.push(Connection {
                        source,
                        target,
                        weight: numbers[1],
                        enabled: limited(numbers[2], 1) == 1,
                    });
                }
            }
        }
        network.hidden.extend(nodes.map(|node| Node {
            marking: u32::try_from(limited(node[0], MARKINGS as usize - 1)).unwrap_or_default(),
            activation: limited(node[1], self.last_activation),
        }));
        network
    }

    /// Writes a network as a genome; genes that it does not need are 0.
    pub(crate) fn encode(&self, network: &Network, genome: &mut [f32]) {
        let mut order: Vec<&Connection> = network.connections.iter().collect();
        order.sort_by_key(|connection| self.rank(network, connection.target));
        genome.fill(0.0);
        genome[0] = gene(network.hidden.len());
        let (inputs, rest) = genome[1..].split_at_mut(self.actuators);
        let (nodes, connections) = rest.split_at_mut(OF_NODE * self.nodes);
        for (slot, node) in nodes.chunks_exact_mut(OF_NODE).zip(&network.hidden) {
            slot[0] = gene(node.marking as usize);
            slot[1] = gene(node.activation);
        }
        for (slot, connection) in connections.chunks_exact_mut(OF_CONNECTION).zip(order) {
            slot[0] = gene(connection.source);
            slot[1] = connection.weight;
            slot[2] = gene(usize::from(connection.enabled));
            match connection.target.checked_sub(self.first_hidden()) {
                Some(hidden) => nodes[OF_NODE * hidden + 2] += 1.0,
                None => inputs[connection.target - self.first_actuator()] += 1.0,
            }
        }
    }

    /// What a node is recognised by in other genomes: its number, or the marking of a hidden one.
    pub(super) fn identity(&self, network: &Network, node: usize) -> u64 {
        let first = self.first_hidden();
        let marking = |hidden: usize| first as u64 + u64::from(network.hidden[hidden].marking);
        node.checked_sub(first).map_or(node as u64, marking)
    }

    /// What a connection is recognised by in other genomes: the identities of its nodes.
    pub(super) fn key(&self, network: &Network, connection: &Connection) -> u64 {
        let source = self.identity(network, connection.source);
        source << 32 | self.identity(network, connection.target)
    }

    /// The marking of the node that splits a connection: a hash of the connection, so that the same innovation has the same marking
    /// in every genome, generation and process. Where the network has such a node already, that of the next one.
    pub(super) fn marking(&self, network: &Network, key: u64) -> u32 {
        let mut state = key;
        loop {
            state = state.wrapping_add(0x9E37_79B9_7F4A_7C15);
            // The finalizer of SplitMix64.
            let mut word = (state ^ (state >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
            word = (word ^ (word >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
            let marking = u32::try_from((word ^ (word >> 31)) >> 40).unwrap_or_default();
            let is_taken = network.hidden.iter().any(|node| node.marking == marking);
            if marking > 0 && !is_taken {
                return marking;
            }
        }
    }

    /// Whether all inputs of every hidden node are computed before it, as feed-forward networks need it: sorts them so, each as far
    /// ahead as it was, unless there is a cycle.
    pub(super) fn sort(&self, network: &mut Network) -> bool {
        let first = self.first_hidden();
        let count = network.hidden.len();
        let mut missing = vec![0_usize; count];
        let mut targets = vec![Vec::new(); count];
        for connection in &network.connections {
            if let (Some(source), Some(target)) = (
                connection.source.checked_sub(first),
                connection.target.checked_sub(first),
            ) {
                missing[target] += 1;
                targets[source].push(target);
            }
        }
        let mut order = Vec::with_capacity(count);
        let ready = (0..count).filter(|node| missing[*node] == 0);
        let mut ready: BinaryHeap<Reverse<usize>> = ready.map(Reverse).collect();
        while let Some(Reverse(next)) = ready.pop() {
            order.push(next);
            for target in &targets[next] {
                missing[*target] -= 1;
                if missing[*target] == 0 {
                    ready.push(Reverse(*target));
                }
            }
        }
        if order.len() < count {
            return false;
        }
        let mut position = vec![0; count];
        for (index, node) in order.iter().enumerate() {
            position[*node] = first + index;
        }
        network.hidden = order.iter().map(|node| network.hidden[*node]).collect();
        for connection in &mut network.connections {
            for end in [&mut connection.source, &mut connection.target] {
                if let Some(hidden) = end.checked_sub(first) {
                    *end = position[hidden];
                }
            }
        }
        true
    }
}
