//! Extension: status, the current activity of an optimization tool and the messages that it waits for, for monitors.
//!
//! Times are durations in seconds, since the clocks of a tool and a monitor need not agree.

use std::fmt;

use serde::{Deserialize, Deserializer, Serialize};
use serde_json::{Map, Value};

use crate::numbers::Id;
use crate::place;
use crate::{DecodeError, MAX_PAYLOAD};

/// Largest number of entries of each list; it keeps a status of many servers far below [`MAX_PAYLOAD`].
pub const MOST_LISTED: usize = 1000;

/// Activity of a tool.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Activity {
    /// The tool looks for a first server.
    Looking,
    /// The tool has evaluations to do.
    Evaluating,
    /// The tool leaves; this is its last status.
    Left,
}

/// Kinds of pieces of work.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum PieceKind {
    /// A stepwise episode.
    Episode,
    /// Several episodes in batched mode.
    Batch,
    /// Evaluations in offloaded mode, of which only the results are returned.
    Block,
}

/// The awaited message of a piece.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Missing {
    /// The first message.
    Start,
    /// The sensors after the actuators of `step`.
    Sensors,
    /// The result.
    Result,
}

/// A piece of work in progress.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Waiting {
    /// Id of the server that has it.
    #[serde(with = "id")]
    pub server: u64,
    /// Kind of the piece.
    pub kind: PieceKind,
    /// The awaited message.
    pub missing: Missing,
    /// Number of evaluations.
    #[serde(with = "id")]
    pub evaluations: u64,
    /// In an episode, the agent whose actuators have not been answered.
    #[serde(default, skip_serializing_if = "Option::is_none", with = "optional_id")]
    pub agent: Option<u64>,
    /// Step whose actuators have not been answered, from 0.
    #[serde(default, skip_serializing_if = "Option::is_none", with = "optional_id")]
    pub step: Option<u64>,
    /// Seconds since the last usable message of the server.
    pub silent: f64,
}

impl fmt::Display for Waiting {
    fn fmt(&self, formatter: &mut fmt::Formatter) -> fmt::Result {
        let Self {
            server,
            evaluations,
            silent,
            ..
        } = self;
        let step = self.step.unwrap_or_default();
        write!(formatter, "server {server} has not ")?;
        match (self.kind, self.missing) {
            (PieceKind::Episode, Missing::Start) => write!(formatter, "begun its episode"),
            (PieceKind::Episode, Missing::Sensors) => {
                let agent = self.agent.unwrap_or_default();
                write!(
                    formatter,
                    "answered the actuators of agent {agent} in step {step}"
                )
            }
            (PieceKind::Episode, Missing::Result) => {
                write!(formatter, "sent the fitness of its episode")
            }
            (PieceKind::Batch, Missing::Start) => {
                write!(formatter, "begun its batch of {evaluations} episodes")
            }
            (PieceKind::Batch, Missing::Sensors) => write!(
                formatter,
                "answered the actuators of {evaluations} episodes in step {step}"
            ),
            (PieceKind::Batch, Missing::Result) => {
                write!(
                    formatter,
                    "sent the fitness of its batch of {evaluations} episodes"
                )
            }
            (PieceKind::Block, _) => {
                write!(formatter, "answered a block of {evaluations} evaluations")
            }
        }?;
        write!(formatter, " for {silent:.1} s")
    }
}

/// A server that the tool uses.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Used {
    /// Id of the server.
    #[serde(with = "id")]
    pub server: u64,
    /// Mode of evaluation: stepwise, batched or offloaded.
    pub mode: String,
    /// Measured evaluations per second; `None` before the first measurement.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub speed: Option<f64>,
    /// Number of failures in a row.
    #[serde(with = "id")]
    pub failures: u64,
    /// Reason for the last failure.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub reason: Option<String>,
    /// Seconds until the server gets work again, after a failure.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub benched: Option<f64>,
}

/// State in which there is work but no server for it.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct NoServer {
    /// Seconds without a server.
    pub seconds: f64,
    /// Servers that were found but cannot be used, for users.
    pub found: String,
}

/// Status of an optimization tool.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Status {
    #[serde(deserialize_with = "version")]
    version: u64,
    /// Name of the tool, unique on the broker, as in its other messages.
    pub tool: String,
    /// Current activity.
    pub state: Activity,
    /// Title of the simulation.
    pub simulation: String,
    /// Name of the run, for users.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub run: Option<String>,
    /// Current generation, from 0.
    #[serde(default, skip_serializing_if = "Option::is_none", with = "optional_id")]
    pub generation: Option<u64>,
    /// Number of generations of the whole run.
    #[serde(default, skip_serializing_if = "Option::is_none", with = "optional_id")]
    pub generations: Option<u64>,
    /// Number of evaluations that have ended.
    #[serde(with = "id")]
    pub done: u64,
    /// Number of evaluations in the generation, or in steady state, in the whole run.
    #[serde(with = "id")]
    pub total: u64,
    /// Work in progress, the longest silent first; at most [`MOST_LISTED`].
    pub waiting_for: Vec<Waiting>,
    /// Servers in use, benched ones first; at most [`MOST_LISTED`].
    pub servers: Vec<Used>,
    /// Set if there is no server for the work.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub no_server: Option<NoServer>,
}

impl Status {
    /// Creates the status of a tool that has no work yet.
    #[must_use]
    pub fn new(tool: String, simulation: String) -> Self {
        Self {
            version: 1,
            tool,
            state: Activity::Looking,
            simulation,
            run: None,
            generation: None,
            generations: None,
            done: 0,
            total: 0,
            waiting_for: Vec::new(),
            servers: Vec::new(),
            no_server: None,
        }
    }

    /// Decodes a payload.
    ///
    /// # Errors
    /// Fails if the payload is too large or not a JSON object of version 1, if a required key is missing, if a value
    /// has the wrong type, or if a duration or speed is negative.
    pub fn decode(payload: &[u8]) -> Result<Self, DecodeError> {
        if payload.len() > MAX_PAYLOAD {
            return Err(DecodeError::TooLarge {
                bytes: payload.len(),
                most: MAX_PAYLOAD,
            });
        }
        // Decode via a tree, in which the last of repeated keys wins.
        let object: Map<String, Value> = serde_json::from_slice(payload)?;
        let status: Self = place::read(Value::Object(object), "")?;
        match status.negative() {
            Some((path, number)) => Err(DecodeError::value(format!(
                "\"{path}\" is {number}, expected 0 or more"
            ))),
            None => Ok(status),
        }
    }

    /// Returns the first negative number that must not be negative, with its path.
    fn negative(&self) -> Option<(String, f64)> {
        for (index, waiting) in self.waiting_for.iter().enumerate() {
            if waiting.silent < 0.0 {
                return Some((format!("waiting_for[{index}].silent"), waiting.silent));
            }
        }
        for (index, used) in self.servers.iter().enumerate() {
            for (key, number) in [("speed", used.speed), ("benched", used.benched)] {
                if let Some(number) = number.filter(|number| *number < 0.0) {
                    return Some((format!("servers[{index}].{key}"), number));
                }
            }
        }
        let alone = self.no_server.as_ref().map(|alone| alone.seconds);
        let alone = alone.filter(|seconds| *seconds < 0.0)?;
        Some(("no_server.seconds".to_owned(), alone))
    }

    /// Encodes the payload, which must not contain NaN or infinite values.
    #[must_use]
    pub fn encode(&self) -> Vec<u8> {
        // Strings and numbers cannot fail to serialize.
        serde_json::to_vec(self).unwrap_or_default()
    }
}

fn version<'de, D: Deserializer<'de>>(deserializer: D) -> Result<u64, D::Error> {
    match Id::deserialize(deserializer)?.0 {
        1 => Ok(1),
        other => Err(serde::de::Error::custom(format_args!(
            "\"version\" is {other}, expected 1"
        ))),
    }
}

mod id {
    use super::{Deserialize, Deserializer, Id};

    #[expect(clippy::trivially_copy_pass_by_ref, reason = "serde's signature")]
    pub fn serialize<S: serde::Serializer>(number: &u64, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.serialize_u64(*number)
    }

    pub fn deserialize<'de, D: Deserializer<'de>>(deserializer: D) -> Result<u64, D::Error> {
        Id::deserialize(deserializer).map(|id| id.0)
    }
}

mod optional_id {
    use super::{Deserialize, Deserializer, Id};

    #[expect(clippy::ref_option, reason = "serde's signature")]
    pub fn serialize<S: serde::Serializer>(
        number: &Option<u64>,
        serializer: S,
    ) -> Result<S::Ok, S::Error> {
        match number {
            Some(number) => serializer.serialize_u64(*number),
            None => serializer.serialize_none(),
        }
    }

    pub fn deserialize<'de, D: Deserializer<'de>>(
        deserializer: D,
    ) -> Result<Option<u64>, D::Error> {
        Id::deserialize(deserializer).map(|id| Some(id.0))
    }
}
