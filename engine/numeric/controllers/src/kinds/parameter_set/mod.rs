//! Named parameters of a simulation that steers its agents itself.

mod read;

use super::Kind;
use crate::SpecificationError;
use crate::reader::Reader;
use serde::Serialize;
use serde_json::{Map, Value};

/// Values sent to the simulation before an episode, besides its other parameters; they do not steer agents.
///
/// Weights: one for each parameter, in their order.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct ParameterSet {
    /// What the weights are.
    pub parameters: Vec<Parameter>,
}

/// A parameter of the simulation.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Parameter {
    /// The name in a parameters message.
    pub name: String,
    /// What its weight means.
    #[serde(flatten)]
    pub kind: ParameterKind,
}

/// What a weight means.
#[derive(Debug, Clone, PartialEq, Serialize)]
#[serde(tag = "type", rename_all = "snake_case")]
pub enum ParameterKind {
    /// A number: the shortest decimal that reads back as the weight.
    Real,
    /// The whole part of the weight, rounded down.
    Integer,
    /// The choice of that index: the whole part of the weight, limited to those that there are.
    Categorical {
        /// Texts.
        choices: Vec<String>,
    },
}

impl ParameterKind {
    fn value(&self, weight: f32) -> Value {
        match self {
            // By way of its decimal, so that 0.1 is sent as 0.1 and not as 0.10000000149011612.
            Self::Real => {
                let decimal = weight.to_string().parse::<f64>();
                Value::from(decimal.unwrap_or(f64::from(weight)))
            }
            // Beyond 64 bits, where no sane parameter is, the conversion saturates.
            Self::Integer => Value::from(weight.floor() as i64),
            Self::Categorical { choices } => {
                let index = (weight.max(0.0) as usize).min(choices.len().saturating_sub(1));
                choices.get(index).cloned().map_or(Value::Null, Value::from)
            }
        }
    }
}

impl Kind for ParameterSet {
    const SIZE: (&'static str, &'static str) = ("parameters", "use fewer parameters");

    fn read(reader: &mut Reader<'_>) -> Result<Self, SpecificationError> {
        read::read(reader)
    }

    fn weight_count(&self) -> Option<usize> {
        Some(self.parameters.len())
    }

    fn sensors(&self) -> usize {
        0
    }

    fn actuators(&self) -> usize {
        0
    }

    fn steers(&self) -> bool {
        false
    }

    fn state_length(&self) -> usize {
        0
    }

    fn scratch_length(&self) -> usize {
        0
    }

    /// Not called: the set steers no agents.
    fn step(&self, _: &[f32], _: &mut [f32], _: &mut [f32], _: &[f32], _: &mut [f32]) {}

    fn values(&self, weights: &[f32]) -> Map<String, Value> {
        self.parameters
            .iter()
            .zip(weights)
            .map(|(parameter, weight)| (parameter.name.clone(), parameter.kind.value(*weight)))
            .collect()
    }
}
