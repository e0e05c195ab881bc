//! What a controller is made of, as JSON.

use crate::reader::{Reader, wrong};
use crate::{Activation, FullyMeshed, Layered, MealyFsm, ParameterSet};
use serde::{Deserialize, Deserializer, Serialize, Serializer};
use serde_json::value::RawValue;
use std::str::FromStr;

/// Version of the specification that this crate reads and writes.
pub const VERSION: u32 = 1;

/// Most weights that a controller may have.
pub const MAX_WEIGHTS: usize = 1_000_000;

const LAYERED: [&str; 8] = [
    "version",
    "kind",
    "sensors",
    "actuators",
    "hidden",
    "activation",
    "output_range",
    "weights",
];
const FULLY_MESHED: [&str; 9] = [
    "version",
    "kind",
    "sensors",
    "actuators",
    "hidden",
    "activation",
    "iterations",
    "output_range",
    "weights",
];
const MEALY_FSM: [&str; 7] = [
    "version",
    "kind",
    "sensors",
    "actuators",
    "states",
    "thresholds",
    "weights",
];
const PARAMETER_SET: [&str; 4] = ["version", "kind", "parameters", "weights"];
const MESHED_ACTIVATIONS: [Activation; 4] = [
    Activation::Clamp,
    Activation::Sigmoid,
    Activation::Tanh,
    Activation::Relu,
];
const MAX_ITERATIONS: usize = 1000;

/// A specification that cannot be used.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum SpecificationError {
    /// Text that is no JSON.
    #[error("controller: not JSON: {reason}")]
    NotJson {
        /// Line of the text, from 1.
        line: usize,
        /// Column of the line, from 1.
        column: usize,
        /// What is wrong, line and column included.
        reason: String,
    },
    /// JSON, but no object.
    #[error(
        "controller: expected a JSON object such as {{\"version\": 1, \"kind\": \"layered\", ...}}"
    )]
    NotAnObject,
    /// A field that is missing, unknown or wrong.
    #[error("controller.{field}: {reason}")]
    Field {
        /// The field, with an index where it is a list.
        field: String,
        /// What is wrong and what would be right.
        reason: String,
    },
}

/// A controller without its weights.
#[derive(Debug, Clone, PartialEq, Serialize)]
#[serde(tag = "kind", rename_all = "snake_case")]
pub enum Architecture {
    /// Feed-forward layers.
    Layered(Layered),
    /// FREVO's recurrent network.
    FullyMeshed(FullyMeshed),
    /// A finite-state machine.
    MealyFsm(MealyFsm),
    /// No controller at all: parameters of a simulation that steers its agents itself.
    ParameterSet(ParameterSet),
}

impl Architecture {
    /// Reads a specification and ignores its weights, which may be missing.
    ///
    /// # Errors
    /// Text that is no JSON object; a field that is missing, unknown, of the wrong type or out of range.
    pub fn from_json(text: &str) -> Result<Self, SpecificationError> {
        let mut reader = Reader::new(text)?;
        let architecture = Self::read(&mut reader)?;
        reader.skip_weights();
        reader.end(architecture.fields())?;
        Ok(architecture)
    }

    fn read(reader: &mut Reader<'_>) -> Result<Self, SpecificationError> {
        reader.count("version", VERSION as usize, VERSION as usize)?;
        let expected = "\"layered\", \"fully_meshed\", \"mealy_fsm\" or \"parameter_set\"";
        let kind = reader.text("kind", expected)?;
        let architecture = match kind.as_str() {
            "layered" => Self::Layered(Layered {
                sensors: reader.count("sensors", 1, MAX_WEIGHTS)?,
                actuators: reader.count("actuators", 1, MAX_WEIGHTS)?,
                hidden: reader.counts("hidden", 1, MAX_WEIGHTS)?,
                activation: reader.activation(&Activation::ALL)?,
                output_range: reader.output_range()?,
            }),
            "fully_meshed" => Self::FullyMeshed(FullyMeshed {
                sensors: reader.count("sensors", 1, MAX_WEIGHTS)?,
                actuators: reader.count("actuators", 1, MAX_WEIGHTS)?,
                hidden: reader.count("hidden", 0, MAX_WEIGHTS)?,
                activation: reader.activation(&MESHED_ACTIVATIONS)?,
                iterations: u32::try_from(reader.count("iterations", 1, MAX_ITERATIONS)?)
                    .unwrap_or(u32::MAX),
                output_range: reader.output_range()?,
            }),
            "mealy_fsm" => {
                let sensors = reader.count("sensors", 1, MAX_WEIGHTS)?;
                Self::MealyFsm(MealyFsm {
                    sensors,
                    actuators: reader.count("actuators", 1, MAX_WEIGHTS)?,
                    states: reader.count("states", 1, MAX_WEIGHTS)?,
                    thresholds: reader.thresholds(sensors)?,
                })
            }
            "parameter_set" => Self::ParameterSet(ParameterSet {
                parameters: reader.parameters(MAX_WEIGHTS)?,
            }),
            other => {
                return Err(wrong(
                    "kind",
                    format!("{other:?} found, expected {expected}"),
                ));
            }
        };
        let (field, smaller) = match &architecture {
            Self::MealyFsm(_) => ("thresholds", "take fewer states or thresholds"),
            _ => ("hidden", "use a smaller network"),
        };
        match architecture.checked_weight_count() {
            Some(count) if count <= MAX_WEIGHTS => Ok(architecture),
            Some(count) => Err(wrong(
                field,
                format!("makes {count} weights; {smaller}, at most {MAX_WEIGHTS}"),
            )),
            None => Err(wrong(
                field,
                format!("makes too many weights; at most {MAX_WEIGHTS} are possible"),
            )),
        }
    }

    fn fields(&self) -> &'static [&'static str] {
        match self {
            Self::Layered(_) => &LAYERED,
            Self::FullyMeshed(_) => &FULLY_MESHED,
            Self::MealyFsm(_) => &MEALY_FSM,
            Self::ParameterSet(_) => &PARAMETER_SET,
        }
    }

    fn checked_weight_count(&self) -> Option<usize> {
        match self {
            Self::Layered(net) => net.weight_count(),
            Self::FullyMeshed(net) => net.weight_count(),
            Self::MealyFsm(machine) => machine.weight_count(),
            Self::ParameterSet(set) => Some(set.parameters.len()),
        }
    }

    /// Number of weights, biases included.
    pub fn weight_count(&self) -> usize {
        self.checked_weight_count().unwrap_or(usize::MAX)
    }

    /// Whether agents are steered: not by a parameter set, which fits any simulation.
    pub fn steers(&self) -> bool {
        !matches!(self, Self::ParameterSet(_))
    }

    /// Numbers in; 0 where no agent is steered.
    pub fn sensors(&self) -> usize {
        match self {
            Self::Layered(net) => net.sensors,
            Self::FullyMeshed(net) => net.sensors,
            Self::MealyFsm(machine) => machine.sensors,
            Self::ParameterSet(_) => 0,
        }
    }

    /// Numbers out; 0 where no agent is steered.
    pub fn actuators(&self) -> usize {
        match self {
            Self::Layered(net) => net.actuators,
            Self::FullyMeshed(net) => net.actuators,
            Self::MealyFsm(machine) => machine.actuators,
            Self::ParameterSet(_) => 0,
        }
    }
}

/// A controller: architecture and weights, checked.
#[derive(Debug, Clone, PartialEq)]
pub struct Specification {
    architecture: Architecture,
    weights: Vec<f32>,
}

impl Specification {
    /// Reads a specification.
    ///
    /// # Errors
    /// As [`Architecture::from_json`]; a wrong number of weights, or one that is no finite binary32.
    pub fn from_json(text: &str) -> Result<Self, SpecificationError> {
        let mut reader = Reader::new(text)?;
        let architecture = Architecture::read(&mut reader)?;
        let weights = reader.weights(architecture.weight_count())?;
        reader.end(architecture.fields())?;
        Ok(Self {
            architecture,
            weights,
        })
    }

    /// Everything but the weights.
    pub fn architecture(&self) -> &Architecture {
        &self.architecture
    }

    /// The weights, in the order of the architecture.
    pub fn weights(&self) -> &[f32] {
        &self.weights
    }

    /// Number of weights, biases included.
    pub fn weight_count(&self) -> usize {
        self.architecture.weight_count()
    }
}

impl FromStr for Specification {
    type Err = SpecificationError;

    fn from_str(text: &str) -> Result<Self, SpecificationError> {
        Self::from_json(text)
    }
}

impl Serialize for Specification {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        #[derive(Serialize)]
        struct Document<'a> {
            version: u32,
            #[serde(flatten)]
            architecture: &'a Architecture,
            weights: &'a [f32],
        }
        let document = Document {
            version: VERSION,
            architecture: &self.architecture,
            weights: &self.weights,
        };
        document.serialize(serializer)
    }
}

impl<'de> Deserialize<'de> for Specification {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        let raw = Box::<RawValue>::deserialize(deserializer)?;
        Self::from_json(raw.get()).map_err(serde::de::Error::custom)
    }
}
