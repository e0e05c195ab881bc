//! What a controller is made of, as JSON.

use crate::Architecture;
use crate::reader::Reader;
use serde::{Deserialize, Deserializer, Serialize, Serializer};
use serde_json::value::RawValue;
use std::str::FromStr;

/// Version of the specification that this crate reads and writes.
pub const VERSION: u32 = 1;

/// Most weights that a controller may have.
pub const MAX_WEIGHTS: usize = 1_000_000;

/// A specification that cannot be used.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum SpecificationError {
    /// Text that is not valid JSON.
    #[error("controller: not JSON: {reason}")]
    NotJson {
        /// Line of the text, from 1.
        line: usize,
        /// Column of the line, from 1.
        column: usize,
        /// What is wrong, line and column included.
        reason: String,
    },
    /// JSON, but not an object.
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
    /// As [`Architecture::from_json`]; a wrong number of weights, or one that is not a finite binary32.
    pub fn from_json(text: &str) -> Result<Self, SpecificationError> {
        let mut reader = Reader::new(text)?;
        let architecture = Architecture::read(&mut reader)?;
        let weights = reader.weights(architecture.weight_count())?;
        reader.end()?;
        Ok(Self {
            architecture,
            weights,
        })
    }

    /// What was checked before.
    pub(crate) fn of(architecture: &Architecture, weights: &[f32]) -> Self {
        Self {
            architecture: architecture.clone(),
            weights: weights.to_vec(),
        }
    }

    /// The specification without its weights.
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
