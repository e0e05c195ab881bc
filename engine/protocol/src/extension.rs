//! Extension messages that carry blocks of numbers: offloaded evaluation and batched stepwise (docs/reference/protocol.md).
//!
//! They are MessagePack maps with text keys; arrays of numbers are binary, little-endian, without a header. Unknown keys
//! are ignored. Shapes are checked where a message is read, so that whoever holds one need not.

use std::collections::BTreeMap;
use std::fmt;

use serde::de::DeserializeOwned;
use serde::{Deserialize, Serialize};
use serde_json::{Map, Value};

use crate::DecodeError;
use crate::values::bounded;

/// Version of all extension messages.
pub const EXTENSION_VERSION: u64 = 1;
/// Media type of all extension messages: the content type of MQTT 5.
pub const MEDIA_TYPE: &str = "application/msgpack";
/// Larger extension payloads are refused unread.
pub const MAX_BLOCK: usize = 64 << 20;

/// Numbers as little-endian bytes on the wire.
macro_rules! numbers {
    ($(#[$doc:meta])* $name:ident, $number:ty) => {
        $(#[$doc])*
        #[derive(Debug, Clone, PartialEq, Default)]
        pub struct $name(pub Vec<$number>);

        impl Serialize for $name {
            fn serialize<S: serde::Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
                let mut bytes = vec![0; size_of_val(&self.0[..])];
                let (rows, _) = bytes.as_chunks_mut::<{ size_of::<$number>() }>();
                for (row, number) in rows.iter_mut().zip(&self.0) {
                    *row = number.to_le_bytes();
                }
                serializer.serialize_bytes(&bytes)
            }
        }

        impl<'de> Deserialize<'de> for $name {
            fn deserialize<D: serde::Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
                struct Numbers;

                impl serde::de::Visitor<'_> for Numbers {
                    type Value = $name;

                    fn expecting(&self, formatter: &mut fmt::Formatter) -> fmt::Result {
                        formatter.write_str("binary")
                    }

                    fn visit_bytes<E: serde::de::Error>(self, bytes: &[u8]) -> Result<$name, E> {
                        const SIZE: usize = size_of::<$number>();
                        let (numbers, rest) = bytes.as_chunks::<SIZE>();
                        if !rest.is_empty() {
                            return Err(E::custom(format_args!(
                                "{} bytes are no whole number of {SIZE}-byte numbers",
                                bytes.len()
                            )));
                        }
                        Ok($name(numbers.iter().map(|number| <$number>::from_le_bytes(*number)).collect()))
                    }
                }

                deserializer.deserialize_bytes(Numbers)
            }
        }
    };
}

numbers!(
    /// binary32 numbers.
    F32s, f32
);
numbers!(
    /// binary64 numbers.
    F64s, f64
);
numbers!(
    /// Unsigned 32-bit integers.
    U32s, u32
);
numbers!(
    /// Unsigned 64-bit integers.
    U64s, u64
);

/// Request for offloaded evaluation: every candidate in every episode.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Evaluate {
    /// [`EXTENSION_VERSION`].
    pub version: u64,
    /// Chosen by the tool, echoed in the result.
    pub request: u64,
    /// Who asks, unique among the tools on the broker.
    pub tool: String,
    /// Topic for the result, without prefix.
    pub reply: String,
    /// Title of the simulation.
    pub simulation: String,
    /// Parameters; `seed` in them is replaced by each of `seeds`.
    #[serde(deserialize_with = "bounded")]
    pub parameters: Map<String, Value>,
    /// Controller specification without its weights (protocol/schemas/controller.schema.json).
    #[serde(deserialize_with = "bounded")]
    pub controller: Map<String, Value>,
    /// (candidates, weights), row-major.
    pub genomes: F32s,
    /// One seed per episode, at least one.
    pub seeds: U64s,
    /// Names of the metrics that the answer is to have beside the fitness.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub metrics: Vec<String>,
    /// 1 for the first try of this work.
    pub attempt: u32,
    /// Seconds after which the tool gives the work to somebody else.
    pub lease: f64,
    /// Which start of the server is meant, as it announced it: another one with its id is not.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub instance: Option<String>,
}

/// Reply to [`Evaluate`].
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Evaluated {
    /// [`EXTENSION_VERSION`].
    pub version: u64,
    /// The request's number.
    pub request: u64,
    /// The server's id.
    pub server: u64,
    /// (candidates, episodes), row-major; NaN where `failed` says why. Empty when `error` is there.
    #[serde(default)]
    pub fitness: F64s,
    /// The metrics that were asked for, each of the shape of `fitness`.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub metrics: BTreeMap<String, F64s>,
    /// Episodes that failed.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub failed: Vec<Failure>,
    /// Why nothing was evaluated.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub error: Option<Refusal>,
    /// Seconds of computation.
    pub seconds: f64,
}

/// One episode that failed.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct Failure {
    /// Index of the candidate in the request.
    pub candidate: u64,
    /// Index of the seed in the request.
    pub episode: u64,
    /// What went wrong, for people.
    pub reason: String,
    /// Where in the simulation's code, in the words of its language.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub stack: Option<String>,
}

/// Why a request was not served.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct Refusal {
    /// For programs.
    pub kind: RefusalKind,
    /// For people.
    pub reason: String,
}

/// Why a request was not served, for programs.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum RefusalKind {
    /// Another tool has the server: try another server, or later.
    Taken,
    /// The request cannot be served by this server: another simulation, controller kind, parameter.
    Invalid,
    /// The simulation failed as a whole.
    Failed,
}

/// Tool to server: a batch of episodes to be stepped together, all agents in one message a step.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct BatchStart {
    /// [`EXTENSION_VERSION`].
    pub version: u64,
    /// Chosen by the tool, echoed in every message of the batch.
    pub request: u64,
    /// Who asks, unique among the tools on the broker.
    pub tool: String,
    /// Topic for the server's messages, without prefix.
    pub reply: String,
    /// Title of the simulation.
    pub simulation: String,
    /// Parameters; `seed` in them is replaced by each of `seeds`.
    #[serde(deserialize_with = "bounded")]
    pub parameters: Map<String, Value>,
    /// One seed per episode of the batch.
    pub seeds: U64s,
    /// Names of the metrics that are to come with the fitness of each episode.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub metrics: Vec<String>,
    /// Which start of the server is meant, as it announced it: another one with its id is not.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub instance: Option<String>,
}

/// Tool to server: the actuators for the last [`BatchSensors`].
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct BatchActuators {
    /// [`EXTENSION_VERSION`].
    pub version: u64,
    /// The batch.
    pub request: u64,
    /// The step of the sensors that are answered.
    pub step: u64,
    /// (rows of the sensors, actuators), row-major; none to end the batch.
    pub actuators: F32s,
}

/// Tool to server, on one topic.
#[derive(Debug, Clone, PartialEq, Serialize)]
#[serde(tag = "kind", rename_all = "snake_case")]
pub enum ToServer {
    /// Offloaded evaluation.
    Evaluate(Evaluate),
    /// Start of a batch.
    Start(BatchStart),
    /// A step of a batch.
    Actuators(BatchActuators),
}

/// Server to tool: sensors of all agents that act next, of all episodes, and the episodes that have ended.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct BatchSensors {
    /// [`EXTENSION_VERSION`].
    pub version: u64,
    /// The batch.
    pub request: u64,
    /// The server's id.
    pub server: u64,
    /// Counts the messages of a batch from 0.
    pub step: u64,
    /// Index of the episode of each row.
    pub episodes: U32s,
    /// Index of the agent of each row.
    pub agents: U32s,
    /// (rows, sensors), row-major.
    pub sensors: F32s,
    /// Episodes that ended with the step before.
    pub ended: U32s,
    /// Their fitness.
    pub fitness: F64s,
    /// Their metrics that were asked for, each of the shape of `ended`.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub metrics: BTreeMap<String, F64s>,
    /// Episodes that failed with the step before; `candidate` is 0.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub failed: Vec<Failure>,
    /// Why the batch is not served.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub error: Option<Refusal>,
}

/// Server to tool: a stepwise episode has ended without fitness. Sent to tools that name a topic for it in their control
/// message; all others miss the fitness.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct Failed {
    /// [`EXTENSION_VERSION`].
    pub version: u64,
    /// The server's id.
    pub server: u64,
    /// Of the control message that started the episode.
    pub simulation_hash: String,
    /// What went wrong, for people.
    pub reason: String,
    /// Where in the simulation's code, in the words of its language.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub stack: Option<String>,
    /// Whether the simulation refuses the parameters, so that no other attempt will go better on this server.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub invalid: bool,
}

/// Server to tool, on one topic.
#[derive(Debug, Clone, PartialEq, Serialize)]
#[serde(tag = "kind", rename_all = "snake_case")]
pub enum ToTool {
    /// Result of an offloaded evaluation.
    Evaluated(Evaluated),
    /// A step of a batch.
    Sensors(BatchSensors),
    /// A stepwise episode has failed.
    Failed(Failed),
}

/// Characters of a failure's reason and stack, at most: writers cut longer ones, and so do readers that keep them.
pub const MOST_REASON: usize = 2_000;
/// See [`MOST_REASON`].
pub const MOST_STACK: usize = 8_000;

/// A text of at most `most` characters; a cut is marked.
#[must_use]
pub fn shortened(mut text: String, most: usize) -> String {
    // Texts are short as a rule, which their bytes tell.
    if text.len() > most
        && let Some((end, _)) = text.char_indices().nth(most)
    {
        let cut = text.char_indices().nth(most.saturating_sub(3));
        text.truncate(cut.map_or(end, |(place, _)| place));
        text.push_str("...");
    }
    text
}

fn decode<T: DeserializeOwned>(payload: &[u8]) -> Result<T, DecodeError> {
    if payload.len() > MAX_BLOCK {
        return Err(DecodeError::value(format!(
            "{} bytes are more than the {MAX_BLOCK} that a block may have",
            payload.len()
        )));
    }
    rmp_serde::from_slice(payload)
        .map_err(|error| DecodeError::value(format!("no message of this extension: {error}")))
}

/// The kind alone: the rest is then read once, straight into its place.
#[derive(Deserialize)]
struct Kind {
    kind: String,
}

fn unknown(kind: &str, expected: &str) -> DecodeError {
    DecodeError::value(format!("\"kind\" is {kind:?}, expected {expected}"))
}

/// `numbers`: bytes that the message's arrays will take, so that a block is not moved about while it is written.
fn encode<T: Serialize>(message: &T, numbers: usize) -> Vec<u8> {
    let mut bytes = Vec::with_capacity(numbers + 1024);
    // Maps, texts and numbers cannot fail to serialize into memory.
    match rmp_serde::encode::write_named(&mut bytes, message) {
        Ok(()) => bytes,
        Err(_) => Vec::new(),
    }
}

fn check(version: u64) -> Result<(), DecodeError> {
    if version == EXTENSION_VERSION {
        Ok(())
    } else {
        Err(DecodeError::value(format!(
            "\"version\" is {version}, expected {EXTENSION_VERSION}"
        )))
    }
}

fn shape(what: &str, found: usize, expected: usize) -> Result<(), DecodeError> {
    if found == expected {
        Ok(())
    } else {
        Err(DecodeError::value(format!(
            "\"{what}\" has {found} numbers, expected {expected}"
        )))
    }
}

fn finite(what: &str, numbers: &[f32]) -> Result<(), DecodeError> {
    match numbers.iter().position(|number| !number.is_finite()) {
        Some(index) => Err(DecodeError::value(format!(
            "\"{what}\"[{index}] is NaN or infinite"
        ))),
        None => Ok(()),
    }
}

/// What a request says of itself, read where the whole cannot be: so that it can be refused with a reason.
#[derive(Debug, Clone, PartialEq, Eq, Deserialize)]
pub struct Envelope {
    /// evaluate, start, ...
    pub kind: String,
    /// The request's number.
    pub request: u64,
    /// Topic for the answer, without prefix.
    pub reply: String,
}

impl Envelope {
    /// Reads a payload; none if it does not even say this.
    #[must_use]
    pub fn decode(payload: &[u8]) -> Option<Self> {
        decode(payload).ok()
    }
}

impl ToServer {
    /// Reads a payload.
    ///
    /// # Errors
    /// No MessagePack map of a known kind and version, numbers that are not finite, no seed, too large.
    pub fn decode(payload: &[u8]) -> Result<Self, DecodeError> {
        let Kind { kind } = decode(payload)?;
        let message = match kind.as_str() {
            "evaluate" => Self::Evaluate(decode(payload)?),
            "start" => Self::Start(decode(payload)?),
            "actuators" => Self::Actuators(decode(payload)?),
            _ => return Err(unknown(&kind, "evaluate, start or actuators")),
        };
        match &message {
            Self::Evaluate(m) => {
                check(m.version)?;
                finite("genomes", &m.genomes.0)?;
                if m.seeds.0.is_empty() || !m.lease.is_finite() {
                    return Err(DecodeError::value(
                        "\"seeds\" is empty or \"lease\" is no number".to_owned(),
                    ));
                }
            }
            Self::Start(m) => {
                check(m.version)?;
                if m.seeds.0.is_empty() {
                    return Err(DecodeError::value("\"seeds\" is empty".to_owned()));
                }
            }
            Self::Actuators(m) => {
                check(m.version)?;
                finite("actuators", &m.actuators.0)?;
            }
        }
        Ok(message)
    }

    /// The payload.
    #[must_use]
    pub fn encode(&self) -> Vec<u8> {
        let numbers = match self {
            Self::Evaluate(m) => size_of_val(&m.genomes.0[..]) + size_of_val(&m.seeds.0[..]),
            Self::Start(m) => size_of_val(&m.seeds.0[..]),
            Self::Actuators(m) => size_of_val(&m.actuators.0[..]),
        };
        encode(self, numbers)
    }
}

impl ToTool {
    /// Reads a payload.
    ///
    /// # Errors
    /// No MessagePack map of a known kind and version, arrays that do not fit each other, a fitness that is not finite
    /// though nothing says that it failed, too large.
    pub fn decode(payload: &[u8]) -> Result<Self, DecodeError> {
        let Kind { kind } = decode(payload)?;
        let message = match kind.as_str() {
            "evaluated" => Self::Evaluated(decode(payload)?),
            "sensors" => Self::Sensors(decode(payload)?),
            "failed" => Self::Failed(decode(payload)?),
            _ => return Err(unknown(&kind, "evaluated, sensors or failed")),
        };
        match &message {
            Self::Evaluated(m) => {
                check(m.version)?;
                for (name, values) in &m.metrics {
                    shape(name, values.0.len(), m.fitness.0.len())?;
                }
                let bad = m
                    .fitness
                    .0
                    .iter()
                    .filter(|fitness| !fitness.is_finite())
                    .count();
                if bad != m.failed.len() {
                    return Err(DecodeError::value(format!(
                        "{bad} fitness values are not finite, {} failed",
                        m.failed.len()
                    )));
                }
            }
            Self::Sensors(m) => {
                check(m.version)?;
                shape("agents", m.agents.0.len(), m.episodes.0.len())?;
                shape("fitness", m.fitness.0.len(), m.ended.0.len())?;
                for (name, values) in &m.metrics {
                    shape(name, values.0.len(), m.ended.0.len())?;
                }
                finite("sensors", &m.sensors.0)?;
                if m.fitness.0.iter().any(|fitness| !fitness.is_finite()) {
                    return Err(DecodeError::value("\"fitness\" is not finite".to_owned()));
                }
            }
            Self::Failed(m) => check(m.version)?,
        }
        Ok(message)
    }

    /// The payload.
    #[must_use]
    pub fn encode(&self) -> Vec<u8> {
        let numbers = match self {
            Self::Evaluated(m) => size_of_val(&m.fitness.0[..]) * (1 + m.metrics.len()),
            Self::Sensors(m) => size_of_val(&m.sensors.0[..]) + 8 * m.agents.0.len(),
            Self::Failed(_) => 0,
        };
        encode(self, numbers)
    }
}
