//! Activation functions of network nodes.

use crate::functions::{sigmoid, tanh};
use serde::{Deserialize, Serialize};

/// What a node does to the sum of its inputs. A NaN passes through every one of them.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Activation {
    /// Hyperbolic tangent, -1..=1.
    Tanh,
    /// Logistic function, 0..=1.
    Sigmoid,
    /// 0 below 0, else the sum itself.
    Relu,
    /// The sum limited to 0..=1; FREVO calls it LINEAR.
    Clamp,
    /// The sum itself.
    Linear,
}

impl Activation {
    /// Every activation, in the order of the documentation.
    pub const ALL: [Self; 5] = [
        Self::Tanh,
        Self::Sigmoid,
        Self::Relu,
        Self::Clamp,
        Self::Linear,
    ];

    /// The name in a specification.
    pub fn name(self) -> &'static str {
        match self {
            Self::Tanh => "tanh",
            Self::Sigmoid => "sigmoid",
            Self::Relu => "relu",
            Self::Clamp => "clamp",
            Self::Linear => "linear",
        }
    }

    /// The node's output for the sum `a`.
    #[inline]
    pub fn apply(self, a: f32) -> f32 {
        match self {
            Self::Tanh => tanh(a),
            Self::Sigmoid => sigmoid(a),
            Self::Relu => {
                if a < 0.0 {
                    0.0
                } else {
                    a
                }
            }
            Self::Clamp => {
                let b = if a < 0.0 { 0.0 } else { a };
                if b > 1.0 { 1.0 } else { b }
            }
            Self::Linear => a,
        }
    }
}
