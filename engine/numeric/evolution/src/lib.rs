//! Random numbers by counter, the genetic operators of networks, who survives and who mates, and the samples of evolution strategies.
//!
//! Everything is made of exact integer operations and single IEEE 754 binary64 operations in a written-down order, so
//! the same address gives the same genome on every machine (docs/decisions/002-arithmetic.md).
//!
//! ```
//! use swarmwright_evolution::{Mutation, NodeNetwork, Stream, purpose_key};
//!
//! let network = NodeNetwork::new(&[4, 4, 2], 2.0, 2.0, Mutation::Uniform);
//! let mut parent = vec![0.0; network.genes()];
//! network.initial(&mut Stream::new(1, purpose_key("initial"), 0, 0), &mut parent);
//! let mut child = vec![0.0; network.genes()];
//! network.mutate(&parent, &mut Stream::new(1, purpose_key("mutate"), 0, 0), 0.3, 1.0, &mut child);
//! assert_ne!(child, parent);
//! ```

mod cma;
mod differential;
mod distance;
mod distinct;
mod eigen;
mod exact;
mod growing;
mod linear;
mod matrix;
mod network;
mod normal;
mod philox;
mod polynomial;
mod ranking;
mod sample;
mod sampling;
mod search;
mod shaping;
mod stream;
mod swarm;
mod torus;

pub use cma::{Cma, Start, Stop};
pub use differential::{Base, Crossover, Differential};
pub use distance::{Farthest, distance, distances};
pub use distinct::distinct;
pub use eigen::{Eigen, eigen};
pub use exact::{Aggregate, Figures, Outcome, exact_sum};
pub use growing::{Compatibility, GrowingNetwork, PatternFunction, WeightMutation};
/// Exponential function and natural logarithm in plain arithmetic, because those of C libraries differ.
pub use libm::{exp, log};
pub use matrix::{exponential, product};
pub use network::{Mutation, NodeNetwork};
pub use philox::philox;
pub use ranking::{Ranks, survivors, triangular};
pub use sample::GaussianSample;
pub use sampling::{Scale, add_weighted, add_weighted_products, add_weighted_squares, samples};
pub use search::{
    Bounded, Challenger, CmaSearch, CmaSettings, Evostick, EvostickSettings, Gaussian, Genetic,
    GeneticSettings, Learning, Members, Neat, NeatSettings, Nes, NesSettings, Operators, Restart,
    Restarts, Search, Shape, Space, Starts, SwarmSettings, Swarming, Unavailable, Variation,
};
pub use shaping::{centered_ranks, utilities};
pub use stream::{Stream, normal_rows, purpose_key, rows};
pub use swarm::{Flight, Swarm, spread};
pub use torus::{Torus, Way, Ways};
